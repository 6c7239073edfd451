//! Endpoints that every node announces beside its topics, as another node finds them over loopback.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use serde_json::json;
use wrapyfi_conformance::until;
use wrapyfi_endpoint::{AnnouncedDurability, AnnouncedQos, History, Liveliness, Reliability};
use wrapyfi_node::LogLine;
use wrapyfi_node::parameters::ParameterStore;
use wrapyfi_ros2::graph::Graph;
use wrapyfi_ros2::{CycloneGraph, NodeEndpoints};

use crate::common::near_config;
use crate::node_common::{Offering, boolean, ok, pair};

/// Services of a node without topics, as a captured node of rclpy announces them: depth, then hash
/// of requests and of replies.
const SERVICES: [(&str, &str, u32, &str, &str); 7] = [
    (
        "describe_parameters",
        "rcl_interfaces/srv/DescribeParameters",
        1000,
        "RIHS01_05dd1c2bc87dec2627105c8070d6f9725c781a4f2ab852975bf105462b82b644",
        "RIHS01_ad6747319613c6131589e062e095b469a46cc764f7d0f12a001a49e6cd893995",
    ),
    (
        "get_parameter_types",
        "rcl_interfaces/srv/GetParameterTypes",
        1000,
        "RIHS01_87d7ec5ef545d4daa289d500025d31fb2437bc8b8365ca367161c4dac4be33fd",
        "RIHS01_ac1335dce67c478e669434f6ac2fbff34fcd529580f272d3006785ba8b54e47f",
    ),
    (
        "get_parameters",
        "rcl_interfaces/srv/GetParameters",
        1000,
        "RIHS01_135a9e1c3d7cebef792f6687d7ddf99949b21a0bd9a320d863a9110a3f5cf4d6",
        "RIHS01_9fa773b46e39cc5d02db6224d8fd520bb9caeeffc2b27c96c1e59431baba9f2a",
    ),
    (
        "get_type_description",
        "type_description_interfaces/srv/GetTypeDescription",
        10,
        "RIHS01_470f56ccbcf13d55c78c8b735fb12da03e639e5acded994426c89d94778d9e28",
        "RIHS01_648c49d976240861a482f961c5621ddd0d2135d8cce6f297a76d4f6376d93b75",
    ),
    (
        "list_parameters",
        "rcl_interfaces/srv/ListParameters",
        1000,
        "RIHS01_a1b0b5d6b967a5b8ac5bc8563c3ea678f349e312a6a4967227c5a96bc5ce38df",
        "RIHS01_31b937b82de3612426be79f231e386259f97e8dc843e3f2845288b4bfa296bdd",
    ),
    (
        "set_parameters",
        "rcl_interfaces/srv/SetParameters",
        1000,
        "RIHS01_130d46386b7e84ea9ecf60608a4d83cbe5e5cb7c6cc5b712b7a4e3a6c254e932",
        "RIHS01_7a0e8140a0b8d98308fa81a5403a766e610af29a239caf54b7553227906fc266",
    ),
    (
        "set_parameters_atomically",
        "rcl_interfaces/srv/SetParametersAtomically",
        1000,
        "RIHS01_db0bd950ed5ed867a0e90b225e44dea382d762c0762ff3e0ee842190042a59e5",
        "RIHS01_31b1a38c5b0b9d893ee24da45f69638f4561c78461d82d52750f429b534502b8",
    ),
];

const ROSOUT: (&str, &str) =
    ("Log_", "RIHS01_e28ce254ca8abc06abf92773b74602cdbf116ed34fbaf294fb9f81da9f318eac");
const EVENTS: (&str, &str) =
    ("ParameterEvent_", "RIHS01_043e627780fcad87a22d225bc2a037361dba713fca6a6b9f4b869a5aa0393204");

