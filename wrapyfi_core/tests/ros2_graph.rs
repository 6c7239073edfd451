//! Serialised messages and matching on CycloneDDS, between two nodes.
#![cfg(feature = "ros2")]
// In helpers of tests, too, a panic is the right answer.
#![allow(clippy::unwrap_used, clippy::indexing_slicing, clippy::panic)]

mod ros2_common;

use wrapyfi_core::endpoint::{Durability, History, QosPreset, Reliability, Wake};
use wrapyfi_core::middleware::ros2::CycloneGraph;
use wrapyfi_core::middleware::ros2::graph::{Graph, GraphError, wait_until};

use ros2_common::{
    Ends, HASH, PATIENCE, bell, connect, far, far_config, near, next, pattern, text, topic, write,
};

fn exchange(a: &CycloneGraph, b: &CycloneGraph) {
    let chatter = topic("/chatter");
    for (from, to) in [(a, b), (b, a)] {
        let mut ends = connect(from, to, &chatter);
        for size in [0, 1, 2, 3, 1500, 63_990, 64_010, 65_600, 1 << 20, 6_220_800] {
            let sent = pattern(size);
            write(&mut *ends.writer, &sent).unwrap();
            let got = next(&mut *ends.reader, &ends.wake);
            assert!(text(&got) == sent, "{size} bytes changed");
            assert!(got.source_timestamp_ns > 1_500_000_000_000_000_000);
        }
        assert_eq!(ends.reader.lost(), 0);
    }
}

#[test]
fn messages_of_all_sizes_go_both_ways_in_one_stack() {
    exchange(&near("a", 0), &near("b", 0));
}

#[test]
fn messages_of_all_sizes_go_both_ways_over_loopback() {
    exchange(&near("a", 1), &far("b", 1));
}

#[test]
fn a_late_reader_gets_what_is_kept() {
    let (a, b) = (near("a", 2), far("b", 2));
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
    let (a, b) = (near("a", 3), near("b", 3));
    let chatter = topic("/chatter");
    let wake = Wake::new();
    let mut own = a.subscribe(&chatter, bell(&wake)).unwrap();
    let mut ends = connect(&a, &b, &chatter);
    write(&mut *ends.writer, b"x").unwrap();
    assert_eq!(text(&next(&mut *ends.reader, &ends.wake)), b"x");
    assert_eq!((own.matched(), own.take().unwrap()), (0, None));
}

#[test]
fn matches_come_and_go() {
    let (a, b) = (near("a", 4), far("b", 4));
    let chatter = topic("/chatter");
    let Ends { wake, writer, reader } = connect(&a, &b, &chatter);
    let second = b.subscribe(&chatter, bell(&wake)).unwrap();
    assert!(wait_until(&wake, PATIENCE, || writer.matched() == 2));
    drop(reader);
    assert!(wait_until(&wake, PATIENCE, || writer.matched() == 1));
    drop(second);
    assert!(wait_until(&wake, PATIENCE, || writer.matched() == 0));
    let third = b.subscribe(&chatter, bell(&wake)).unwrap();
    assert!(wait_until(&wake, PATIENCE, || third.matched() == 1));
    drop(writer);
    assert!(wait_until(&wake, PATIENCE, || third.matched() == 0));
}

#[test]
fn another_type_does_not_match_and_is_listed_with_its_hash() {
    let (a, b) = (near("a", 5), far("b", 5));
    let wake = Wake::new();
    let mut other = topic("/chatter");
    other.type_name = "std_msgs/msg/Int32".into();
    let writer = a.advertise(&topic("/chatter"), bell(&wake)).unwrap();
    let reader = b.subscribe(&other, bell(&wake)).unwrap();
    let seen =
        || b.endpoints().unwrap().into_iter().find(|e| e.is_publisher && e.topic == "/chatter");
    assert!(wait_until(&wake, PATIENCE, || seen().is_some()));
    let seen = seen().unwrap();
    assert_eq!(seen.type_name, "std_msgs/msg/String");
    assert_eq!(seen.type_hash.as_deref(), Some(HASH));
    assert_eq!(seen.gid[..12], a.gid()[..12]);
    assert_eq!((writer.matched(), reader.matched()), (0, 0));
}

#[test]
fn incompatible_quality_of_service_names_its_policy() {
    let (a, b) = (near("a", 6), far("b", 6));
    let wake = Wake::new();
    let mut offered = topic("/best_effort");
    offered.qos.reliability = Reliability::BestEffort;
    let writer = a.advertise(&offered, bell(&wake)).unwrap();
    let reader = b.subscribe(&topic("/best_effort"), bell(&wake)).unwrap();
    assert!(wait_until(&wake, PATIENCE, || {
        writer.incompatible() == Some("reliability") && reader.incompatible() == Some("reliability")
    }));
    let offered = topic("/volatile");
    let mut asked = offered.clone();
    asked.qos.durability = Durability::TransientLocal;
    let writer = a.advertise(&offered, bell(&wake)).unwrap();
    let reader = b.subscribe(&asked, bell(&wake)).unwrap();
    assert!(wait_until(&wake, PATIENCE, || {
        writer.incompatible() == Some("durability") && reader.incompatible() == Some("durability")
    }));
    assert_eq!((writer.matched(), reader.matched()), (0, 0));
}

