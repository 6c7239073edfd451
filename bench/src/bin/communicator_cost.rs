//! What a registered method costs above the method and above the raw endpoint.
//!
//! ```text
//!   call      the method itself ─ mode none ─ publish, nobody listens        ns a call
//!   message   raw endpoint: publish, take ─ registered: publish, listen      ns a message, by turns
//! ```
//!
//! Everything is in one process on the memory middleware, so that nothing but the library is
//! measured: a real transport only makes its share smaller. `cargo run --release -p wrapyfi_bench
//! --bin communicator_cost` prints medians of turns that alternate.

#![allow(clippy::print_stdout, reason = "a program for the terminal")]

use std::hint::black_box;
use std::sync::Arc;
use std::time::Instant;

use wrapyfi_core::communicator::{Context, Mode, communicator};
use wrapyfi_core::endpoint::{self, Listener, Middleware as _, Publisher, TopicSpec};
use wrapyfi_core::middleware::memory::Memory;
use wrapyfi_core::types::{Encoding, Image, MessageType, Payload, RawPixels, Stamp, Value};

/// Calls or messages of one turn.
const CALLS: u32 = 20_000;
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
fn compare(title: &str, cases: &mut [Case<'_>]) -> anyhow::Result<()> {
    for _ in 0..TURNS {
        for case in &mut *cases {
            let started = Instant::now();
            for _ in 0..CALLS {
                (case.run)()?;
            }
            case.turns_ns.push(started.elapsed().as_secs_f64() * 1e9 / f64::from(CALLS));
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
    let (mut none, mut alone) = (robot().communicator_in(&context), robot().communicator_in(&context));
    none.activate(RobotMethod::Object, Mode::None)?;
    alone.activate(RobotMethod::Object, Mode::Publish)?;
    compare(
        "a call, nobody listens",
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
    let (mut here, mut there) = (robot().communicator_in(&context), robot().communicator_in(&context));
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
    )
}
