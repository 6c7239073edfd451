//! Cost of a registered method above the method and above the raw endpoint.
//!
//! ```text
//!   call      the method itself ─ mode none ─ publish, nobody listens         by turns
//!   message   raw endpoint: publish, take ─ registered: publish, listen       by turns
//! ```
//!
//! On the memory middleware nothing but the library is measured; on ZeroMQ, through our broker, a
//! message costs what it costs in a program. Both ends are in this process.

use std::hint::black_box;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Result, anyhow};
use wrapyfi_core::communicator::{CommunicatorContext, Mode, communicator};
use wrapyfi_core::endpoint::{self, Listener, Middleware as _, Publisher, TopicSpec};
use wrapyfi_core::middleware::memory::Memory;
use wrapyfi_core::middleware::zeromq::{BrokerMode, ZeroMq, ZeroMqConfig};
use wrapyfi_core::types::{Encoding, Image, MessageType, Payload, RawPixels, Stamp, Value};

use crate::micro::Figure;
use crate::stats::median;

/// Names of the figures.
pub(crate) const METHOD: &str = "registered, a small value: the method itself";
pub(crate) const NONE: &str = "registered, a small value: mode none";
pub(crate) const UNHEARD: &str = "registered, a small value: mode publish, nobody listens";
pub(crate) const RAW_SMALL: &str = "registered, a small object in memory: raw publish and take";
pub(crate) const SMALL: &str = "registered, a small object in memory: publish and listen";
pub(crate) const RAW_FRAME: &str = "registered, 640x480 RGB in memory: raw publish and take";
pub(crate) const FRAME: &str = "registered, 640x480 RGB in memory: publish and listen";
pub(crate) const RAW_ZMQ: &str = "registered, a small object over ZeroMQ: raw publish and take";
pub(crate) const ZMQ: &str = "registered, a small object over ZeroMQ: publish and listen";

/// Turns of each case in a round.
const SWEEPS: u32 = 9;
/// Calls of one turn, in memory and over ZeroMQ.
const CALLS: u32 = 5000;
const MESSAGES: u32 = 300;

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

struct Speaker;

#[communicator]
impl Speaker {
    #[register(NativeObject, "zeromq", "/registered/said")]
    fn said(&self) -> Value {
        Value::Int(7)
    }
}

/// One way to do something: its name, and the thing done once.
type Way<'a> = (&'static str, &'a mut dyn FnMut() -> Result<()>);

