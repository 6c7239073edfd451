//! Requests of clients to a node of rclpy, and its replies, against a store with its parameters
//! (`tests/data/node/wire.json`).

use std::collections::BTreeMap;

use wrapyfi_interfaces::Message;
use wrapyfi_interfaces::rcl_interfaces::msg::ParameterEvent;
use wrapyfi_interfaces::rcl_interfaces::srv::{
    DescribeParameters_Request, DescribeParameters_Response, GetParameterTypes_Response,
    GetParameters_Response, ListParameters_Response, SetParameters_Response,
    SetParametersAtomically_Response,
};

use super::{Parameter, ParameterDescriptor, ParameterService, ParameterStore};
use crate::test_data::{RMWS, clean, group, padded};
use crate::{NodeName, ParameterType, ParameterValue};

const LIMIT: usize = 1 << 20;

/// The node that was recorded.
fn recorded_node() -> ParameterStore {
    let node = NodeName::new("params", "/").unwrap();
    let mut store = ParameterStore::new(&node, BTreeMap::new()).unwrap();
    let mut declare = |name: &str, value: ParameterValue| {
        store.declare(ParameterDescriptor::new(name), value).unwrap();
    };
    declare("an_int", 42.into());
    declare("a_string", "hello".into());
    declare("a_double", 1.5.into());
    declare("a_bool", true.into());
    declare("bytes", vec![1_u8, 0xff].into());
    declare("ints", vec![4_i64, 5].into());
    declare("doubles", vec![0.5, 1.5].into());
    declare("strings", vec!["a".to_owned(), "bc".to_owned()].into());
    declare("bools", vec![true, false].into());
    let ranged = ParameterDescriptor::new("ranged")
        .with_description("an int in a range")
        .with_integer_range(0, 10, 1);
    let ranged = ParameterDescriptor { additional_constraints: "even is nice".into(), ..ranged };
    store.declare(ranged, 5).unwrap();
    store.declare(ParameterDescriptor::new("locked").read_only(), "x").unwrap();
    store.declare(ParameterDescriptor::new("group.inner"), 1).unwrap();
    store.declare(ParameterDescriptor::new("group.sub.deep"), 2).unwrap();
    store
}

#[test]
fn every_request_gets_the_recorded_reply() {
    for rmw in RMWS {
        let mut store = recorded_node();
        let mut asked = 0;
        for exchange in group(rmw, "parameter_services").chunks(2) {
            let [(topic, request), (_, recorded)] = exchange else { panic!("{exchange:?}") };
            let service = ParameterService::ALL
                .into_iter()
                .find(|service| *topic == format!("rq/params/{}Request", service.name()))
                .unwrap();
            let reply = store.answer(service, request, LIMIT).unwrap().to_bytes();
            let recorded = match service {
                ParameterService::Describe => clean::<DescribeParameters_Response>(rmw, recorded),
                ParameterService::Get => clean::<GetParameters_Response>(rmw, recorded),
                ParameterService::GetTypes => clean::<GetParameterTypes_Response>(rmw, recorded),
                ParameterService::List => clean::<ListParameters_Response>(rmw, recorded),
                ParameterService::Set => clean::<SetParameters_Response>(rmw, recorded),
                ParameterService::SetAtomically => {
                    clean::<SetParametersAtomically_Response>(rmw, recorded)
                }
            };
            assert_eq!(padded(&reply), recorded, "{rmw} {topic} {request:?}");
            asked += 1;
        }
        assert_eq!(asked, 12);
        // The atomic requests: one was accepted, one refused as a whole.
        assert_eq!(store.get("an_int").unwrap(), &ParameterValue::Integer(8));
        assert_eq!(store.get("a_double").unwrap(), &ParameterValue::Double(2.5));
    }
}

#[test]
fn declarations_make_the_recorded_events() {
    for rmw in RMWS {
        let mut store = recorded_node();
        let recorded = group(rmw, "parameter_events");
        assert_eq!(recorded.len(), 6);
        // The first event, of use_sim_time, was sent before the test listened.
        let events = store.take_events(Default::default()).into_iter().skip(1);
        for ((_, recorded), mut event) in recorded.into_iter().zip(events) {
            event.stamp = ParameterEvent::decode(&recorded, LIMIT).unwrap().stamp;
            let cdr = padded(&event.encode().to_bytes());
            assert_eq!(cdr, clean::<ParameterEvent>(rmw, &recorded), "{rmw} {event:?}");
        }
        assert!(store.take_events(Default::default()).is_empty());
    }
}

/// Texts that `ros2 param` printed for the same node, and the requests behind them.
#[test]
fn the_texts_of_ros2_param_come_out() {
    let mut store = recorded_node();
    let mut refused = |name: &str, value: ParameterValue| {
        store.set_atomically(vec![Parameter::new(name, value)]).unwrap_err().reason()
    };
    for (name, value, text) in [
        ("an_int", ParameterValue::NotSet, "Static parameter cannot be undeclared"),
        (
            "an_int",
            "text".into(),
            "Wrong parameter type, expected 'Type.INTEGER' got 'Type.STRING'",
        ),
        ("ranged", 11.into(), "Parameter ranged out of range. Min: 0, Max: 10, value: 11"),
        ("locked", "y".into(), "Trying to set a read-only parameter: locked."),
        ("missing", 1.into(), "Invalid access to undeclared parameter(s): []"),
        ("a_double", 2.into(), "Wrong parameter type, expected 'Type.DOUBLE' got 'Type.INTEGER'"),
    ] {
        assert_eq!(refused(name, value), text);
    }
    store.set("an_int", 7).unwrap();

    let names = ["ranged", "locked", "an_int"].map(str::to_owned).to_vec();
    let described = store.describe_parameters(&DescribeParameters_Request { names }).descriptors;
    let [ranged, locked, an_int] = described.as_slice() else { panic!("{described:?}") };
    assert_eq!((ranged.r#type, locked.r#type, an_int.r#type), (2, 4, 2));
    assert_eq!(ranged.description, "an int in a range");
    assert_eq!(ranged.additional_constraints, "even is nice");
    let range = &ranged.integer_range[0];
    assert_eq!((range.from_value, range.to_value, range.step), (0, 10, 1));
    assert_eq!((locked.read_only, an_int.read_only, an_int.dynamic_typing), (true, false, false));
    assert!(an_int.integer_range.is_empty() && ranged.floating_point_range.is_empty());
    assert_eq!(store.type_of("strings"), Some(ParameterType::StringArray));
}

#[test]
fn types_and_hashes_are_those_of_the_services() {
    let described: Vec<_> = ParameterService::ALL
        .into_iter()
        .map(|service| (service.name(), service.type_name()))
        .collect();
    // The order in which rclpy offers them.
    assert_eq!(
        described,
        [
            ("describe_parameters", "rcl_interfaces/srv/DescribeParameters"),
            ("get_parameters", "rcl_interfaces/srv/GetParameters"),
            ("get_parameter_types", "rcl_interfaces/srv/GetParameterTypes"),
            ("list_parameters", "rcl_interfaces/srv/ListParameters"),
            ("set_parameters", "rcl_interfaces/srv/SetParameters"),
            ("set_parameters_atomically", "rcl_interfaces/srv/SetParametersAtomically"),
        ]
    );
    let hashes = ParameterService::Describe.hashes();
    assert_eq!(hashes.request, DescribeParameters_Request::TYPE_HASH);
    assert_eq!(hashes.response, DescribeParameters_Response::TYPE_HASH);
}
