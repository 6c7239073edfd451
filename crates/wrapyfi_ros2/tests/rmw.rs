//! The graph on the rmw of an installed ROS 2: with itself, and beside CycloneDDS inside the program.
//!
//! Runs under whatever `RMW_IMPLEMENTATION` says, in a network namespace with nothing but loopback.

use std::io::Write as _;
use std::sync::Arc;

use wrapyfi_endpoint::Wake;
use wrapyfi_rmw::{DiscoveryRange, EndpointType, Node, NodeOptions};
use wrapyfi_ros2::graph::{Graph, WriterTraits, wait_until};
use wrapyfi_ros2::{CycloneConfig, CycloneGraph, RmwGraph};

use crate::actions;
use crate::common::{TIMEOUT, bell, bodies, domain, name, topic};

/// Name of the middleware that the tests have loaded.
fn implementation() -> String {
    wrapyfi_rmw::implementation().unwrap()
}

/// True where the loaded middleware is one that `test` is about; says that the test is skipped where it is not.
fn is_for(test: &str, fits: impl Fn(&str) -> bool) -> bool {
    let loaded = implementation();
    let fits = fits(&loaded);
    if !fits {
        // Written directly: the test runner hides what `println!` says when a test passes.
        let skipped = format!("SKIPPED {test}: it is not about {loaded}\n");
        std::io::stderr().write_all(skipped.as_bytes()).unwrap();
    }
    fits
}

fn is_dds(loaded: &str) -> bool {
    loaded != "rmw_zenoh_cpp"
}

fn config(node: &str) -> CycloneConfig {
    CycloneConfig::loopback(name(node), domain())
}

fn on_rmw(node: &str) -> RmwGraph {
    RmwGraph::new(&config(node), "/").unwrap()
}

#[test]
fn messages_of_all_sizes_go_both_ways() {
    bodies::messages_of_all_sizes_go_both_ways(&on_rmw("a"), &on_rmw("b"), false);
}

#[test]
fn messages_reach_cyclone_and_come_from_there() {
    if !is_for("messages_reach_cyclone_and_come_from_there", is_dds) {
        return;
    }
    let cyclone = CycloneGraph::new(&config("b")).unwrap();
    bodies::messages_of_all_sizes_go_both_ways(&on_rmw("a"), &cyclone, false);
}

#[test]
fn a_late_reader_gets_what_is_kept() {
    bodies::a_late_reader_gets_what_is_kept(&on_rmw("a"), &on_rmw("b"));
}

#[test]
fn a_node_does_not_hear_itself() {
    bodies::a_node_does_not_hear_itself(&on_rmw("a"), &on_rmw("b"));
}

#[test]
fn matches_come_and_go_and_are_watched() {
    bodies::matches_come_and_go_and_are_watched(&on_rmw("a"), &on_rmw("b"));
}

#[test]
fn who_does_not_fit_is_told_why() {
    // Every quality of service fits every other on Zenoh.
    if is_for("who_does_not_fit_is_told_why", is_dds) {
        bodies::who_does_not_fit_is_told_why(&on_rmw("a"), &on_rmw("b"));
    }
}

#[test]
fn a_message_over_the_limit_is_named_and_the_next_one_comes() {
    let (a, b) = (on_rmw("a"), on_rmw("b"));
    bodies::a_message_over_the_limit_is_named_and_the_next_one_comes(&a, &b);
}

#[test]
fn services_of_a_type_that_nobody_defines_carry_megabytes() {
    let (a, b) = (on_rmw("a"), on_rmw("b"));
    bodies::services_of_a_type_that_nobody_defines_carry_megabytes(&a, &b);
}

#[test]
fn requests_and_replies_over_the_limit_are_named_and_the_next_one_comes() {
    let (a, b) = (on_rmw("a"), on_rmw("b"));
    bodies::requests_and_replies_over_the_limit_are_named_and_the_next_one_comes(&a, &b);
}

#[test]
fn services_on_cyclone_are_the_same_inside_and_on_rmw() {
    if !is_for("services_on_cyclone_are_the_same_inside_and_on_rmw", |loaded| {
        loaded == "rmw_cyclonedds_cpp"
    }) {
        return;
    }
    let (a, b) = (on_rmw("a"), CycloneGraph::new(&config("b")).unwrap());
    bodies::services_of_a_type_that_nobody_defines_carry_megabytes(&a, &b);
    bodies::services_of_a_type_that_nobody_defines_carry_megabytes(&b, &a);
}

