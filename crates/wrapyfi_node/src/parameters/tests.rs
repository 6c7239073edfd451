//! Cases that the recorded node does not have: overrides, ranges, dynamic types, watches.

use std::collections::BTreeMap;
use std::time::Duration;

use bytes::Bytes;
use wrapyfi_interfaces::rcl_interfaces::srv::{GetParameterTypes_Request, GetParameters_Request};

use super::*;
use crate::{NodeName, ParameterType, ParameterValue};
use wrapyfi_data::types::Stamp;
use wrapyfi_endpoint::Wake;

fn node() -> NodeName {
    NodeName::new("node", "/ns").unwrap()
}

fn store_with(overrides: &[(&str, ParameterValue)]) -> ParameterStore {
    let overrides = overrides.iter().map(|(name, value)| ((*name).to_owned(), value.clone()));
    ParameterStore::new(&node(), overrides.collect()).unwrap()
}

fn store() -> ParameterStore {
    store_with(&[])
}

fn named(name: &str) -> ParameterDescriptor {
    ParameterDescriptor::new(name)
}

fn declare_error(
    overrides: &[(&str, ParameterValue)],
    descriptor: ParameterDescriptor,
    default: impl Into<ParameterValue>,
) -> String {
    store_with(overrides).declare(descriptor, default).unwrap_err().to_string()
}

#[test]
fn every_node_has_two_switches() {
    let store = store();
    let names: Vec<_> = store.names().collect();
    assert_eq!(names, ["use_sim_time", "start_type_description_service"]);
    assert!(store.describe("start_type_description_service").unwrap().read_only);
    let overrides = BTreeMap::from([("use_sim_time".to_owned(), ParameterValue::from("maybe"))]);
    let error = ParameterStore::new(&node(), overrides).unwrap_err().to_string();
    assert_eq!(
        error,
        "Trying to set parameter 'use_sim_time' to 'maybe' of type 'STRING', expecting type \
         'BOOL': write -p use_sim_time:=true or false"
    );
}

#[test]
fn overrides_win_where_they_fit() {
    let mut store = store_with(&[
        ("rate", 30.into()),
        ("names", ParameterValue::NotSet),
        ("locked", "from outside".into()),
        ("anything", vec![1_i64].into()),
        ("ratte", 1.into()),
    ]);
    let rate = named("rate").with_integer_range(1, 60, 1);
    assert_eq!(store.declare(rate, 10).unwrap(), ParameterValue::Integer(30));
    let names = store.declare(named("names"), vec!["a".to_owned()]).unwrap();
    assert_eq!(names, ParameterValue::StringArray(vec![]));
    store.declare(named("locked").read_only(), "default").unwrap();
    assert_eq!(store.get("locked").unwrap(), &ParameterValue::from("from outside"));
    store.declare(named("anything").dynamic(), ParameterValue::NotSet).unwrap();
    assert_eq!(store.type_of("anything"), Some(ParameterType::IntegerArray));
    let unused: Vec<_> = store.unused_overrides().map(|(name, _)| name).collect();
    assert_eq!(unused, ["ratte"]);

    for (given, default, text) in [
        (
            ParameterValue::from("fast"),
            ParameterValue::from(1),
            "Trying to set parameter 'p' to 'fast' of type 'STRING', expecting type 'INTEGER': \
             write -p p:=5",
        ),
        (
            2.into(),
            1.5.into(),
            "Trying to set parameter 'p' to '2' of type 'INTEGER', expecting type 'DOUBLE': write \
             -p p:=2.0",
        ),
        (
            5.into(),
            "x".into(),
            "Trying to set parameter 'p' to '5' of type 'INTEGER', expecting type 'STRING': write \
             -p p:='\"5\"'",
        ),
        (
            ParameterValue::NotSet,
            1.into(),
            "Trying to set parameter 'p' to 'not set' of type 'NOT_SET', expecting type 'INTEGER': \
             write -p p:=5",
        ),
    ] {
        assert_eq!(declare_error(&[("p", given)], named("p"), default), text);
    }
    assert_eq!(
        declare_error(&[("p", 61.into())], named("p").with_integer_range(1, 60, 1), 10),
        "parameter p cannot be what the command line or a parameter file says: Parameter p out of \
         range. Min: 1, Max: 60, value: 61"
    );
    let long = declare_error(&[("p", "x".repeat(10_000).into())], named("p"), 1);
    assert!(long.len() < 300, "{long}");
}

