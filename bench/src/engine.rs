//! Cost of the engine for each message: a route in memory, against a loop over endpoints of the same bus.
//!
//! ```text
//!   route   publisher ─▶ /in ─▶ listener, route-worker, publisher ─▶ /out ─▶ listener
//!   loop    publisher ─▶ /in ─▶ listener, a thread,     publisher ─▶ /out ─▶ listener
//! ```
//!
//! In a process on one core: where the system puts two threads decides more than what they do, and to wake one on the
//! other core takes ten times what is measured. On one core the time of a message is its work.

use std::io::Write as _;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::Duration;

use anyhow::{Context as _, Result};
use serde::{Deserialize, Serialize};
use wrapyfi_data::types::Payload;
use wrapyfi_endpoint::memory::Memory;
use wrapyfi_endpoint::{Context, Listener, Middleware as _, Publisher, Registry, TopicSpec};
use wrapyfi_engine::{Engine, Plan, Route};

use crate::child::Child;
use crate::clock;
use crate::payload::{Kind, Maker};
use crate::report::Limit::AtMost;
use crate::report::{Row, Target, quantile};
use crate::turn::Bench;

/// Turns of each side.
const ROUNDS: usize = 61;
/// Messages of a turn: one under way at a time, and all at once.
const ALONE: u32 = 2_000;
const BURST: u32 = 1_000;
const BURSTS: u32 = 20;

/// Microseconds a message.
#[derive(Default)]
struct Times {
    /// From publish to taken, median, one under way.
    alone: Vec<f64>,
    /// CPU of the process, a thousand at once.
    burst: Vec<f64>,
}

/// Figure of a turn.
type Figure = fn(&Times) -> &Vec<f64>;

/// The two outer ends.
pub(crate) struct Ends {
    pub(crate) publisher: Box<dyn Publisher>,
    pub(crate) listener: Box<dyn Listener>,
    pub(crate) context: Context,
}

fn spec(topic: &str, kind: Kind) -> TopicSpec {
    let mut spec = TopicSpec::new(topic, kind.message_type());
    spec.queue.depth = BURST as usize;
    spec
}

fn each(nanos: u64, messages: u32) -> f64 {
    nanos as f64 / 1e3 / f64::from(messages)
}

impl Ends {
    pub(crate) fn open(bus: &Memory, kind: Kind) -> Result<Self> {
        let context = Context::default();
        let listener = bus.open_listener(&spec("/out", kind), &context)?;
        let publisher = bus.open_publisher(&spec("/in", kind), &Context::default())?;
        Ok(Self { publisher, listener, context })
    }

    pub(crate) fn take(&mut self) -> Result<()> {
        while self.listener.take()?.is_none() {
            let rang = self.context.wake.wait(Duration::from_secs(10));
            anyhow::ensure!(rang, "a message that did not arrive");
        }
        Ok(())
    }

    fn turn(&mut self, payload: &Payload, times: &mut Times) -> Result<()> {
        let mut alone = Vec::new();
        for _ in 0..ALONE {
            let start = clock::now();
            self.publisher.publish(payload)?;
            self.take()?;
            alone.push(each(clock::now() - start, 1));
        }
        times.alone.push(quantile(&alone, 0.5));
        let before = clock::cpu();
        for _ in 0..BURSTS {
            for _ in 0..BURST {
                self.publisher.publish(payload)?;
            }
            for _ in 0..BURST {
                self.take()?;
            }
        }
        times.burst.push(each(clock::cpu() - before, BURSTS * BURST));
        Ok(())
    }
}

/// Carries without an engine until it is told to end.
fn carry(bus: &Memory, kind: Kind, is_over: &AtomicBool) -> Result<()> {
    let context = Context::default();
    let mut listener = bus.open_listener(&spec("/in", kind), &context)?;
    let mut publisher = bus.open_publisher(&spec("/out", kind), &Context::default())?;
    while !is_over.load(Relaxed) {
        while let Some(sample) = listener.take()? {
            publisher.publish(&sample.payload)?;
        }
        context.wake.wait(Duration::from_millis(100));
    }
    Ok(())
}

