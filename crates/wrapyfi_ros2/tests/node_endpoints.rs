//! Endpoints that every node has beside its topics, seen by another node over loopback.

use serde_json::{Value, json};
use wrapyfi_conformance::until;
use wrapyfi_data::types::{MessageType, RosMessage, Stamp};
use wrapyfi_endpoint::{Context, Durability, History, Middleware, Qos, Reliability, Wake};
use wrapyfi_interfaces::store::TypeStore;
use wrapyfi_node::parameters::{Parameter, ParameterDescriptor};
use wrapyfi_node::{LogLevel, LogLine};
use wrapyfi_ros2::graph::{
    Graph, Peers, ServiceDescription, TopicDescription, WriterTraits, wait_until,
};

use crate::common::{HASH, TIMEOUT, bell};
use crate::node_common::{
    Asking, LONG_AGO, MAX_BYTES, boolean, integer, next, ok, pair, refused, text,
};

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
    let (offering, mut asking) = pair();
    let handle = offering.node.handle().clone();
    let wake = Wake::new();
    let watch = handle.parameters(|store| store.watch(&["rate"], &wake));
    use_parameters(&mut asking);
    assert!(wake.wait(TIMEOUT), "the watch rings");
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
    let (offering, mut asking) = pair();
    let handle = offering.node.handle();
    let qos = Qos { history: History::KeepLast(1000), ..Qos::default() };
    let (mut events, wake) =
        asking.listen("/parameter_events", "rcl_interfaces/msg/ParameterEvent", qos);
    // The topic is volatile: the first event that is heard says that all others will be.
    let mut rate = 0;
    assert!(wait_until(&wake, TIMEOUT, || {
        rate = rate % 60 + 1;
        handle.parameters(|store| store.set("rate", rate)).unwrap();
        events.take().unwrap().is_some()
    }));
    handle.parameters(|store| store.declare(ParameterDescriptor::new("late"), 1.5)).unwrap();
    let event = std::iter::repeat_with(|| next(&mut *events, &wake))
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
        let event = next(&mut *events, &wake);
        let [one] = &event["changed_parameters"].as_array().unwrap()[..] else { panic!("{event}") };
        assert_eq!((&one["name"], &one["value"][field]), (&json!(name), &value));
    }
}

#[test]
fn types_are_described() {
    let (offering, mut asking) = pair();
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
    let (offering, mut asking) = pair();
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
        let mut line = next(&mut *log, &wake);
        assert!(line["stamp"].take()["sec"].as_i64().unwrap() > LONG_AGO.into());
        let expected = json!({
            "stamp": null, "level": level, "name": "robot.camera", "msg": format!("line {n}"),
            "file": "camera.rs", "function": "tick", "line": n,
        });
        assert_eq!(line, expected);
    }
}

#[test]
fn simulated_time_is_followed_while_it_is_asked_for() {
    let (offering, mut asking) = pair();
    let handle = offering.node.handle();
    let qos = Qos { reliability: Reliability::BestEffort, ..Qos::default() };
    let spec = asking.topic("/clock", "rosgraph_msgs/msg/Clock", qos);
    let MessageType::Ros(kind) = spec.message_type else { panic!("{spec:?}") };
    let mut clock = asking.ros2.open_publisher(&spec, &Context::default()).unwrap();
    for round in 0..2 {
        assert!(handle.now().sec > LONG_AGO);
        assert_eq!(asking.set(&[boolean("use_sim_time", true)]), json!([ok()]));
        assert!(handle.now().sec < LONG_AGO, "the system's time is left with the reply");
        for sec in [5, 6, 2].map(|sec| 100 * round + sec) {
            let message = json!({"clock": {"sec": sec, "nanosec": 7}});
            let message = kind.plan().from_json(&message, MAX_BYTES).unwrap();
            let message = RosMessage::from_fields(kind, &message).unwrap().into();
            until("the clock is followed", || {
                clock.publish(&message).unwrap();
                handle.now() == Stamp { sec, nanosec: 7 }
            });
        }
        assert_eq!(clock.link().peers, Some(1));
        assert_eq!(asking.set(&[boolean("use_sim_time", false)]), json!([ok()]));
        assert!(handle.now().sec > LONG_AGO, "the system's time is back with the reply");
        until("nobody listens to the clock", || clock.link().peers == Some(0));
    }
}

#[test]
fn what_is_no_request_is_refused_and_the_next_one_answered() {
    let (offering, mut asking) = pair();
    let handle = offering.node.handle();
    let description = ServiceDescription {
        name: "/robot/camera/get_parameters".into(),
        type_name: "rcl_interfaces/srv/GetParameters".into(),
        type_hash: None,
        request_hash: None,
        response_hash: None,
        depth: 1000,
        max_bytes: 64 << 20,
    };
    let mut raw = asking.graph.client(&description, bell(&Wake::new())).unwrap();
    until("the server", || raw.servers() == Peers::Ready(1));
    let count = |count: u32| [&[0, 1, 0, 0], &count.to_le_bytes()[..]].concat();
    let cut = [count(2), vec![5, 0, 0, 0], b"rate\0".to_vec()].concat();
    let too_large = [count(0), vec![0; 32 << 20]].concat();
    let malformed =
        [vec![0, 1, 0, 0], vec![0, 3, 0, 0, 0, 0, 0, 0], count(u32::MAX), cut, too_large];
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
        hears_own: false,
    };
    let wake = Wake::new();
    let mut writer =
        asking.graph.advertise_dds(&topic, WriterTraits::default(), bell(&wake)).unwrap();
    assert!(wait_until(&wake, TIMEOUT, || writer.matched() == 1));
    let before = handle.refused_requests();
    until("the refusal", || {
        writer.write(&[&[0, 1, 0, 0], &[0; 8]]).unwrap();
        handle.refused_requests() > before
    });
    assert_eq!(asking.get(&["rate"])[0]["integer_value"], 10);
    assert!(raw.take().unwrap().is_none(), "nothing of it was answered");
}

#[cfg(feature = "fastdds-services")]
mod fast {
    use wrapyfi_ros2::CycloneConfig;
    use wrapyfi_ros2::graph::{Graph, ServiceMapping};

    use super::use_parameters;
    use crate::common::{domain, name};
    use crate::node_common::{Asking, Offering};
    use wrapyfi_conformance::until;

    /// RustDDS knows no domain tags, and service names are those of the process.
    #[test]
    fn another_node_uses_the_parameters_as_of_fast_dds() {
        let config = |node: &str| CycloneConfig {
            services: Some(ServiceMapping::FastDds),
            ..CycloneConfig::loopback(name(node), domain())
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
            // Seven services, two topics.
            (beside.len(), on.len()) == (14, 2)
        });
        assert_eq!(offering.node.handle().refused_requests(), 0);
    }
}
