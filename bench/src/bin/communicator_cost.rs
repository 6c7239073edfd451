//! What a registered method costs above the method and above the raw endpoint.
//!
//! ```text
//!   call      the method itself ─ mode none ─ publish, nobody listens        ns a call
//!   message   raw endpoint: publish, take ─ registered: publish, listen      ns a message, by turns
//! ```
//!
//! On the memory middleware nothing but the library is measured; on ZeroMQ, through our broker, a
//! message costs what it costs in a program. Both ends are in one process. `cargo run --release -p wrapyfi_bench
//! --bin communicator_cost` prints medians of turns that alternate.

#![allow(clippy::print_stdout, reason = "a program for the terminal")]

use std::hint::black_box;
use std::sync::Arc;
use std::time::{Duration, Instant};

use wrapyfi_core::communicator::{Context, Mode, communicator};
use wrapyfi_core::endpoint::{self, Listener, Middleware as _, Publisher, TopicSpec};
use wrapyfi_core::middleware::memory::Memory;
use wrapyfi_core::middleware::zeromq::{BrokerMode, ZeroMq, ZeroMqConfig};
use wrapyfi_core::types::{Encoding, Image, MessageType, Payload, RawPixels, Stamp, Value};

/// Calls or messages of one turn.
const CALLS: u32 = 20_000;
/// Messages of one turn over ZeroMQ.
const MESSAGES: u32 = 500;
/// Turns of each case.
const TURNS: usize = 31;

struct Robot {
    calls: i64,
    frame: Image,
}

#[communicator]
impl Robot {
    #[register(NativeObject, "memory", "/registered/object", should_wait = false)]
    fn object(&mut self, step: i64) -> Value {
        self.calls += step;
        Value::Int(self.calls)
    }

    #[register(Image, "memory", "/registered/image", should_wait = false)]
    fn image(&mut self) -> Image {
        self.calls += 1;
        self.frame.clone()
    }
}

/// One way to do something, measured in turns.
struct Case<'a> {
    name: &'static str,
    run: Box<dyn FnMut() -> anyhow::Result<()> + 'a>,
    turns_ns: Vec<f64>,
}

impl<'a> Case<'a> {
    fn new(name: &'static str, run: impl FnMut() -> anyhow::Result<()> + 'a) -> Self {
        Self { name, run: Box::new(run), turns_ns: Vec::new() }
    }

    fn median_ns(&mut self) -> f64 {
        self.turns_ns.sort_by(f64::total_cmp);
        self.turns_ns.get(self.turns_ns.len() / 2).copied().unwrap_or(f64::NAN)
    }
}

