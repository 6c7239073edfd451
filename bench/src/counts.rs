//! Counts of what a message costs, the same on every machine: allocations, bytes allocated, system calls.
//!
//! ```text
//!   encode, decode     payload ◀─▶ frames of ZeroMQ, CDR            buffers of the size of a picture: one or none
//!   a route            publisher ─▶ /in ─▶ route ─▶ /out ─▶ listener    nothing is copied
//!   a hop of ZeroMQ    publisher ─▶ broker ─▶ listener              calls that write, of the whole process
//!   a route from it    publisher ─▶ broker ─▶ route ─▶ listener     times that the I/O thread is woken
//! ```
//!
//! `make check` fails where a count rises. Times are the benchmark's: they decide nothing here.

use std::alloc::System;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Result;
use bytes::Bytes;
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use wrapyfi_data::Limits;
use wrapyfi_data::types::{Dtype, Map, Payload, Stamp, Tensor, Value};
use wrapyfi_endpoint::codec::ros;
use wrapyfi_endpoint::memory::Memory;
use wrapyfi_endpoint::{Context, Middleware as _, Registry};
use wrapyfi_engine::{Engine, Plan, Route};
use wrapyfi_zeromq::{BrokerMode, ZeroMq, ZeroMqConfig, codec as frames};

use crate::engine::{Ends, wait_open};
use crate::payload::{Kind, Maker};

#[global_allocator]
static MEMORY: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// Messages over which a count is made.
const MESSAGES: usize = 200;

/// Allocations, and bytes allocated, of a message: of all threads, so that a test is to run in a process of its own.
#[derive(Debug, PartialEq, PartialOrd)]
struct Cost {
    allocations: f64,
    bytes: f64,
}

/// Mean over some messages, after one that makes what stays.
fn cost<T>(mut each: impl FnMut() -> Result<T>) -> Result<Cost> {
    each()?;
    let region = Region::new(MEMORY);
    for _ in 0..MESSAGES {
        each()?;
    }
    let spent = region.change();
    let mean = |count: usize| count as f64 / MESSAGES as f64;
    Ok(Cost {
        allocations: mean(spent.allocations + spent.reallocations),
        bytes: mean(spent.bytes_allocated),
    })
}

#[track_caller]
fn at_most(what: &str, cost: &Cost, allocations: f64, bytes: f64) {
    assert!(
        cost.allocations <= allocations && cost.bytes <= bytes,
        "{what}: {cost:?}, at most {allocations} allocations of {bytes} bytes"
    );
}

/// Bytes of an array, a picture or sound, and the allocations beside them that its kind has.
const CODED: [(Kind, f64); 5] = [
    (Kind::U8Rgb200, 120e3),
    (Kind::F32Mib, 1_048_576.0),
    (Kind::Audio, 35_280.0),
    (Kind::VgaRgb, 921_600.0),
    (Kind::FullHdRgb, 6_220_800.0),
];

#[test]
fn a_message_of_zeromq_takes_one_buffer_each_way() -> Result<()> {
    for (kind, size) in CODED {
        let maker = Maker::new(kind)?;
        let (spec, payload) = (maker.spec("/t"), maker.payload(1));
        let text: Vec<Bytes> =
            frames::encode(&payload, &spec)?.into_iter().map(Bytes::from).collect();
        let encoded = cost(|| Ok(frames::encode(&payload, &spec)?))?;
        // Base64 is a third longer than what it stands for.
        at_most(&format!("encode {}", kind.title()), &encoded, 64.0, size * 4.0 / 3.0 + 2048.0);
        let stamp = Stamp::default();
        let decoded = cost(|| Ok(frames::decode(&text, &spec, stamp)?))?;
        at_most(&format!("decode {}", kind.title()), &decoded, 32.0, size + 2048.0);
    }
    Ok(())
}

#[test]
fn a_text_with_two_arrays_is_not_moved() -> Result<()> {
    let array = |bytes: usize| -> Result<Value> {
        Ok(Tensor::new(Dtype::U8, [bytes], vec![7; bytes])?.into())
    };
    let map = Map::from([("rgb", array(600_000)?), ("depth", array(400_000)?)]);
    let (payload, spec) = (Payload::from(Value::from(map)), Maker::new(Kind::Small)?.spec("/t"));
    let encoded = cost(|| Ok(frames::encode(&payload, &spec)?))?;
    at_most("encode two arrays", &encoded, 64.0, 1e6 * 4.0 / 3.0 + 4096.0);
    Ok(())
}

#[test]
fn cdr_shares_the_memory_of_its_payload() -> Result<()> {
    let plugins = wrapyfi_plugins::standard();
    for (kind, _) in CODED {
        let maker = Maker::new(kind)?;
        let (payload, message_type) = (maker.payload(1), kind.message_type());
        let body = Bytes::from(maker.cdr()?.body);
        let encoded = cost(|| Ok(ros::encode(&payload, message_type, &plugins)?))?;
        at_most(&format!("encode {}", kind.title()), &encoded, 24.0, 2048.0);
        let limits = Limits::default();
        let decoded = cost(|| Ok(ros::decode(&body, message_type, &limits, &plugins)?))?;
        at_most(&format!("decode {}", kind.title()), &decoded, 24.0, 2048.0);
    }
    Ok(())
}

