//! What every node has beside its topics, seen by another node over loopback.
#![cfg(feature = "ros2")]
// In helpers of tests, too, a panic is the right answer.
#![allow(clippy::unwrap_used, clippy::indexing_slicing, clippy::panic)]

mod ros2_common;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use serde_json::{Value, json};
use wrapyfi_core::endpoint::{
    AnnouncedDurability, AnnouncedQos, Durability, History, Liveliness, Qos, Reliability, Wake,
};
#[cfg(feature = "ros2-fastdds")]
use wrapyfi_core::middleware::ros2::graph::ServiceMapping;
use wrapyfi_core::middleware::ros2::graph::{
    DiscoveredEndpoint, Graph, Peers, ServiceDescription, TopicDescription, wait_until,
};
use wrapyfi_core::middleware::ros2::{
    AnyClient, AnyListener, AnyPublisher, CycloneConfig, CycloneGraph, NodeEndpoints, Ros2,
    ServiceOptions, ServiceType,
};
use wrapyfi_core::node::parameters::{Parameter, ParameterDescriptor, ParameterStore};
use wrapyfi_core::node::{LogLevel, LogLine};
use wrapyfi_core::types::Stamp;
use wrapyfi_interfaces::store::{ResolvedType, TypeStore};

use ros2_common::{HASH, PATIENCE, bell, far_config, near_config};

const MAX_BYTES: usize = 1 << 20;
/// No system's time is as early.
const LONG_AGO: i32 = 1_500_000_000;

/// A node and what it offers.
struct Offering {
    graph: CycloneGraph,
    node: NodeEndpoints,
}

impl Offering {
    fn new(config: &CycloneConfig) -> Self {
        let graph = CycloneGraph::new(config).unwrap();
        let mut store = ParameterStore::new(graph.node(), BTreeMap::new()).unwrap();
        let rate = ParameterDescriptor::new("rate")
            .with_description("Images per second")
            .with_integer_range(1, 60, 1);
        store.declare(rate, 10).unwrap();
        store.declare(ParameterDescriptor::new("serial").read_only(), "A1").unwrap();
        store.declare(ParameterDescriptor::new("lens.label"), "left").unwrap();
        let shared: Arc<dyn Graph> = Arc::new(graph.clone());
        let node = NodeEndpoints::start(&shared, store).unwrap();
        Self { graph, node }
    }
}

/// Another node, which knows the types that ours knows.
struct Asking {
    graph: CycloneGraph,
    ros2: Ros2,
    types: TypeStore,
    asked: String,
}

impl Asking {
    fn new(config: &CycloneConfig, asked: &Offering) -> Self {
        let graph = CycloneGraph::new(config).unwrap();
        let ros2 = Ros2::new(Arc::new(graph.clone()), |name| Ok(name.to_owned()));
        let asked = asked.graph.node().fqn();
        Self { graph, ros2, types: TypeStore::generated(), asked }
    }

    fn resolved(&mut self, name: &str) -> ResolvedType {
        self.types.resolve_name(name).unwrap()
    }

    /// The reply of one of the node's services.
    fn ask(&mut self, service: &str, type_name: &str, request: &Value) -> Value {
        let kind = ServiceType::new(&self.resolved(type_name)).unwrap();
        let options = ServiceOptions { timeout: PATIENCE, ..ServiceOptions::default() };
        let name = format!("{}/{service}", self.asked);
        let mut client = AnyClient::open(&self.ros2, &name, kind, &options, &Wake::new()).unwrap();
        let request = client.request_plan().from_json(request, MAX_BYTES).unwrap();
        client.call_and_wait(&request).unwrap().to_json()
    }

    fn list(&mut self, prefixes: &[&str], depth: u64) -> Value {
        let request = json!({"prefixes": prefixes, "depth": depth});
        self.ask("list_parameters", "rcl_interfaces/srv/ListParameters", &request)["result"].take()
    }

    fn get(&mut self, names: &[&str]) -> Value {
        let request = json!({"names": names});
        self.ask("get_parameters", "rcl_interfaces/srv/GetParameters", &request)["values"].take()
    }

