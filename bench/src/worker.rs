//! The two ends of a measured way, each a process of its own.
//!
//! ```text
//!   orchestrator ── orders ──▶ source ══ the way that is measured ══▶ sink
//!                ◀── results ──  ▲                                     │
//!                                └── (number, time of arrival), TCP ───┘
//! ```
//!
//! Latency counts from the time when a message was due, not from when it was sent: a source that is
//! held up does not hide what its messages waited. Orders and results are one JSON object a line;
//! `peers/python_wrapyfi.py` speaks the same.

use std::collections::HashMap;
use std::io::{BufRead as _, ErrorKind, Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::time::Duration;

use anyhow::{Context as _, Result};
use serde::{Deserialize, Serialize};

use crate::clock;
use crate::wire::{Outgoing, Place, Wire, incoming, outgoing};

/// Messages at the start of a process that are reported but not counted.
const WARM: u32 = 8;
/// Time for which the way may stay silent before missing messages count as lost.
const SILENCE: Duration = Duration::from_secs(2);
/// Longest time that the way may take to open, in nanoseconds.
const OPENING: u64 = 20_000_000_000;
/// Messages at a fixed rate after which the source looks what it was told.
const HEAR_EVERY: u32 = 100;
/// Bytes of an acknowledgement: number and time.
const ACK: usize = 16;

/// Order to a source.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(tag = "do", rename_all = "kebab-case")]
pub(crate) enum Order {
    /// Send until something arrives, then a few more.
    Warm,
    /// Send `count` messages, one every `1 / hz` seconds.
    Paced { count: u32, hz: f64 },
    /// Send `count` messages, as fast as `inflight` unacknowledged ones allow.
    Window { count: u32, inflight: u32 },
}

/// Report of a source.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(crate) struct Report {
    /// Messages handed to the transport.
    pub(crate) sent: u32,
    /// Messages that the transport refused.
    pub(crate) refused: u32,
    /// Distinct messages that arrived.
    pub(crate) received: u32,
    /// Messages that arrived more than once.
    pub(crate) duplicates: u32,
    /// Microseconds from due to arrived, of each message that arrived.
    pub(crate) latency_us: Vec<f64>,
    /// Most that a message was sent after it was due, in microseconds.
    pub(crate) latest_us: f64,
    /// Time spent awake while waiting, in nanoseconds: no cost of the way.
    pub(crate) awake_ns: u64,
    /// First message sent to last message arrived, in nanoseconds.
    pub(crate) span_ns: u64,
}

/// Runs a source: prints the port where it wants to be told of arrivals, then obeys.
pub(crate) fn source(wire: Wire, place: &Place) -> Result<()> {
    let listener = TcpListener::bind(("127.0.0.1", 0))?;
    say(&serde_json::json!({ "acks": listener.local_addr()?.port() }))?;
    let (acks, _) = listener.accept()?;
    acks.set_nodelay(true)?;
    let way = outgoing(wire, place)?;
    let mut source = Source { way, acks, partial: Vec::new(), next: 1 };
    for line in std::io::stdin().lock().lines() {
        let report = match serde_json::from_str(&line?)? {
            Order::Warm => source.warm()?,
            Order::Paced { count, hz } => source.paced(count, hz)?,
            Order::Window { count, inflight } => source.window(count, inflight)?,
        };
        say(&serde_json::to_value(report)?)?;
    }
    Ok(())
}

/// Prints one JSON object.
fn say(value: &serde_json::Value) -> Result<()> {
    let mut out = std::io::stdout().lock();
    writeln!(out, "{value}")?;
    Ok(out.flush()?)
}

/// Runs a sink until the source is gone.
pub(crate) fn sink(wire: Wire, place: &Place, acks: u16) -> Result<()> {
    let mut acks = TcpStream::connect(("127.0.0.1", acks))?;
    acks.set_nodelay(true)?;
    let mut next = incoming(wire, place)?;
    let mut gone = acks.try_clone()?;
    std::thread::spawn(move || {
        // The source never writes: this returns when it ends.
        let _end = gone.read(&mut [0; 1]);
        std::process::exit(0);
    });
    loop {
        let (seq, received) = next()?;
        acks.write_all(&[u64::from(seq), received].map(u64::to_le_bytes).concat())?;
    }
}

struct Source {
    way: Box<dyn Outgoing>,
    acks: TcpStream,
    partial: Vec<u8>,
    next: u32,
}

/// Times at which messages were due, and at which they arrived.
#[derive(Default)]
struct Ledger {
    due: HashMap<u32, (u64, u64)>,
    report: Report,
    last_arrival: u64,
}