#[test]
fn a_route_copies_nothing() -> Result<()> {
    for kind in [Kind::Small, Kind::VgaRgb] {
        let payload = Maker::new(kind)?.payload(1);
        let bus = Arc::new(Memory::new("memory"));
        let mut registry = Registry::new();
        registry.register(bus.clone());
        let route =
            Route::topic("memory:/in".parse()?, "memory:/out".parse()?, kind.message_type());
        let running = Engine::new(Plan { routes: vec![route] }, &registry).start()?;
        let mut ends = Ends::open(&bus, kind)?;
        wait_open(&mut ends, &payload)?;
        let routed = cost(|| {
            ends.publisher.publish(&payload)?;
            ends.take()
        })?;
        at_most(&format!("a route of {}", kind.title()), &routed, 24.0, 3072.0);
        drop(running.stop());
    }
    Ok(())
}

/// Calls of this process that write, as the system counts them.
fn writes() -> Result<usize> {
    let counts = std::fs::read_to_string("/proc/self/io")?;
    let count = counts.lines().find_map(|line| line.strip_prefix("syscw: "));
    Ok(count.unwrap_or_default().parse()?)
}

/// A broker, and two instances at it. Whoever has the broker writes into it directly, and nobody hears his own.
fn instances() -> Result<[ZeroMq; 3]> {
    let side = |broker, pub_port, sub_port| {
        ZeroMq::start(&ZeroMqConfig { broker, pub_port, sub_port, ..ZeroMqConfig::default() })
    };
    let broker = side(BrokerMode::Embedded, 0, 0)?;
    let (pub_port, sub_port) = (broker.pub_port(), broker.sub_port());
    let at_it = || side(BrokerMode::Foreign, pub_port, sub_port);
    Ok([broker, at_it()?, at_it()?])
}

#[test]
fn a_hop_of_zeromq_writes_once_to_the_broker_and_once_to_the_listener() -> Result<()> {
    let [_broker, talks, listens] = instances()?;
    let (maker, context) = (Maker::new(Kind::Small)?, Context::default());
    let mut ends = Ends {
        listener: listens.open_listener(&maker.spec("/t"), &context)?,
        publisher: talks.open_publisher(&maker.spec("/t"), &Context::default())?,
        context,
    };
    let payload = maker.payload(1);
    wait_open(&mut ends, &payload)?;
    let before = writes()?;
    let hop = cost(|| {
        ends.publisher.publish(&payload)?;
        ends.take()
    })?;
    let calls = (writes()? - before) as f64 / (MESSAGES + 1) as f64;
    at_most("a hop of ZeroMQ", &hop, 64.0, 6144.0);
    // One more for some of them is a thread that was woken because it was late.
    assert!(calls < 2.9, "{calls} calls that write for each message");
    Ok(())
}

/// Number of times that threads of this name had to wait, as the system counts them.
fn waits(thread: &str) -> Result<usize> {
    let mut all = 0;
    for task in std::fs::read_dir("/proc/self/task")? {
        let status = std::fs::read_to_string(task?.path().join("status"))?;
        let value = |key: &str| status.lines().find_map(|line| line.strip_prefix(key));
        if value("Name:").is_some_and(|name| name.trim() == thread) {
            all += value("voluntary_ctxt_switches:").unwrap_or_default().trim().parse::<usize>()?;
        }
    }
    Ok(all)
}

#[test]
fn a_lonely_message_of_zeromq_is_read_by_the_worker_of_its_route() -> Result<()> {
    let [_broker, talks, bridges] = instances()?;
    let (bus, kind) = (Arc::new(Memory::new("memory")), Kind::Small);
    let mut registry = Registry::new();
    registry.register(bus.clone());
    registry.register(Arc::new(bridges));
    let route = Route::topic("zeromq:/in".parse()?, "memory:/out".parse()?, kind.message_type());
    let running = Engine::new(Plan { routes: vec![route] }, &registry).start()?;
    let maker = Maker::new(kind)?;
    let mut ends = Ends::open(&bus, kind)?;
    ends.publisher = talks.open_publisher(&maker.spec("/in"), &Context::default())?;
    let payload = maker.payload(1);
    wait_open(&mut ends, &payload)?;
    let mut waited = 0;
    for message in 0..MESSAGES {
        if message == 10 {
            waited = waits("zeromq-io")?;
        }
        ends.publisher.publish(&payload)?;
        ends.take()?;
        // The worker is at rest again, as between two messages that are alone.
        std::thread::sleep(Duration::from_millis(1));
    }
    // It sleeps once where it is woken once; now and then it looks by itself.
    let woken = (waits("zeromq-io")? - waited) as f64 / (MESSAGES - 10) as f64;
    assert!(woken < 0.6, "the I/O thread was woken {woken} times a message");
    // The worker has the connection at this moment, and it ends all the same.
    drop(running.stop());
    let begin = Instant::now();
    while ends.publisher.link().peers != Some(0) {
        anyhow::ensure!(begin.elapsed() < Duration::from_secs(20), "a route that is still heard");
        std::thread::sleep(Duration::from_millis(1));
    }
    Ok(())
}