#[test]
fn actions_go_over() {
    actions::all(&actions::on(on_rmw("near")), &actions::on(on_rmw("far")));
}

#[cfg(feature = "fastdds-services")]
#[test]
fn actions_reach_cyclone_and_come_from_there() {
    if is_for("actions_reach_cyclone_and_come_from_there", is_dds) {
        let mapping = match implementation().as_str() {
            "rmw_cyclonedds_cpp" => wrapyfi_ros2::graph::ServiceMapping::Cyclone,
            _ => wrapyfi_ros2::graph::ServiceMapping::FastDds,
        };
        let (ours, inside) =
            (actions::on(on_rmw("ours")), actions::ros2(&config("inside"), mapping));
        actions::all(&ours, &inside);
        actions::all(&inside, &ours);
    }
}

#[test]
fn the_mark_of_a_bridge_is_seen() {
    bodies::the_mark_of_a_bridge_is_seen(&on_rmw("a"), &on_rmw("b"));
}

/// As the tools of ROS 2 see it, which know nothing of marks.
#[test]
fn what_is_marked_belongs_to_its_node() {
    let config = config("looks");
    let options = NodeOptions {
        name: config.node.name().to_owned(),
        namespace: config.node.namespace().to_owned(),
        enclave: "/".to_owned(),
        domain_id: config.domain_id,
        range: DiscoveryRange::Localhost,
        static_peers: Vec::new(),
    };
    let (a, looks) = (on_rmw("a"), Node::new(&options).unwrap());
    let wake = Wake::new();
    let mark = "0196a3b2c4d5e6f7:ros".parse().unwrap();
    let traits = WriterTraits { mark: Some(&mark), ..WriterTraits::default() };
    let _marked = a.advertise_with(&topic("/marked"), traits, bell(&wake)).unwrap();
    let service = bodies::turn(1 << 20);
    let _server = a.server_marked(&service, Some(&mark), bell(&wake)).unwrap();
    let marked = if is_dds(&implementation()) { "rt/marked" } else { "/marked" };
    assert!(wait_until(&wake, TIMEOUT, || {
        let found = looks.endpoints(marked, EndpointType::Publishers).unwrap();
        let services = looks.services_of(("a", "/robot"), false).unwrap_or_default();
        found.iter().any(|one| one.node == "/robot/a")
            && services.iter().any(|(name, _)| *name == service.name)
    }));
}

#[test]
fn a_domain_that_has_no_ports_is_refused() {
    let config = CycloneConfig::loopback(name("a"), 233);
    let said = RmwGraph::new(&config, "/").err().unwrap().to_string();
    assert_eq!(said, "rmw_init: domain 233 is over 232");
}

#[test]
fn a_node_that_is_dropped_leaves_nothing_behind() {
    let ours = || {
        let tasks = std::fs::read_dir("/proc/self/task").unwrap().flatten();
        let names = tasks.filter_map(|task| std::fs::read_to_string(task.path().join("comm")).ok());
        names.filter(|name| name.starts_with("rmw-")).count()
    };
    let watcher = on_rmw("b");
    let wake = Wake::new();
    // A thread has its name a moment after it has begun.
    assert!(wait_until(&wake, TIMEOUT, || ours() == 2));
    for _ in 0..3 {
        let graph = on_rmw("a");
        let kept: Arc<dyn Graph> = Arc::new(graph.clone());
        let _reader = kept.subscribe(&topic("/chatter"), bell(&wake)).unwrap();
        // The last share of the node may be dropped by a thread of its own.
        let _watch = kept.watch("/chatter", true, Arc::new(move || drop(graph.clone()))).unwrap();
        let is_there = || watcher.endpoints().unwrap().iter().any(|one| one.topic == "/chatter");
        assert!(wait_until(&wake, TIMEOUT, is_there));
    }
    assert!(wait_until(&wake, TIMEOUT, || ours() == 2));
    assert!(wait_until(&wake, TIMEOUT, || {
        !watcher.endpoints().unwrap().iter().any(|one| one.topic == "/chatter")
    }));
}