    /// Whether each was set, or why not.
    fn set(&mut self, parameters: &[Value]) -> Value {
        let request = json!({"parameters": parameters});
        self.ask("set_parameters", "rcl_interfaces/srv/SetParameters", &request)["results"].take()
    }

    fn listen(&mut self, topic: &str, type_name: &str, qos: Qos) -> (AnyListener, Wake) {
        let wake = Wake::new();
        let kind = self.resolved(type_name);
        let listener = AnyListener::open(&self.ros2, topic, &kind, qos, MAX_BYTES, &wake).unwrap();
        (listener, wake)
    }

    /// What the other participant has beside what announces its nodes.
    fn endpoints_of(&self, other: &Offering) -> Vec<DiscoveredEndpoint> {
        let mut found = self.graph.endpoints().unwrap();
        found.retain(|endpoint| {
            endpoint.gid[..12] == other.graph.gid()[..12]
                && endpoint.dds_topic != "ros_discovery_info"
        });
        found
    }
}

fn pair(test: u32) -> (Offering, Asking) {
    let offering = Offering::new(&near_config("camera", test));
    let asking = Asking::new(&far_config("tool", test), &offering);
    (offering, asking)
}

fn next(listener: &mut AnyListener, wake: &Wake) -> Value {
    let mut taken = None;
    assert!(wait_until(wake, PATIENCE, || {
        taken = listener.take().unwrap();
        taken.is_some()
    }));
    taken.unwrap().fields.to_json()
}

fn until(what: &str, condition: impl FnMut() -> bool) {
    assert!(wait_until(&Wake::new(), PATIENCE, condition), "{what}");
}

fn boolean(name: &str, value: bool) -> Value {
    json!({"name": name, "value": {"type": 1, "bool_value": value}})
}

fn integer(name: &str, value: i64) -> Value {
    json!({"name": name, "value": {"type": 2, "integer_value": value}})
}

fn text(name: &str, value: &str) -> Value {
    json!({"name": name, "value": {"type": 4, "string_value": value}})
}

fn ok() -> Value {
    json!({"successful": true, "reason": ""})
}

fn refused(reason: &str) -> Value {
    json!({"successful": false, "reason": reason})
}

/// Lists, gets and sets the parameters of an [`Offering`].
fn use_parameters(asking: &mut Asking) {
    let names = ["use_sim_time", "start_type_description_service", "rate", "serial", "lens.label"];
    assert_eq!(asking.list(&[], 0), json!({"names": names, "prefixes": ["lens"]}));
    assert_eq!(asking.list(&["lens"], 1), json!({"names": ["lens.label"], "prefixes": ["lens"]}));
    let values = asking.get(&["rate", "lens.label"]);
    assert_eq!(values.as_array().unwrap().len(), 2);
    assert_eq!((&values[0]["type"], &values[0]["integer_value"]), (&json!(2), &json!(10)));
    assert_eq!((&values[1]["type"], &values[1]["string_value"]), (&json!(4), &json!("left")));
    assert_eq!(asking.get(&["rate", "none"]), json!([]), "all or nothing");
    let results = asking.set(&[
        integer("rate", 20),
        text("rate", "fast"),
        integer("rate", 61),
        text("serial", "B2"),
        integer("none", 1),
    ]);
    // As nodes of rclpy say it.
    let expected = [
        ok(),
        refused("Wrong parameter type, expected 'Type.INTEGER' got 'Type.STRING'"),
        refused("Parameter rate out of range. Min: 1, Max: 60, value: 61"),
        refused("Trying to set a read-only parameter: serial."),
        refused("Invalid access to undeclared parameter(s): []"),
    ];
    assert_eq!(results, json!(expected));
    assert_eq!(asking.get(&["rate"])[0]["integer_value"], 20);
}