#[test]
fn declarations_are_checked() {
    let error = |descriptor, default: ParameterValue| declare_error(&[], descriptor, default);
    assert_eq!(error(named(""), 1.into()), "a parameter has an empty name; give it one");
    assert!(error(named(&"x".repeat(1025)), 1.into()).contains("1025 bytes, the limit is 1024"));
    assert!(error(named("a\0b"), 1.into()).contains("NUL"));
    assert_eq!(
        error(named("use_sim_time"), true.into()),
        "parameter use_sim_time is declared already; declare it once"
    );
    assert!(error(named("p"), ParameterValue::NotSet).contains("has no type"));
    assert_eq!(
        error(named("p").with_type(ParameterType::Double), 1.into()),
        "parameter p is declared as DOUBLE, but its default value is INTEGER"
    );
    assert_eq!(
        error(named("p").with_double_range(0.0, 1.0, 0.0), 1.into()),
        "parameter p is INTEGER, but its range is one of DOUBLE"
    );
    assert_eq!(
        error(named("p").with_integer_range(0, 1, 0), 2.into()),
        "parameter p cannot have its default value: Parameter p out of range. Min: 0, Max: 1, \
         value: 2"
    );
    // A refused one leaves nothing behind.
    let mut store = store();
    store.declare(named("p").with_integer_range(0, 1, 0), 2).unwrap_err();
    assert!(store.describe("p").is_none());
    store.declare(named("p"), 2).unwrap();
}

#[test]
fn a_typed_parameter_waits_for_its_value() {
    let mut store = store();
    store.declare(named("p").with_type(ParameterType::Double), ParameterValue::NotSet).unwrap();
    let text = store.get("p").unwrap_err().to_string();
    assert_eq!(text, "parameter p has no value yet; give one with -p p:=… or `ros2 param set`");
    let names = vec!["p".to_owned()];
    assert!(
        store.get_parameters(&GetParameters_Request { names: names.clone() }).values.is_empty()
    );
    let types = store.get_parameter_types(&GetParameterTypes_Request { names });
    assert_eq!(types.types, Bytes::from_static(&[0]));
    assert!(matches!(store.set("p", 1).unwrap_err(), SetError::WrongType { .. }));
    _ = store.take_events(Stamp::default());
    store.set("p", 1.5).unwrap();
    let events = store.take_events(Stamp { sec: 3, nanosec: 4 });
    assert_eq!((events.len(), events[0].new_parameters.len()), (1, 1));
    assert_eq!((events[0].stamp.sec, events[0].node.as_str()), (3, "/ns/node"));
    store.set("p", 2.5).unwrap();
    assert_eq!(store.take_events(Stamp::default())[0].changed_parameters.len(), 1);
    assert!(matches!(store.get("q"), Err(GetError::NotDeclared { .. })));
}

#[test]
fn dynamic_parameters_change_their_type_and_go() {
    let mut store = store();
    store.declare(named("p").dynamic().with_integer_range(0, 10, 5), 5).unwrap();
    assert!(matches!(store.set("p", 7).unwrap_err(), SetError::Range(_)));
    store.set("p", "text").unwrap();
    assert_eq!(store.describe("p").unwrap().parameter_type, ParameterType::String);
    let wake = Wake::new();
    let watch = store.watch(&[], &wake);
    _ = store.take_events(Stamp::default());
    store.set("p", ParameterValue::NotSet).unwrap();
    assert!(store.describe("p").is_none());
    assert_eq!(store.take_events(Stamp::default())[0].deleted_parameters[0].name, "p");
    assert_eq!(watch.take(), [Parameter::new("p", ParameterValue::NotSet)]);
    // It can be declared again, and stands at the end then.
    store.declare(named("p"), 1).unwrap();
    assert_eq!(store.names().last(), Some("p"));
}