#[test]
fn a_message_over_the_limit_is_refused_and_the_next_one_comes() {
    let (a, b) = (near("a", 7), far("b", 7));
    let mut small = topic("/small");
    small.max_bytes = 1000;
    let Ends { wake, mut writer, mut reader } = connect(&a, &b, &small);
    write(&mut *writer, &pattern(991)).unwrap();
    write(&mut *writer, &pattern(992)).unwrap();
    write(&mut *writer, b"after").unwrap();
    assert_eq!(text(&next(&mut *reader, &wake)).len(), 991);
    let mut fault = None;
    assert!(wait_until(&wake, PATIENCE, || {
        fault = reader.take().err();
        fault.is_some()
    }));
    assert_eq!(
        fault,
        Some(GraphError::TooLarge { topic: "rt/small".into(), actual: 1004, limit: 1000 })
    );
    assert_eq!(text(&next(&mut *reader, &wake)), b"after");
}

#[test]
fn a_message_far_over_the_limit_is_discarded_by_its_header() {
    let mut config = far_config("b", 10);
    config.max_message_bytes = 25_000;
    let (a, b) = (near("a", 10), CycloneGraph::new(&config).unwrap());
    for size in [100_001, 6_000_000] {
        let Ends { wake, mut writer, mut reader } = connect(&a, &b, &topic("/chatter"));
        write(&mut *writer, &pattern(size)).unwrap();
        write(&mut *writer, &pattern(99_000)).unwrap();
        assert_eq!(text(&next(&mut *reader, &wake)).len(), 99_000);
    }
}

#[test]
fn one_reader_that_is_not_taken_from_stops_nobody() {
    let (a, b) = (near("a", 8), far("b", 8));
    let mut kept = topic("/kept");
    kept.qos.history = History::KeepAll;
    let mut slow = connect(&a, &b, &kept);
    let mut quick = connect(&a, &b, &topic("/quick"));
    for n in 0..200_u32 {
        write(&mut *slow.writer, &n.to_le_bytes().repeat(5_000)).unwrap();
        write(&mut *quick.writer, b"quick").unwrap();
        assert_eq!(text(&next(&mut *quick.reader, &quick.wake)), b"quick");
    }
    for n in 0..200_u32 {
        assert!(text(&next(&mut *slow.reader, &slow.wake)).starts_with(&n.to_le_bytes()));
    }
}

#[test]
fn messages_outlive_everything_they_came_through() {
    let (a, b) = (near("a", 9), near("b", 9));
    let mut ends = connect(&a, &b, &topic("/chatter"));
    let sent = pattern(100_000);
    write(&mut *ends.writer, &sent).unwrap();
    let kept = next(&mut *ends.reader, &ends.wake);
    drop((ends, a, b));
    assert!(std::thread::spawn(move || text(&kept)).join().unwrap() == sent);
}

#[test]
fn a_watch_hears_of_its_own_side_of_its_own_topic() {
    let (a, b) = (near("a", 13), far("b", 13));
    let wake = Wake::new();
    let watch = a.watch("/watched", true, bell(&wake)).unwrap();
    let before = watch.changes();
    let ignored = Wake::new();
    let others: Vec<_> = (0..100)
        .map(|n| b.advertise(&topic(&format!("/other{n}")), bell(&ignored)).unwrap())
        .collect();
    let _own = a.advertise(&topic("/watched"), bell(&ignored)).unwrap();
    let _other_side = b.subscribe(&topic("/watched"), bell(&ignored)).unwrap();
    // Discovery of a participant keeps its order: when this one is known, all are.
    let mut strict = topic("/watched");
    strict.qos.deadline = Some(std::time::Duration::from_millis(250));
    let writer = b.advertise(&strict, bell(&ignored)).unwrap();
    assert!(wait_until(&wake, PATIENCE, || !watch.peers().is_empty()));
    assert_eq!(watch.changes(), before + 1);
    let peers = watch.peers();
    assert_eq!((peers.len(), peers[0].topic.as_str()), (1, "/watched"));
    assert_eq!(peers[0].qos.deadline, strict.qos.deadline);
    assert_eq!(peers[0].gid[..12], b.gid()[..12]);
    // What was there before the watch is known at once.
    let late = a.watch("/watched", true, bell(&ignored)).unwrap();
    assert_eq!(late.peers(), peers);
    drop(others);
    drop(writer);
    assert!(wait_until(&wake, PATIENCE, || watch.peers().is_empty()));
    assert_eq!((watch.changes(), late.changes()), (before + 2, before + 1));
}