#[test]
fn another_node_uses_the_parameters() {
    let (offering, mut asking) = pair(0);
    let handle = offering.node.handle().clone();
    let wake = Wake::new();
    let watch = handle.parameters(|store| store.watch(&["rate"], &wake));
    use_parameters(&mut asking);
    assert!(wake.wait(PATIENCE), "the watch rings");
    assert_eq!(watch.take(), [Parameter::new("rate", 20)]);

    let types = "rcl_interfaces/srv/GetParameterTypes";
    let names = json!({"names": ["rate", "serial", "use_sim_time"]});
    assert_eq!(asking.ask("get_parameter_types", types, &names), json!({"types": [2, 4, 1]}));
    let describe = "rcl_interfaces/srv/DescribeParameters";
    let reply = asking.ask("describe_parameters", describe, &json!({"names": ["rate", "serial"]}));
    let [rate, serial] = &reply["descriptors"].as_array().unwrap()[..] else { panic!("{reply}") };
    assert_eq!(rate["description"], "Images per second");
    assert_eq!(rate["integer_range"], json!([{"from_value": 1, "to_value": 60, "step": 1}]));
    assert_eq!((&rate["read_only"], &serial["read_only"]), (&json!(false), &json!(true)));
    assert_eq!((&rate["type"], &serial["type"]), (&json!(2), &json!(4)));

    let mut set_atomically = |parameters: Value| {
        let kind = "rcl_interfaces/srv/SetParametersAtomically";
        let request = json!({"parameters": parameters});
        asking.ask("set_parameters_atomically", kind, &request)["result"].take()
    };
    let undeclared = "Invalid access to undeclared parameter(s): []";
    let both = json!([integer("rate", 30), integer("none", 1)]);
    assert_eq!(set_atomically(both), refused(undeclared));
    handle.parameters(|store| assert_eq!(store.get("rate"), Ok(&20.into()), "nothing changed"));
    assert_eq!(set_atomically(json!([integer("rate", 30), text("lens.label", "right")])), ok());
    handle.parameters(|store| {
        assert_eq!(store.get("rate"), Ok(&30.into()));
        assert_eq!(store.get("lens.label"), Ok(&"right".into()));
    });
    assert_eq!(handle.refused_requests(), 0);
}

#[test]
fn changes_of_parameters_are_published() {
    let (offering, mut asking) = pair(1);
    let handle = offering.node.handle();
    let qos = Qos { history: History::KeepLast(1000), ..Qos::default() };
    let (mut events, wake) =
        asking.listen("/parameter_events", "rcl_interfaces/msg/ParameterEvent", qos);
    // The topic is volatile: the first event that is heard says that all others will be.
    let mut rate = 0;
    assert!(wait_until(&wake, PATIENCE, || {
        rate = rate % 60 + 1;
        handle.parameters(|store| store.set("rate", rate)).unwrap();
        events.take().unwrap().is_some()
    }));
    handle.parameters(|store| store.declare(ParameterDescriptor::new("late"), 1.5)).unwrap();
    let event = std::iter::repeat_with(|| next(&mut events, &wake))
        .find(|event| event["new_parameters"][0]["name"] == "late")
        .unwrap();
    assert_eq!(event["node"], "/robot/camera");
    let [new] = &event["new_parameters"].as_array().unwrap()[..] else { panic!("{event}") };
    assert_eq!(new["value"]["type"], 3);
    assert_eq!(new["value"]["double_value"], 1.5);
    assert_eq!([&event["changed_parameters"], &event["deleted_parameters"]], [&json!([]); 2]);
    assert!(event["stamp"]["sec"].as_i64().unwrap() > LONG_AGO.into());

    let results = asking.set(&[integer("rate", 7), integer("rate", 99), text("lens.label", "up")]);
    assert_eq!(results[1]["successful"], false);
    for (name, field, value) in
        [("rate", "integer_value", json!(7)), ("lens.label", "string_value", json!("up"))]
    {
        let event = next(&mut events, &wake);
        let [one] = &event["changed_parameters"].as_array().unwrap()[..] else { panic!("{event}") };
        assert_eq!((&one["name"], &one["value"][field]), (&json!(name), &value));
    }
}