/// Waits until what is between the ends is open.
pub(crate) fn wait_open(ends: &mut Ends, payload: &Payload) -> Result<()> {
    for _ in 0..1000 {
        // There may be no listener yet: what is refused now is not an error.
        _ = ends.publisher.publish(payload);
        ends.context.wake.wait(Duration::from_millis(10));
        if ends.listener.take()?.is_some() {
            while ends.context.wake.wait(Duration::from_millis(200)) {
                while ends.listener.take()?.is_some() {}
            }
            return Ok(());
        }
    }
    anyhow::bail!("nothing arrives in memory")
}

/// Figures of the process that measures.
#[derive(Serialize, Deserialize)]
struct Measured {
    targets: Vec<Target>,
}

/// Measures both in a process on one core.
pub(crate) fn run(bench: &Bench) -> Result<Vec<Target>> {
    let mut command = bench.command(Path::new("taskset"));
    command.args(["--cpu-list", "0"]).arg(&bench.own).arg("engine");
    Ok(Child::start("engine", command, &bench.folder)?.answer::<Measured>()?.targets)
}

/// Runs that process.
pub(crate) fn tell() -> Result<()> {
    writeln!(std::io::stdout(), "{}", serde_json::to_string(&Measured { targets: measure()? })?)?;
    Ok(())
}

/// Measures both by turns.
fn measure() -> Result<Vec<Target>> {
    let mut targets = Vec::new();
    for kind in [Kind::Small, Kind::VgaRgb] {
        let payload = Maker::new(kind)?.payload(1);
        let (routed, looped) = (Arc::new(Memory::new("memory")), Memory::new("memory"));
        let mut registry = Registry::new();
        registry.register(routed.clone());
        let [from, to] = ["memory:/in".parse()?, "memory:/out".parse()?];
        let mut route = Route::topic(from, to, kind.message_type());
        route.policy.queue.depth = BURST as usize;
        let engine = Engine::new(Plan { routes: vec![route] }, &registry);
        let running = engine.start().context("starting the route")?;
        let is_over = AtomicBool::new(false);
        let [mut route, mut bare] = [Times::default(), Times::default()];
        std::thread::scope(|scope| {
            let carrier = scope.spawn(|| carry(&looped, kind, &is_over));
            let measured = (|| {
                let mut ends = [Ends::open(&routed, kind)?, Ends::open(&looped, kind)?];
                for ends in &mut ends {
                    wait_open(ends, &payload)?;
                }
                let [on_route, on_loop] = &mut ends;
                for _ in 0..ROUNDS {
                    on_route.turn(&payload, &mut route)?;
                    on_loop.turn(&payload, &mut bare)?;
                }
                Ok(())
            })();
            is_over.store(true, Relaxed);
            let carried = carrier.join().unwrap_or_else(|_| anyhow::bail!("the loop panicked"));
            measured.and(carried)
        })?;
        drop(running.stop());
        let figures: [(&str, Figure); 2] = [
            ("one under way", |times| &times.alone),
            ("a thousand at once, CPU", |times| &times.burst),
        ];
        for (what, of) in figures {
            let both = [of(&route), of(&bare)];
            let more: Vec<f64> =
                both[0].iter().zip(both[1]).map(|(one, other)| one - other).collect();
            let [with, without] = both.map(|times| quantile(times, 0.5));
            targets.push(Target::of(
                Row::new(
                    "engine",
                    "us",
                    format!(
                        "engine above raw endpoints in memory, {}, {what}: us a message",
                        kind.title()
                    ),
                ),
                AtMost(1.5),
                &more,
                format!("{with:.2} - {without:.2} us"),
            ));
        }
    }
    Ok(targets)
}
