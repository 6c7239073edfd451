//! Two hundred YARP ports with nothing to do, alone in their process.
#![allow(clippy::unwrap_used)]
#![cfg(target_os = "linux")]

use std::time::{Duration, Instant};

use wrapyfi_data::types::MessageType;
use wrapyfi_endpoint::{CauseCode, Context, Link, Middleware, TopicSpec};
use wrapyfi_yarp_endpoint::{Yarp, YarpConfig};

#[test]
fn idle_ports_cost_nothing() {
    let name_server = Some(std::net::SocketAddr::from(([127, 0, 0, 1], 0)).into());
    let config = YarpConfig { name_server, embedded: true, ..YarpConfig::default() };
    let yarp = Yarp::start(&config).unwrap();
    let context = Context::default();
    let spec = |n| TopicSpec::new(format!("/idle/{n}"), MessageType::NativeObject);
    let sources: Vec<_> =
        (0..100).map(|n| yarp.open_publisher(&spec(n), &context).unwrap()).collect();
    let sinks: Vec<_> =
        (100..200).map(|n| yarp.open_listener(&spec(n), &context).unwrap()).collect();
    let waits = |link: Link, code| link.waiting_for.is_some_and(|why| why.code() == code);
    let deadline = Instant::now() + Duration::from_secs(60);
    while !(sources.iter().all(|source| waits(source.link(), CauseCode::NobodyListens))
        && sinks.iter().all(|sink| waits(sink.link(), CauseCode::NotOpened)))
    {
        assert!(Instant::now() < deadline, "the ports do not open");
        context.wake.wait(Duration::from_millis(10));
    }
    let before = cpu_ticks();
    std::thread::sleep(Duration::from_secs(2));
    let took = cpu_ticks() - before;
    // A tick is 10 ms: 200 ports that looked five times a second would take dozens.
    assert!(took <= 10, "{took} ticks in two seconds");
}

/// Time of the processor that this process has had, in ticks.
fn cpu_ticks() -> u64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap();
    let after_name = stat.rsplit_once(") ").unwrap().1;
    let fields: Vec<&str> = after_name.split(' ').collect();
    let field = |at: usize| fields.get(at).unwrap().parse::<u64>().unwrap();
    field(11) + field(12)
}