#[test]
fn types_are_described() {
    let (offering, mut asking) = pair(2);
    let handle = offering.node.handle();
    handle.types(|types| {
        types.add_named(&mut TypeStore::generated(), "std_msgs/msg/String").unwrap();
    });
    let mut describe = |name: &str, hash: &str| {
        let kind = "type_description_interfaces/srv/GetTypeDescription";
        let request = json!({"type_name": name, "type_hash": hash, "include_type_sources": true});
        asking.ask("get_type_description", kind, &request)
    };
    let reply = describe("std_msgs/msg/String", HASH);
    assert_eq!((&reply["successful"], &reply["failure_reason"]), (&json!(true), &json!("")));
    let described = &reply["type_description"]["type_description"];
    assert_eq!(described["type_name"], "std_msgs/msg/String");
    assert_eq!(described["fields"][0]["name"], "data");
    assert!(
        reply["type_sources"][0]["raw_file_contents"].as_str().unwrap().contains("string data")
    );
    // What every node has is described without being asked for.
    let log = "RIHS01_e28ce254ca8abc06abf92773b74602cdbf116ed34fbaf294fb9f81da9f318eac";
    assert_eq!(describe("rcl_interfaces/msg/Log", log)["successful"], true);
    for (name, hash, reason) in [
        ("std_msgs/msg/Bool", HASH, "Type not currently in use by this node"),
        ("std_msgs/msg/String", "RIHS01_12", "Failed to parse type hash"),
    ] {
        let reply = describe(name, hash);
        assert_eq!(
            (&reply["successful"], &reply["failure_reason"]),
            (&json!(false), &json!(reason))
        );
    }
}

#[test]
fn the_log_reaches_who_comes_late() {
    let (offering, mut asking) = pair(3);
    let handle = offering.node.handle();
    let levels = [LogLevel::Info, LogLevel::Warn, LogLevel::Error];
    for (level, n) in levels.into_iter().zip(0_u32..) {
        handle.log(LogLine {
            level,
            logger: "robot.camera".into(),
            text: format!("line {n}"),
            file: "camera.rs".into(),
            function: "tick".into(),
            line: n,
        });
    }
    // What was logged before the first request is published before the second one is read.
    asking.get(&["rate"]);
    asking.get(&["rate"]);
    let (durability, history) = (Durability::TransientLocal, History::KeepLast(1000));
    let qos = Qos { durability, history, ..Qos::default() };
    let (mut log, wake) = asking.listen("/rosout", "rcl_interfaces/msg/Log", qos);
    for (level, n) in [20, 30, 40].into_iter().zip(0..) {
        let mut line = next(&mut log, &wake);
        assert!(line["stamp"].take()["sec"].as_i64().unwrap() > LONG_AGO.into());
        let expected = json!({
            "stamp": null, "level": level, "name": "robot.camera", "msg": format!("line {n}"),
            "file": "camera.rs", "function": "tick", "line": n,
        });
        assert_eq!(line, expected);
    }
    assert_eq!(handle.lost_lines(), 0);
}

#[test]
fn simulated_time_is_followed_while_it_is_asked_for() {
    let (offering, mut asking) = pair(4);
    let handle = offering.node.handle();
    let kind = asking.resolved("rosgraph_msgs/msg/Clock");
    let qos = Qos { reliability: Reliability::BestEffort, ..Qos::default() };
    let wake = Wake::new();
    let mut clock =
        AnyPublisher::open(&asking.ros2, "/clock", &kind, qos, MAX_BYTES, &wake).unwrap();
    for round in 0..2 {
        assert!(handle.now().sec > LONG_AGO);
        assert_eq!(asking.set(&[boolean("use_sim_time", true)]), json!([ok()]));
        until("the system's time is left", || handle.now().sec < LONG_AGO);
        for sec in [5, 6, 2].map(|sec| 100 * round + sec) {
            let message = json!({"clock": {"sec": sec, "nanosec": 7}});
            let message = clock.plan().from_json(&message, MAX_BYTES).unwrap();
            until("the clock is followed", || {
                clock.publish(&message).unwrap();
                handle.now() == Stamp { sec, nanosec: 7 }
            });
        }
        assert_eq!(clock.listeners(), 1);
        assert_eq!(asking.set(&[boolean("use_sim_time", false)]), json!([ok()]));
        until("the system's time is back", || handle.now().sec > LONG_AGO);
        until("nobody listens to the clock", || clock.listeners() == 0);
    }
}

