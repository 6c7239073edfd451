//! Serialised messages and matching on CycloneDDS, between two nodes.

use wrapyfi_endpoint::{History, Wake};
use wrapyfi_ros2::CycloneGraph;
use wrapyfi_ros2::graph::{Graph, wait_until};

use crate::common::{
    Ends, HASH, TIMEOUT, bell, bodies, connect, far, far_config, near, next, pattern, text, topic,
    write,
};

#[test]
fn messages_of_all_sizes_go_both_ways_in_one_stack() {
    bodies::messages_of_all_sizes_go_both_ways(&near("a"), &near("b"), true);
}

#[test]
fn messages_of_all_sizes_go_both_ways_over_loopback() {
    bodies::messages_of_all_sizes_go_both_ways(&near("a"), &far("b"), true);
}

#[test]
fn a_late_reader_gets_what_is_kept() {
    bodies::a_late_reader_gets_what_is_kept(&near("a"), &far("b"));
}

#[test]
fn a_node_does_not_hear_itself() {
    bodies::a_node_does_not_hear_itself(&near("a"), &near("b"));
}

#[test]
fn matches_come_and_go_and_are_watched() {
    bodies::matches_come_and_go_and_are_watched(&near("a"), &far("b"));
}

#[test]
fn another_type_does_not_match_and_is_listed_with_its_hash() {
    let (a, b) = (near("a"), far("b"));
    let wake = Wake::new();
    let mut other = topic("/chatter");
    other.type_name = "std_msgs/msg/Int32".into();
    let writer = a.advertise(&topic("/chatter"), bell(&wake)).unwrap();
    let reader = b.subscribe(&other, bell(&wake)).unwrap();
    let seen =
        || b.endpoints().unwrap().into_iter().find(|e| e.is_publisher && e.topic == "/chatter");
    assert!(wait_until(&wake, TIMEOUT, || seen().is_some()));
    let seen = seen().unwrap();
    assert_eq!(seen.type_name, "std_msgs/msg/String");
    assert_eq!(seen.type_hash.as_deref(), Some(HASH));
    assert_eq!(seen.gid[..12], a.gid()[..12]);
    assert_eq!((writer.matched(), reader.matched()), (0, 0));
}

#[test]
fn who_does_not_fit_is_told_why() {
    bodies::who_does_not_fit_is_told_why(&near("a"), &far("b"));
}

#[test]
fn a_message_over_the_limit_is_named_and_the_next_one_comes() {
    bodies::a_message_over_the_limit_is_named_and_the_next_one_comes(&near("a"), &far("b"));
}

#[test]
fn services_of_a_type_that_nobody_defines_carry_megabytes() {
    let (a, b) = (near("a"), far("b"));
    bodies::services_of_a_type_that_nobody_defines_carry_megabytes(&a, &b);
}

#[test]
fn requests_and_replies_over_the_limit_are_named_and_the_next_one_comes() {
    let (a, b) = (near("a"), far("b"));
    bodies::requests_and_replies_over_the_limit_are_named_and_the_next_one_comes(&a, &b);
}

#[test]
fn the_mark_of_a_bridge_is_seen() {
    bodies::the_mark_of_a_bridge_is_seen(&near("a"), &far("b"));
}

#[test]
fn a_message_far_over_the_limit_is_discarded_by_its_header() {
    let mut config = far_config("b");
    config.max_message_bytes = 25_000;
    let (a, b) = (near("a"), CycloneGraph::new(&config).unwrap());
    for size in [100_001, 6_000_000] {
        let Ends { wake, mut writer, mut reader } = connect(&a, &b, &topic("/chatter"));
        write(&mut *writer, &pattern(size)).unwrap();
        write(&mut *writer, &pattern(99_000)).unwrap();
        assert_eq!(text(&next(&mut *reader, &wake)).len(), 99_000);
    }
}

#[test]
fn one_reader_that_is_not_taken_from_stops_nobody() {
    let (a, b) = (near("a"), far("b"));
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
    let (a, b) = (near("a"), near("b"));
    let mut ends = connect(&a, &b, &topic("/chatter"));
    let sent = pattern(100_000);
    write(&mut *ends.writer, &sent).unwrap();
    let kept = next(&mut *ends.reader, &ends.wake);
    drop((ends, a, b));
    assert!(std::thread::spawn(move || text(&kept)).join().unwrap() == sent);
}

#[test]
fn a_watch_hears_of_its_own_side_of_its_own_topic() {
    let (a, b) = (near("a"), far("b"));
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
    assert!(wait_until(&wake, TIMEOUT, || !watch.peers().is_empty()));
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
    assert!(wait_until(&wake, TIMEOUT, || watch.peers().is_empty()));
    assert_eq!((watch.changes(), late.changes()), (before + 2, before + 1));
}
