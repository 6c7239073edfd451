//! The graph on the rmw of an installed ROS 2: with itself, and beside CycloneDDS inside the program.
//!
//! Runs under whatever `RMW_IMPLEMENTATION` says, in a network namespace with nothing but loopback.
#![cfg(feature = "rmw")]
// In helpers of tests, too, a panic is the right answer.
#![allow(clippy::unwrap_used, clippy::indexing_slicing, clippy::panic)]

mod ros2_common;

use std::sync::Arc;

use wrapyfi_core::endpoint::{Durability, History, QosPreset, Reliability, Wake};
use wrapyfi_core::middleware::ros2::graph::{
    CdrSample, Graph, GraphError, Peers, ServiceDescription, wait_until,
};
use wrapyfi_core::middleware::ros2::{CycloneConfig, CycloneGraph, RmwGraph};

use ros2_common::{
    Ends, HASH, PATIENCE, bell, connect, domain, message, name, next, pattern, topic, write,
};

fn config(node: &str, test: u32) -> CycloneConfig {
    CycloneConfig::loopback(name(node), domain(test))
}

fn on_rmw(node: &str, test: u32) -> RmwGraph {
    RmwGraph::new(&config(node, test), "/").unwrap()
}

/// The text of a message; what a middleware pads it with is passed over.
fn text(sample: &CdrSample) -> &[u8] {
    assert_eq!(sample.cdr[..4], [0, 1, 0, 0]);
    let length = u32::from_le_bytes(sample.cdr[4..8].try_into().unwrap()) as usize;
    &sample.cdr[8..8 + length - 1]
}

fn exchange(a: &dyn Graph, b: &dyn Graph) {
    let mut chatter = topic("/chatter");
    // Sizes that no queue of DDS holds ten of at once are sent one by one.
    chatter.qos.history = History::KeepLast(1);
    for (from, to) in [(a, b), (b, a)] {
        let mut ends = connect(from, to, &chatter);
        for size in [0, 1, 2, 3, 1500, 65_600, 1 << 20, 6_220_800] {
            let sent = pattern(size);
            write(&mut *ends.writer, &sent).unwrap();
            let got = next(&mut *ends.reader, &ends.wake);
            assert!(text(&got) == sent, "{size} bytes changed");
            assert!(got.source_timestamp_ns > 1_500_000_000_000_000_000);
            let gid = ends.reader.publisher_gid(got.publisher).unwrap();
            let peers = to.endpoints().unwrap();
            let peer = peers.iter().find(|peer| peer.gid == gid).unwrap();
            assert!(peer.is_publisher && !peer.is_own, "{peer:?}");
            assert_eq!((peer.topic.as_str(), peer.type_hash.as_deref()), ("/chatter", Some(HASH)));
        }
        assert_eq!(ends.reader.lost(), 0);
    }
}

#[test]
fn messages_of_all_sizes_go_both_ways() {
    exchange(&on_rmw("a", 0), &on_rmw("b", 0));
}

#[test]
fn messages_reach_cyclone_and_come_from_there() {
    exchange(&on_rmw("a", 1), &CycloneGraph::new(&config("b", 1)).unwrap());
}

#[test]
fn a_late_reader_gets_what_is_kept() {
    let (a, b) = (on_rmw("a", 2), on_rmw("b", 2));
    let mut latched = topic("/latched");
    latched.qos = QosPreset::Latched.into();
    latched.qos.history = History::KeepLast(3);
    let wake = Wake::new();
    let mut writer = a.advertise(&latched, bell(&wake)).unwrap();
    for n in 0..5_u8 {
        write(&mut *writer, &[b'0' + n]).unwrap();
    }
    let mut reader = b.subscribe(&latched, bell(&wake)).unwrap();
    for n in 2..5_u8 {
        assert_eq!(text(&next(&mut *reader, &wake)), [b'0' + n]);
    }
    assert_eq!(reader.take().unwrap(), None);
}

#[test]
fn a_node_does_not_hear_itself() {
    let (a, b) = (on_rmw("a", 3), on_rmw("b", 3));
    let chatter = topic("/chatter");
    let wake = Wake::new();
    let mut own = a.subscribe(&chatter, bell(&wake)).unwrap();
    let mut ends = connect(&a, &b, &chatter);
    write(&mut *ends.writer, b"x").unwrap();
    assert_eq!(text(&next(&mut *ends.reader, &ends.wake)), b"x");
    assert_eq!((own.matched(), own.take().unwrap()), (0, None));
}

#[test]
fn matches_come_and_go_and_are_watched() {
    let (a, b) = (on_rmw("a", 4), on_rmw("b", 4));
    let chatter = topic("/chatter");
    let wake = Wake::new();
    let watch = a.watch("/chatter", false, bell(&wake)).unwrap();
    let Ends { wake: matches, writer, reader } = connect(&a, &b, &chatter);
    assert!(wait_until(&wake, PATIENCE, || watch.peers().len() == 1));
    let before = watch.changes();
    let second = b.subscribe(&chatter, bell(&matches)).unwrap();
    assert!(wait_until(&matches, PATIENCE, || writer.matched() == 2));
    assert!(wait_until(&wake, PATIENCE, || watch.peers().len() == 2 && watch.changes() > before));
    let mut nodes = a.nodes().unwrap();
    nodes.update();
    assert_eq!(nodes.owner(&watch.peers()[0].gid), Some("/robot/b"));
    drop((reader, second));
    assert!(wait_until(&matches, PATIENCE, || writer.matched() == 0));
    assert!(wait_until(&wake, PATIENCE, || watch.peers().is_empty()));
}

