//! Round trips: a call of a service, and bare bytes there and back on the same DDS.
//!
//! ```text
//!   raw        near: writer ═══ ping ═══▶ reader :far
//!              near: reader ◀══ pong ════ writer :far
//!   service    near: AnyClient ═ request ═▶ AnyServer :far
//!              near: AnyClient ◀═ reply ═══ AnyServer :far
//! ```
//!
//! Near and far are processes of their own. One call is under way at a time, the next begins when the
//! one before has ended, and who waits sleeps. Bare ends carry as many bytes as the service puts on
//! the wire.

mod cyclone;
mod rust;
mod service;

use std::io::{BufRead as _, Read as _};
use std::time::Duration;

use anyhow::{Context as _, Result, ensure};
use wrapyfi_core::middleware::ros2::graph::ServiceMapping;

use crate::child::Child;
use crate::clock;
use crate::turn::{Bench, Line, Phase};
use crate::worker::{Order, Report, micros, say};

/// Longest time of a single round trip before it counts as lost.
const TIMEOUT: Duration = Duration::from_secs(2);
/// Longest time to look for the other end, in nanoseconds.
const OPENING: u64 = 20_000_000_000;
/// The same before the other end is found: what is sent then is not answered.
const PROBE: Duration = Duration::from_millis(40);
/// Round trips that are made before anything is measured.
const WARM: u32 = 30;

/// Kind of the end that answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, clap::ValueEnum)]
pub(crate) enum Way {
    /// Topics on bare CycloneDDS.
    RawCyclone,
    /// A service as `rmw_cyclonedds_cpp` has them.
    Cyclone,
    /// Topics on bare RustDDS.
    RawRustdds,
    /// A service as `rmw_fastrtps_cpp` has them, which is on RustDDS.
    Fastdds,
}

impl Way {
    /// Name in files and on the command line.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::RawCyclone => "raw-cyclone",
            Self::Cyclone => "cyclone",
            Self::RawRustdds => "raw-rustdds",
            Self::Fastdds => "fastdds",
        }
    }

    /// Title of the way, for people.
    pub(crate) fn title(self) -> &'static str {
        match self {
            Self::RawCyclone => "raw CycloneDDS, there and back",
            Self::Cyclone => "service, mapping of CycloneDDS",
            Self::RawRustdds => "raw RustDDS, there and back",
            Self::Fastdds => "service, mapping of Fast DDS (on RustDDS)",
        }
    }

    /// The mapping of the service; for bare ends, of the one that they are compared with.
    fn mapping(self) -> ServiceMapping {
        match self {
            Self::RawCyclone | Self::Cyclone => ServiceMapping::Cyclone,
            Self::RawRustdds | Self::Fastdds => ServiceMapping::FastDds,
        }
    }
}

/// Requests and replies of a round trip.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, clap::ValueEnum)]
pub(crate) enum Load {
    /// `example_interfaces/srv/AddTwoInts`.
    AddTwoInts,
    /// A string of 64 KiB, sent back.
    Text64k,
}

impl Load {
    /// Name in files and on the command line.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::AddTwoInts => "add-two-ints",
            Self::Text64k => "text64k",
        }
    }

    /// Title of the load, for people.
    pub(crate) fn title(self) -> &'static str {
        match self {
            Self::AddTwoInts => "AddTwoInts (16 and 8 bytes)",
            Self::Text64k => "string of 64 KiB each way",
        }
    }

    /// Round trips of one turn.
    fn count(self) -> u32 {
        match self {
            Self::AddTwoInts => 300,
            Self::Text64k => 100,
        }
    }
}

/// One load on one way.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, clap::Args)]
pub(crate) struct Trip {
    #[arg(long)]
    pub(crate) load: Load,
    #[arg(long)]
    pub(crate) way: Way,
}

/// One trip of one turn, as its processes are told.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct Place {
    #[command(flatten)]
    trip: Trip,
    /// DDS domain.
    #[arg(long)]
    domain: u32,
}

/// Figures of one turn.
#[derive(Debug, Clone, Default)]
pub(crate) struct Leg {
    pub(crate) warm: Report,
    pub(crate) calls: Phase,
}

impl Leg {
    /// Start to first answer, in milliseconds.
    #[allow(clippy::cast_precision_loss)]
    pub(crate) fn opening_ms(&self) -> f64 {
        self.warm.opening_ns as f64 / 1e6
    }
}

/// The end that asks.
trait Near {
    /// One round trip; false where no answer came within `patience`. A client of a service has its
    /// own, [`TIMEOUT`].
    fn call(&mut self, number: u32, patience: Duration) -> Result<bool>;
}

/// The end that answers.
trait Far {
    /// Answers what is there, and sleeps for at most `patience` where nothing is.
    fn serve(&mut self, patience: Duration) -> Result<()>;
}

impl Trip {
    /// Every trip, those that are compared next to each other. A reply of Fast DDS's mapping that
    /// is larger than a datagram has no raw counterpart: there is none.
    pub(crate) const ALL: [Self; 6] = [
        Self { load: Load::AddTwoInts, way: Way::RawCyclone },
        Self { load: Load::AddTwoInts, way: Way::Cyclone },
        Self { load: Load::Text64k, way: Way::RawCyclone },
        Self { load: Load::Text64k, way: Way::Cyclone },
        Self { load: Load::AddTwoInts, way: Way::RawRustdds },
        Self { load: Load::AddTwoInts, way: Way::Fastdds },
    ];