/// Microseconds that each way takes: medians of turns that alternate, every other sweep backwards.
fn by_turns(calls: u32, ways: &mut [Way<'_>]) -> Result<Vec<Figure>> {
    let mut times = vec![Vec::new(); ways.len()];
    for sweep in 0..SWEEPS {
        let mut order: Vec<usize> = (0..ways.len()).collect();
        if sweep % 2 == 1 {
            order.reverse();
        }
        for at in order {
            let (Some((_, way)), Some(times)) = (ways.get_mut(at), times.get_mut(at)) else {
                continue;
            };
            let started = Instant::now();
            for _ in 0..calls {
                way()?;
            }
            times.push(started.elapsed().as_secs_f64() * 1e6 / f64::from(calls));
        }
    }
    let medians = times.iter().map(|times| median(times).unwrap_or(f64::NAN));
    Ok(ways.iter().zip(medians).map(|((name, _), median)| ((*name).to_owned(), median)).collect())
}

/// All figures of one round, in microseconds.
pub(crate) fn round() -> Result<Vec<Figure>> {
    let mut figures = in_memory()?;
    figures.extend(over_zeromq()?);
    Ok(figures)
}

fn in_memory() -> Result<Vec<Figure>> {
    let bus = Arc::new(Memory::new("memory"));
    let context = CommunicatorContext::builder().only(bus.clone()).build();
    let data = vec![7_u8; 640 * 480 * 3];
    let frame = Image::new(Stamp::now(), RawPixels::dense(640, 480, Encoding::Bgr8, data)?);
    let robot = || Robot { calls: 0, frame: frame.clone() };

    let mut bare = robot();
    let (mut none, mut alone) =
        (robot().communicator_in(&context), robot().communicator_in(&context));
    none.activate(RobotMethod::Object, Mode::None)?;
    alone.activate(RobotMethod::Object, Mode::Publish)?;
    let mut method = || {
        black_box(bare.object(black_box(1)));
        Ok(())
    };
    let mut plain = || {
        black_box(none.object(black_box(1))?);
        Ok(())
    };
    let mut unheard = || {
        black_box(alone.object(black_box(1))?);
        Ok(())
    };
    let ways: &mut [Way<'_>] =
        &mut [(METHOD, &mut method), (NONE, &mut plain), (UNHEARD, &mut unheard)];
    let mut figures = by_turns(CALLS, ways)?;
    drop(alone);

    let ends = |topic: &str, kind| -> Result<(Box<dyn Publisher>, Box<dyn Listener>)> {
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
    let mut raw = || {
        publisher.publish(&Payload::from(maker.object(black_box(1))))?;
        black_box(listener.take()?);
        Ok(())
    };
    let mut registered = || {
        black_box(here.object(black_box(1))?);
        black_box(there.object(0)?);
        Ok(())
    };
    let ways: &mut [Way<'_>] = &mut [(RAW_SMALL, &mut raw), (SMALL, &mut registered)];
    figures.extend(by_turns(CALLS, ways)?);

    let (mut publisher, mut listener) = ends("/raw/image", MessageType::Image)?;
    let mut raw = || {
        publisher.publish(&Payload::from(maker.image()))?;
        black_box(listener.take()?);
        Ok(())
    };
    let mut registered = || {
        black_box(here.image()?);
        black_box(there.image()?);
        Ok(())
    };
    let ways: &mut [Way<'_>] = &mut [(RAW_FRAME, &mut raw), (FRAME, &mut registered)];
    figures.extend(by_turns(CALLS, ways)?);
    Ok(figures)
}

/// One message at a time, from publish to the listener that waits for it.
fn over_zeromq() -> Result<Vec<Figure>> {
    let embedded = ZeroMqConfig { pub_port: 0, sub_port: 0, ..ZeroMqConfig::default() };
    let one = Arc::new(ZeroMq::start(&embedded)?);
    let (pub_port, sub_port) = (one.pub_port(), one.sub_port());
    let foreign =
        ZeroMqConfig { pub_port, sub_port, broker: BrokerMode::Foreign, ..embedded.clone() };
    let other = Arc::new(ZeroMq::start(&foreign)?);
    let context =
        |middleware: &Arc<ZeroMq>| CommunicatorContext::builder().only(middleware.clone()).build();
    let mut here = Speaker.communicator_in(&context(&one));
    let mut there = Speaker.communicator_in(&context(&other));
    here.activate(SpeakerMethod::Said, Mode::Publish)?;
    there.activate(SpeakerMethod::Said, Mode::Listen)?;
    std::thread::scope(|scope| {
        let first = scope.spawn(|| there.said().map(drop));
        here.said()?;
        first.join().map_err(|_panic| anyhow!("the listener panicked"))??;
        anyhow::Ok(())
    })?;

    let spec = TopicSpec::new("/raw/said", MessageType::NativeObject);
    let (out, into) = (endpoint::Context::default(), endpoint::Context::default());
    let mut listener = other.open_listener(&spec, &into)?;
    let mut publisher = one.open_publisher(&spec, &out)?;
    while publisher.link().peers == Some(0) {
        out.wake.wait(Duration::from_millis(10));
    }
    let mut raw = || {
        publisher.publish(&Payload::from(Value::Int(7)))?;
        loop {
            if let Some(sample) = listener.take()? {
                black_box(sample);
                return Ok(());
            }
            into.wake.wait(Duration::from_secs(1));
        }
    };
    let mut registered = || {
        here.said()?;
        black_box(there.said()?);
        Ok(())
    };
    by_turns(MESSAGES, &mut [(RAW_ZMQ, &mut raw), (ZMQ, &mut registered)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_way_has_its_turns_and_its_name() {
        let (mut one, mut two) = (0, 0);
        let mut first = || {
            one += 1;
            Ok(())
        };
        let mut second = || {
            two += 1;
            Ok(())
        };
        let figures = by_turns(2, &mut [(METHOD, &mut first), (NONE, &mut second)]).unwrap();
        let names: Vec<&str> = figures.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(names, [METHOD, NONE]);
        assert_eq!((one, two), (2 * SWEEPS, 2 * SWEEPS));
    }

    #[test]
    fn memory_has_a_figure_for_each_way() {
        let figures = in_memory().unwrap();
        let names: Vec<&str> = figures.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(names, [METHOD, NONE, UNHEARD, RAW_SMALL, SMALL, RAW_FRAME, FRAME]);
        assert!(figures.iter().all(|(_, micros)| *micros >= 0.0), "{figures:?}");
    }
}