impl Ledger {
    fn arrived(&mut self, seq: u32, time: u64) {
        let Some((due, seen)) = self.due.get_mut(&seq) else { return };
        if std::mem::replace(seen, time) > 0 {
            self.report.duplicates += 1;
            return;
        }
        self.report.received += 1;
        self.report.latency_us.push(micros(time.saturating_sub(*due)));
        self.last_arrival = self.last_arrival.max(time);
    }

    fn is_complete(&self) -> bool {
        self.report.received >= self.report.sent
    }
}

/// Nanoseconds in microseconds.
fn micros(nanos: u64) -> f64 {
    nanos as f64 / 1e3
}

impl Source {
    fn warm(&mut self) -> Result<Report> {
        let start = clock::now();
        let mut ledger = Ledger::default();
        while ledger.report.received == 0 && clock::now() < start + OPENING {
            // There may be no program yet: what is refused now is not an error.
            let _refused = self.send(&mut ledger, clock::now());
            self.hear(&mut ledger, Duration::from_millis(40))?;
        }
        anyhow::ensure!(ledger.report.received > 0, "nothing arrived within 20 s");
        // Messages still under way must not be taken for those that come now.
        std::thread::sleep(Duration::from_millis(60));
        self.hear(&mut ledger, Duration::from_millis(1))?;
        self.paced(WARM, 40.0)
    }

    fn paced(&mut self, count: u32, hz: f64) -> Result<Report> {
        let period = Duration::try_from_secs_f64(1.0 / hz).context("rate")?.as_nanos();
        let mut ledger = Ledger::default();
        let start = clock::now() + 2_000_000;
        for index in 0..count {
            if index % HEAR_EVERY == HEAR_EVERY - 1 {
                // Acknowledgements are taken in between, or a long stream would hold the sink up.
                self.acks.set_nonblocking(true)?;
                self.hear(&mut ledger, Duration::from_millis(1))?;
                self.acks.set_nonblocking(false)?;
            }
            let due = start + u64::try_from(period * u128::from(index))?;
            self.way.prepare(self.next)?;
            ledger.report.awake_ns += clock::wait_until(due);
            let late = micros(clock::now() - due);
            ledger.report.latest_us = ledger.report.latest_us.max(late);
            self.send_prepared(&mut ledger, due);
        }
        self.finish(ledger, start)
    }

    fn window(&mut self, count: u32, inflight: u32) -> Result<Report> {
        let mut ledger = Ledger::default();
        let start = clock::now();
        for _ in 0..count {
            self.send(&mut ledger, clock::now())?;
            while ledger.report.sent - ledger.report.received >= inflight {
                if self.hear(&mut ledger, SILENCE)? == 0 {
                    return self.finish(ledger, start);
                }
            }
        }
        self.finish(ledger, start)
    }

    fn send(&mut self, ledger: &mut Ledger, due: u64) -> Result<()> {
        self.way.prepare(self.next)?;
        self.send_prepared(ledger, due);
        Ok(())
    }

    fn send_prepared(&mut self, ledger: &mut Ledger, due: u64) {
        ledger.due.insert(self.next, (due, 0));
        self.next += 1;
        match self.way.send() {
            Ok(()) => ledger.report.sent += 1,
            Err(_) => ledger.report.refused += 1,
        }
    }

    /// Waits for what is under way.
    fn finish(&mut self, mut ledger: Ledger, start: u64) -> Result<Report> {
        while !ledger.is_complete() && self.hear(&mut ledger, SILENCE)? > 0 {}
        // A duplicate comes after what it doubles.
        self.hear(&mut ledger, Duration::from_millis(5))?;
        let span_ns = ledger.last_arrival.saturating_sub(start);
        Ok(Report { span_ns, ..ledger.report })
    }

    /// Reads the arrivals that were told, waiting at most `max_wait` for the first; how many.
    fn hear(&mut self, ledger: &mut Ledger, max_wait: Duration) -> Result<usize> {
        self.acks.set_read_timeout(Some(max_wait))?;
        let mut buffer = [0; 4096];
        let read = match self.acks.read(&mut buffer) {
            Ok(0) => anyhow::bail!("the sink ended"),
            Ok(read) => read,
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => 0,
            Err(error) => return Err(error.into()),
        };
        self.partial.extend_from_slice(buffer.get(..read).unwrap_or_default());
        let (acks, rest) = self.partial.as_chunks::<ACK>();
        for ack in acks {
            let (number, time) = ack.split_at(8);
            let seq = u64::from_le_bytes(number.try_into()?);
            ledger.arrived(u32::try_from(seq)?, u64::from_le_bytes(time.try_into()?));
        }
        let heard = acks.len();
        self.partial = rest.to_vec();
        Ok(heard)
    }
}