    /// `call-way/load`.
    pub(crate) fn name(self) -> String {
        format!("call-{}/{}", self.way.name(), self.load.name())
    }

    /// Measures it once.
    pub(crate) fn turn(self, bench: &Bench) -> Result<Leg> {
        let domain = bench.domain();
        let start = |role: &str| {
            let mut command = bench.command(&bench.own);
            command.args([role, "--load", self.load.name(), "--way", self.way.name()]);
            command.args(["--domain", &domain.to_string()]);
            Child::start(role, command, &bench.folder)
        };
        let (sink, source) = (start("far")?, start("near")?);
        let mut line = Line { source, sink, middle: Vec::new(), domain, acks: 0 };
        let warm = line.ask(&Order::Warm).context("warming up")?;
        let calls = line.phase(&Order::Window { count: self.load.count(), inflight: 1 })?;
        let Report { sent, received, .. } = calls.report;
        ensure!(sent == received, "{} of {sent} calls had no answer", sent - received);
        Ok(Leg { warm, calls })
    }
}

/// Runs the end that asks: obeys orders as a source does.
pub(crate) fn near(place: &Place) -> Result<()> {
    let mut end: Box<dyn Near> = match place.trip.way {
        Way::RawCyclone => Box::new(cyclone::End::near(place)?),
        Way::RawRustdds => Box::new(rust::End::near(place)?),
        Way::Cyclone | Way::Fastdds => Box::new(service::Client::new(place)?),
    };
    let mut number = 0;
    for line in std::io::stdin().lock().lines() {
        let report = match serde_json::from_str(&line?)? {
            Order::Warm => {
                let start = clock::now();
                loop {
                    number += 1;
                    if end.call(number, PROBE)? {
                        break;
                    }
                    ensure!(clock::now() < start + OPENING, "no answer within 20 s");
                }
                let opening_ns = clock::now() - start;
                Report { opening_ns, ..calls(&mut *end, &mut number, WARM)? }
            }
            Order::Window { count, .. } | Order::Paced { count, .. } => {
                calls(&mut *end, &mut number, count)?
            }
        };
        say(&serde_json::to_value(report)?)?;
    }
    Ok(())
}

/// Makes `count` round trips, one after the other.
fn calls(end: &mut dyn Near, number: &mut u32, count: u32) -> Result<Report> {
    let mut report = Report::default();
    let begin = clock::now();
    for _ in 0..count {
        *number += 1;
        let start = clock::now();
        let answered = end.call(*number, TIMEOUT)?;
        let took = clock::now() - start;
        report.sent += 1;
        if answered {
            report.received += 1;
            report.latency_us.push(micros(took));
        }
    }
    report.span_ns = clock::now() - begin;
    Ok(report)
}

/// Runs the end that answers, until its stdin ends.
pub(crate) fn far(place: &Place) -> Result<()> {
    std::thread::spawn(|| {
        let _end = std::io::stdin().read(&mut [0; 1]);
        std::process::exit(0);
    });
    let mut end: Box<dyn Far> = match place.trip.way {
        Way::RawCyclone => Box::new(cyclone::End::far(place)?),
        Way::RawRustdds => Box::new(rust::End::far(place)?),
        Way::Cyclone | Way::Fastdds => Box::new(service::Server::new(place)?),
    };
    loop {
        end.serve(Duration::from_secs(1))?;
    }
}

/// A message for bare ends, with the bytes that one of `size` bytes takes on the service's topic:
/// encapsulation header, number, zeros.
fn message(size: usize, mapping: ServiceMapping) -> Vec<u8> {
    // On CycloneDDS the identity stands in front of the body, on RustDDS it is no part of the sample.
    let identity = if mapping == ServiceMapping::Cyclone { 16 } else { 0 };
    let mut bytes = vec![0, 1, 0, 0];
    bytes.resize((size + identity).next_multiple_of(4), 0);
    bytes
}

/// Bytes of the message that hold its number.
const NUMBER: std::ops::Range<usize> = 4..8;

fn number_of(message: &[u8]) -> Option<u32> {
    Some(u32::from_le_bytes(message.get(NUMBER)?.try_into().ok()?))
}

fn set_number(message: &mut [u8], number: u32) {
    if let Some(place) = message.get_mut(NUMBER) {
        place.copy_from_slice(&number.to_le_bytes());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bare_messages_weigh_what_a_service_sends() {
        let (request, reply) = service::sizes(Load::AddTwoInts).unwrap();
        assert_eq!((request, reply), (4 + 16, 4 + 8));
        assert_eq!(message(request, ServiceMapping::Cyclone).len(), 4 + 16 + 16);
        assert_eq!(message(reply, ServiceMapping::FastDds).len(), 4 + 8);
        let (request, reply) = service::sizes(Load::Text64k).unwrap();
        assert_eq!((request, reply), (4 + 4 + 65_537, 4 + 4 + 65_537));
    }

    #[test]
    fn numbers_come_back() {
        let mut ping = message(12, ServiceMapping::FastDds);
        set_number(&mut ping, 77);
        assert_eq!(number_of(&ping), Some(77));
        assert_eq!(number_of(&[0; 7]), None);
    }

    #[test]
    fn every_service_stands_beside_its_raw_way() {
        for pair in Trip::ALL.chunks(2) {
            let [raw, service] = pair else { panic!("an odd trip") };
            assert_eq!((raw.load, raw.way.mapping()), (service.load, service.way.mapping()));
            assert!(raw.name().starts_with("call-raw-"), "{}", raw.name());
        }
    }
}