/// Medians by turns; the second and later ones against the first.
fn compare(title: &str, calls: u32, cases: &mut [Case<'_>]) -> anyhow::Result<()> {
    for _ in 0..TURNS {
        for case in &mut *cases {
            let started = Instant::now();
            for _ in 0..calls {
                (case.run)()?;
            }
            case.turns_ns.push(started.elapsed().as_secs_f64() * 1e9 / f64::from(calls));
        }
    }
    println!("{title}");
    let mut first = None;
    for case in cases {
        let median = case.median_ns();
        let base = *first.get_or_insert(median);
        let (above, ratio) = (median - base, median / base);
        println!("  {:<34} {median:>9.1} ns   {above:>+9.1} ns   x {ratio:.3}", case.name);
    }
    Ok(())
}

fn main() -> anyhow::Result<()> {
    let bus = Arc::new(Memory::new("memory"));
    let context = Context::builder().only(bus.clone()).build();
    let data = vec![7_u8; 640 * 480 * 3];
    let frame = Image::new(Stamp::now(), RawPixels::dense(640, 480, Encoding::Bgr8, data)?);
    let robot = || Robot { calls: 0, frame: frame.clone() };

    let mut bare = robot();
    let (mut none, mut alone) =
        (robot().communicator_in(&context), robot().communicator_in(&context));
    none.activate(RobotMethod::Object, Mode::None)?;
    alone.activate(RobotMethod::Object, Mode::Publish)?;
    compare(
        "a call, nobody listens",
        CALLS,
        &mut [
            Case::new("the method", || {
                black_box(bare.object(black_box(1)));
                Ok(())
            }),
            Case::new("mode none", || {
                black_box(none.object(black_box(1))?);
                Ok(())
            }),
            Case::new("mode publish", || {
                black_box(alone.object(black_box(1))?);
                Ok(())
            }),
        ],
    )?;
    drop(alone);

    let ends = |topic: &str, kind| -> anyhow::Result<(Box<dyn Publisher>, Box<dyn Listener>)> {
        let (spec, context) = (TopicSpec::new(topic, kind), endpoint::Context::default());
        let listener = bus.open_listener(&spec, &context)?;
        Ok((bus.open_publisher(&spec, &context)?, listener))
    };
    let (mut here, mut there) =
        (robot().communicator_in(&context), robot().communicator_in(&context));
    for method in [RobotMethod::Object, RobotMethod::Image] {
        there.activate(method, Mode::Listen)?;
        here.activate(method, Mode::Publish)?;
    }
    // Opened, and known to be.
    there.object(0)?;
    there.image()?;
    while there.object(0)?.is_none() || there.image()?.is_none() {
        here.object(1)?;
        here.image()?;
    }
    while there.object(0)?.is_some() || there.image()?.is_some() {}

    let (mut publisher, mut listener) = ends("/raw/object", MessageType::NativeObject)?;
    let mut maker = robot();
    compare(
        "a small object, publish and listen",
        CALLS,
        &mut [
            Case::new("raw endpoint", || {
                publisher.publish(&Payload::from(maker.object(black_box(1))))?;
                black_box(listener.take()?);
                Ok(())
            }),
            Case::new("registered", || {
                black_box(here.object(black_box(1))?);
                black_box(there.object(0)?);
                Ok(())
            }),
        ],
    )?;
    let (mut publisher, mut listener) = ends("/raw/image", MessageType::Image)?;
    compare(
        "a frame of 640x480, publish and listen",
        CALLS,
        &mut [
            Case::new("raw endpoint", || {
                publisher.publish(&Payload::from(maker.image()))?;
                black_box(listener.take()?);
                Ok(())
            }),
            Case::new("registered", || {
                black_box(here.image()?);
                black_box(there.image()?);
                Ok(())
            }),
        ],
    )?;
    over_zeromq()
}

struct Speaker;

#[communicator]
impl Speaker {
    #[register(NativeObject, "zeromq", "/registered/said")]
    fn said(&self) -> Value {
        Value::Int(7)
    }
}

/// One message at a time, from publish to the listener that waits for it.
fn over_zeromq() -> anyhow::Result<()> {
    let embedded = ZeroMqConfig { pub_port: 0, sub_port: 0, ..ZeroMqConfig::default() };
    let one = Arc::new(ZeroMq::start(&embedded)?);
    let (pub_port, sub_port) = (one.pub_port(), one.sub_port());
    let foreign =
        ZeroMqConfig { pub_port, sub_port, broker: BrokerMode::Foreign, ..embedded.clone() };
    let other = Arc::new(ZeroMq::start(&foreign)?);
    let context = |middleware: &Arc<ZeroMq>| Context::builder().only(middleware.clone()).build();
    let mut here = Speaker.communicator_in(&context(&one));
    let mut there = Speaker.communicator_in(&context(&other));
    here.activate(SpeakerMethod::Said, Mode::Publish)?;
    there.activate(SpeakerMethod::Said, Mode::Listen)?;
    std::thread::scope(|scope| {
        let first = scope.spawn(|| there.said().map(drop));
        here.said()?;
        first.join().map_err(|_panic| anyhow::anyhow!("the listener panicked"))??;
        anyhow::Ok(())
    })?;

    let spec = TopicSpec::new("/raw/said", MessageType::NativeObject);
    let (out, into) = (endpoint::Context::default(), endpoint::Context::default());
    let mut listener = other.open_listener(&spec, &into)?;
    let mut publisher = one.open_publisher(&spec, &out)?;
    while publisher.link().peers == Some(0) {
        out.wake.wait(Duration::from_millis(10));
    }
    compare(
        "a small object over ZeroMQ, from publish to the one who waits",
        MESSAGES,
        &mut [
            Case::new("raw endpoint", || {
                publisher.publish(&Payload::from(Value::Int(7)))?;
                loop {
                    if let Some(sample) = listener.take()? {
                        black_box(sample);
                        return Ok(());
                    }
                    into.wake.wait(Duration::from_secs(1));
                }
            }),
            Case::new("registered", || {
                here.said()?;
                black_box(there.said()?);
                Ok(())
            }),
        ],
    )
}