/// What a node without topics has, as a captured node of rclpy announces it: depth, then hash of
/// requests and of replies.
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
    let (offering, asking) = pair(5);
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
    let graph = CycloneGraph::new(&near_config("camera", 6)).unwrap();
    let off = [("start_type_description_service".to_owned(), false.into())];
    let store = ParameterStore::new(graph.node(), BTreeMap::from(off)).unwrap();
    let shared: Arc<dyn Graph> = Arc::new(graph.clone());
    let node = NodeEndpoints::start(&shared, store).unwrap();
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
    let (offering, mut asking) = pair(7);
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

#[test]
fn what_is_no_request_is_refused_and_the_next_one_answered() {
    let (offering, mut asking) = pair(8);
    let handle = offering.node.handle();
    let description = ServiceDescription {
        name: "/robot/camera/get_parameters".into(),
        type_name: "rcl_interfaces/srv/GetParameters".into(),
        request_hash: None,
        response_hash: None,
        depth: 1000,
        max_bytes: 64 << 20,
    };
    let mut raw = asking.graph.client(&description, bell(&Wake::new())).unwrap();
    until("the server", || raw.servers() == Peers::Ready(1));
    let count = |count: u32| [&[0, 1, 0, 0], &count.to_le_bytes()[..]].concat();
    let cut = [count(2), vec![5, 0, 0, 0], b"rate\0".to_vec()].concat();
    let not_utf8 = [count(1), vec![3, 0, 0, 0, 0xff, 0xfe, 0]].concat();
    let too_large = [count(0), vec![0; 32 << 20]].concat();
    let malformed =
        [vec![0, 1, 0, 0], vec![0, 3, 0, 0, 0, 0, 0, 0], count(u32::MAX), cut, not_utf8, too_large];
    for (request, refused) in malformed.into_iter().zip(1..) {
        raw.send(&[&request]).unwrap();
        until("the refusal", || handle.refused_requests() == refused);
        assert_eq!(asking.get(&["rate"])[0]["integer_value"], 10);
    }

    // The same DDS topic reached as a topic: too short for the identity of a request.
    let topic = TopicDescription {
        name: "rq/robot/camera/get_parametersRequest".into(),
        type_name: "rcl_interfaces::srv::dds_::GetParameters_Request_".into(),
        type_hash: None,
        qos: Qos::default(),
        max_bytes: 64,
    };
    let wake = Wake::new();
    let mut writer = asking.graph.advertise_dds(&topic, bell(&wake)).unwrap();
    assert!(wait_until(&wake, PATIENCE, || writer.matched() == 1));
    let before = handle.refused_requests();
    until("the refusal", || {
        writer.write(&[&[0, 1, 0, 0], &[0; 8]]).unwrap();
        handle.refused_requests() > before
    });
    assert_eq!(asking.get(&["rate"])[0]["integer_value"], 10);
    assert!(raw.take().unwrap().is_none(), "nothing of it was answered");
}

/// RustDDS knows no domain tags, and service names are those of the process.
#[cfg(feature = "ros2-fastdds")]
#[test]
fn another_node_uses_the_parameters_as_of_fast_dds() {
    let config = |node: &str| CycloneConfig {
        services: ServiceMapping::FastDds,
        ..CycloneConfig::loopback(
            ros2_common::name(&format!("{node}_{}", std::process::id())),
            ros2_common::domain(9),
        )
    };
    let offering = Offering::new(&config("camera"));
    let mut asking = Asking::new(&config("tool"), &offering);
    use_parameters(&mut asking);
    // On a participant of their own, and yet the node's.
    let mut nodes = asking.graph.nodes().unwrap();
    let camera = offering.graph.node().fqn();
    until("all endpoints under the node's name", || {
        nodes.update();
        let all = asking.graph.endpoints().unwrap();
        let owned = all.iter().filter(|one| nodes.owner(&one.gid) == Some(&camera));
        let (beside, on): (Vec<_>, Vec<_>) =
            owned.partition(|one| one.gid[..12] != offering.graph.gid()[..12]);
        (beside.len(), on.len()) == (2 * SERVICES.len(), 2)
    });
    assert_eq!(offering.node.handle().refused_requests(), 0);
}