#[test]
fn ranges_have_ends_steps_and_tolerance() {
    let mut store = store();
    store.declare(named("i").with_integer_range(10, -9, 4), -9).unwrap();
    for (value, good) in
        [(-9, true), (-5, true), (-4, false), (10, true), (11, false), (-10, false)]
    {
        assert_eq!(store.set("i", value).is_ok(), good, "{value}");
    }
    let all = named("all").with_integer_range(i64::MIN, i64::MAX, u64::MAX);
    store.declare(all, i64::MIN).unwrap();
    store.set("all", i64::MAX).unwrap();
    assert!(store.set("all", 0).is_err());
    store.declare(named("third").with_integer_range(0, 9, 3), 3).unwrap();
    assert_eq!(
        store.set("third", 4).unwrap_err().to_string(),
        "The parameter value for third is not a valid step. Min: 0, max: 9, value: 4, step: 3"
    );
    store.declare(named("d").with_double_range(0.0, 1.0, 0.1), 0.0).unwrap();
    for (value, good) in [
        (0.3, true),
        (0.1 + 0.2, true),
        (0.35, false),
        (1.0 + 1e-9, true),
        (1.1, false),
        (f64::NAN, false),
        (f64::INFINITY, false),
    ] {
        assert_eq!(store.set("d", value).is_ok(), good, "{value}");
    }
    assert_eq!(
        store.set("d", 2.0).unwrap_err().to_string(),
        "Parameter d out of range Min: 0.0, Max: 1.0, value: 2.0"
    );
    assert_eq!(
        store.set("d", 0.25).unwrap_err().reason(),
        "The parameter value for d is not close enough to a valid step. Min: 0.0, max: 1.0, value: \
         0.25, step: 0.1"
    );
    store.declare(named("open").with_double_range(0.0, f64::INFINITY, 0.0), 1.0).unwrap();
    store.set("open", f64::INFINITY).unwrap();
    assert_eq!(
        store.set("open", -1e20).unwrap_err().to_string(),
        "Parameter open out of range Min: 0.0, Max: inf, value: -1e+20"
    );
}

#[test]
fn an_atomic_request_sets_all_or_none() {
    let mut store = store();
    store.declare(named("a"), 1).unwrap();
    store.declare(named("b"), 2).unwrap();
    _ = store.take_events(Stamp::default());
    let both =
        |a: ParameterValue, b: ParameterValue| vec![Parameter::new("a", a), Parameter::new("b", b)];
    store.set_atomically(both(5.into(), "x".into())).unwrap_err();
    assert_eq!(store.get("a").unwrap(), &ParameterValue::Integer(1));
    let twice = vec![Parameter::new("a", 5), Parameter::new("a", 6)];
    assert_eq!(store.set_atomically(twice), Err(SetError::Twice("a".into())));
    assert!(store.take_events(Stamp::default()).is_empty());
    store.set_atomically(both(5.into(), 6.into())).unwrap();
    let events = store.take_events(Stamp::default());
    assert_eq!((events.len(), events[0].changed_parameters.len()), (1, 2));
    store.set_atomically(vec![]).unwrap();
    assert!(store.take_events(Stamp::default()).is_empty());
}

#[test]
fn watches_tell_the_newest_of_what_they_watch() {
    let mut store = store();
    let wake = Wake::new();
    let watch = store.watch(&["camera"], &wake);
    let all = store.watch(&[], &Wake::new());
    store.declare(named("camera.rate"), 1).unwrap();
    store.declare(named("cameras"), 1).unwrap();
    store.set("camera.rate", 2).unwrap();
    store.set("camera.rate", 3).unwrap();
    assert!(wake.wait(Duration::ZERO));
    assert_eq!(watch.take(), [Parameter::new("camera.rate", 3)]);
    assert_eq!(all.take().len(), 2);
    store.set("cameras", 2).unwrap();
    assert!(!wake.wait(Duration::ZERO));
    assert!(watch.take().is_empty());
    drop(watch);
    store.set("camera.rate", 4).unwrap();
    assert!(!wake.wait(Duration::ZERO));
}