/// DDS topic, DDS type, hash, publisher or not, and quality of service of each, in order.
fn captured() -> Vec<(String, String, String, bool, AnnouncedQos)> {
    let qos = |depth| AnnouncedQos {
        reliability: Reliability::Reliable,
        durability: AnnouncedDurability::Volatile,
        history: Some(History::KeepLast(depth)),
        deadline: None,
        lifespan: None,
        liveliness: Liveliness::Automatic,
        lease: None,
    };
    let mut all = Vec::new();
    for (name, kind, depth, request, response) in SERVICES {
        let kind = kind.replace("/srv/", "::srv::dds_::");
        let topic = |prefix: &str, half: &str| format!("{prefix}/robot/camera/{name}{half}");
        let requests = (topic("rq", "Request"), format!("{kind}_Request_"), request.to_owned());
        let replies = (topic("rr", "Reply"), format!("{kind}_Response_"), response.to_owned());
        all.push((requests.0, requests.1, requests.2, false, qos(depth)));
        all.push((replies.0, replies.1, replies.2, true, qos(depth)));
    }
    let lifespan = Some(Duration::from_secs(10));
    let latched =
        AnnouncedQos { durability: AnnouncedDurability::TransientLocal, lifespan, ..qos(1000) };
    for (topic, (kind, hash), qos) in
        [("rt/rosout", ROSOUT, latched), ("rt/parameter_events", EVENTS, qos(1000))]
    {
        let kind = format!("rcl_interfaces::msg::dds_::{kind}");
        all.push((topic.to_owned(), kind, hash.to_owned(), true, qos));
    }
    all.sort_by(|a, b| a.0.cmp(&b.0));
    all
}

#[test]
fn what_is_announced_is_what_nodes_of_ros_announce() {
    let (offering, asking) = pair();
    let mut nodes = asking.graph.nodes().unwrap();
    let mut found = Vec::new();
    until("all endpoints under the node's name", || {
        nodes.update();
        found = asking.graph.endpoints().unwrap();
        found.retain(|endpoint| nodes.owner(&endpoint.gid) == Some("/robot/camera"));
        found.len() >= captured().len()
    });
    assert_eq!(asking.endpoints_of(&offering).len(), found.len(), "some are no node's");
    found.sort_by(|a, b| a.dds_topic.cmp(&b.dds_topic));
    let found: Vec<_> = found
        .into_iter()
        .map(|one| (one.dds_topic, one.dds_type, one.type_hash.unwrap(), one.is_publisher, one.qos))
        .collect();
    assert_eq!(found, captured());
}

#[test]
fn a_node_without_type_descriptions_does_not_offer_them() {
    let graph = CycloneGraph::new(&near_config("camera")).unwrap();
    let off = [("start_type_description_service".to_owned(), false.into())];
    let store = ParameterStore::new(graph.node(), BTreeMap::from(off)).unwrap();
    let shared: Arc<dyn Graph> = Arc::new(graph.clone());
    let node = NodeEndpoints::start(&shared, store, None).unwrap();
    // What it announces itself, which needs no discovery.
    let mut own: Vec<_> = graph.endpoints().unwrap().into_iter().map(|one| one.dds_topic).collect();
    own.retain(|topic| topic != "ros_discovery_info");
    own.sort();
    let mut expected: Vec<_> = captured().into_iter().map(|(topic, ..)| topic).collect();
    expected.retain(|topic| !topic.contains("/get_type_description"));
    assert_eq!((own.len(), own), (14, expected));
    drop(node);
}

#[test]
fn nothing_is_left_of_a_node_that_ends() {
    let (offering, mut asking) = pair();
    let handle = offering.node.handle().clone();
    assert_eq!(asking.set(&[boolean("use_sim_time", true)]), json!([ok()]));
    // With its subscription of the clock.
    until("all endpoints", || asking.endpoints_of(&offering).len() == captured().len() + 1);
    let Offering { graph, node } = offering;
    drop(node);
    let own = graph.gid();
    let left = |from: &CycloneGraph| {
        let all = from.endpoints().unwrap().into_iter();
        all.filter(|one| one.gid[..12] == own[..12] && one.dds_topic != "ros_discovery_info")
            .count()
    };
    assert_eq!(left(&graph), 0);
    until("the other node sees them gone", || left(&asking.graph) == 0);
    // What is left of the node in the program does nothing.
    handle.log(LogLine::default());
    handle.parameters(|store| store.set("rate", 3)).unwrap();
}