#[test]
fn who_does_not_fit_is_told_why() {
    let (a, b) = (on_rmw("a", 5), on_rmw("b", 5));
    let mut effort = topic("/chatter");
    effort.qos.reliability = Reliability::BestEffort;
    let wake = Wake::new();
    let writer = a.advertise(&effort, bell(&wake)).unwrap();
    let reader = b.subscribe(&topic("/chatter"), bell(&wake)).unwrap();
    assert!(wait_until(&wake, PATIENCE, || {
        [writer.incompatible(), reader.incompatible()] == [Some("reliability"); 2]
    }));
    let mut kept = topic("/kept");
    let _writer = a.advertise(&kept, bell(&wake)).unwrap();
    kept.qos.durability = Durability::TransientLocal;
    let reader = b.subscribe(&kept, bell(&wake)).unwrap();
    assert!(wait_until(&wake, PATIENCE, || reader.incompatible() == Some("durability")));
}

#[test]
fn what_is_too_large_is_named_and_the_next_one_comes() {
    let (a, b) = (on_rmw("a", 6), on_rmw("b", 6));
    let mut small = topic("/small");
    small.max_bytes = 100;
    let mut ends = connect(&a, &b, &small);
    write(&mut *ends.writer, &pattern(1000)).unwrap();
    let mut refused = None;
    assert!(wait_until(&ends.wake, PATIENCE, || {
        refused = ends.reader.take().err();
        refused.is_some()
    }));
    let GraphError::TooLarge { topic, actual, limit } = refused.unwrap() else { panic!("other") };
    assert_eq!((topic.as_str(), limit), ("/small", 100));
    assert!((1000..1020).contains(&actual), "{actual}");
    write(&mut *ends.writer, b"next").unwrap();
    assert_eq!(text(&next(&mut *ends.reader, &ends.wake)), b"next");
}

#[test]
fn services_of_a_type_that_nobody_defines_carry_megabytes() {
    let (a, b) = (on_rmw("a", 7), on_rmw("b", 7));
    let service = ServiceDescription {
        name: "/turn".into(),
        type_name: "nowhere_interfaces/srv/Turn".into(),
        request_hash: Some(HASH.into()),
        response_hash: None,
        depth: 10,
        max_bytes: 64 << 20,
    };
    let wake = Wake::new();
    let mut client = a.client(&service, bell(&wake)).unwrap();
    assert_eq!(client.servers(), Peers::None);
    let mut server = b.server(&service, bell(&wake)).unwrap();
    assert!(wait_until(&wake, PATIENCE, || client.servers() == Peers::Ready(1)));
    for bytes in [0, 1, 200_000, 32 << 20] {
        let parts = message(&pattern(bytes));
        let parts: Vec<&[u8]> = parts.iter().map(Vec::as_slice).collect();
        let sequence = client.send(&parts).unwrap();
        let mut request = None;
        assert!(wait_until(&wake, PATIENCE, || {
            request = server.take().unwrap();
            request.is_some()
        }));
        let request = request.unwrap();
        assert!(request.cdr.starts_with(&parts.concat()), "{bytes} bytes changed");
        server.reply(&request.id, &[&request.cdr]).unwrap();
        let mut reply = None;
        assert!(wait_until(&wake, PATIENCE, || {
            reply = client.take().unwrap();
            reply.is_some()
        }));
        let reply = reply.unwrap();
        assert_eq!(reply.sequence, sequence);
        assert!(reply.cdr.starts_with(&request.cdr), "{bytes} bytes changed");
    }
    drop(server);
    assert!(wait_until(&wake, PATIENCE, || client.servers() == Peers::None));
}

#[test]
fn a_node_that_is_dropped_leaves_nothing_behind() {
    let ours = || {
        let tasks = std::fs::read_dir("/proc/self/task").unwrap().flatten();
        let names = tasks.filter_map(|task| std::fs::read_to_string(task.path().join("comm")).ok());
        names.filter(|name| name.starts_with("rmw-")).count()
    };
    let watcher = on_rmw("b", 8);
    let wake = Wake::new();
    // A thread has its name a moment after it has begun.
    assert!(wait_until(&wake, PATIENCE, || ours() == 2));
    for _ in 0..3 {
        let graph = on_rmw("a", 8);
        let kept: Arc<dyn Graph> = Arc::new(graph.clone());
        let _reader = kept.subscribe(&topic("/chatter"), bell(&wake)).unwrap();
        // The last share of the node may be dropped by a thread of its own.
        let _watch = kept.watch("/chatter", true, Arc::new(move || drop(graph.clone()))).unwrap();
        let is_there = || watcher.endpoints().unwrap().iter().any(|one| one.topic == "/chatter");
        assert!(wait_until(&wake, PATIENCE, is_there));
    }
    assert!(wait_until(&wake, PATIENCE, || ours() == 2));
    assert!(wait_until(&wake, PATIENCE, || {
        !watcher.endpoints().unwrap().iter().any(|one| one.topic == "/chatter")
    }));
}
