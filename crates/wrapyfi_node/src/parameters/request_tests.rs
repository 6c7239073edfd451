//! Requests beyond what the recorded node was asked: groups, limits, any bytes.

use std::collections::BTreeMap;

use bytes::Bytes;
use proptest::prelude::*;
use wrapyfi_interfaces::Message;
use wrapyfi_interfaces::rcl_interfaces::msg;
use wrapyfi_interfaces::rcl_interfaces::srv::{
    GetParameterTypes_Request, GetParameters_Request, ListParameters_Request,
    SetParameters_Request, SetParametersAtomically_Request,
};

use super::*;
use crate::{NodeName, ParameterValue};
use wrapyfi_data::types::Stamp;

fn store() -> ParameterStore {
    ParameterStore::new(&NodeName::new("node", "/ns").unwrap(), BTreeMap::new()).unwrap()
}

fn named(name: &str) -> ParameterDescriptor {
    ParameterDescriptor::new(name)
}

#[test]
fn groups_are_listed_by_depth() {
    let mut store = store();
    for name in ["b", "a.x", "a.b.y", "a.b.c.z", "ab.w", "a"] {
        store.declare(named(name), 1).unwrap();
    }
    let list = |prefixes: &[&str], depth| {
        let prefixes = prefixes.iter().map(|&prefix| prefix.to_owned()).collect();
        let found = store.list_parameters(&ListParameters_Request { prefixes, depth }).result;
        let skip = |names: Vec<String>| -> Vec<String> {
            names
                .into_iter()
                .filter(|name| !name.ends_with("_time") && !name.ends_with("_service"))
                .collect()
        };
        (skip(found.names), found.prefixes)
    };
    let owned = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect::<Vec<_>>();
    let all = (
        owned(&["b", "a.x", "a.b.y", "a.b.c.z", "ab.w", "a"]),
        owned(&["a", "a.b", "a.b.c", "ab"]),
    );
    assert_eq!(list(&[], 0), all);
    assert_eq!(list(&[], 1).0, owned(&["b", "a"]));
    assert_eq!(list(&[], 2), (owned(&["b", "a.x", "ab.w", "a"]), owned(&["a", "ab"])));
    assert_eq!(list(&["a"], 1), (owned(&["a.x", "a"]), owned(&["a"])));
    // A name that two prefixes find comes once.
    assert_eq!(list(&["a", "a.b"], 1), (owned(&["a.x", "a.b.y", "a"]), owned(&["a", "a.b"])));
    assert_eq!(list(&["a.b", "a.b"], 0), (owned(&["a.b.y", "a.b.c.z"]), owned(&["a.b", "a.b.c"])));
    assert_eq!(list(&["a."], 0).0.len(), 0);
    assert_eq!(list(&["a"], u64::MAX).0.len(), 4);
}

#[test]
fn requests_are_bounded() {
    let mut store = store();
    store.declare(named("big"), "x".repeat(MAX_VALUE_BYTES)).unwrap();
    let ask = |count| GetParameters_Request { names: vec!["big".to_owned(); count] };
    assert_eq!(store.get_parameters(&ask(15)).values.len(), 15);
    assert!(store.get_parameters(&ask(16)).values.is_empty());
    let names = vec!["use_sim_time".to_owned(); MAX_PARAMETERS + 1];
    assert!(
        store
            .get_parameter_types(&GetParameterTypes_Request { names: names.clone() })
            .types
            .is_empty()
    );
    let list = ListParameters_Request { prefixes: names, depth: 0 };
    assert!(store.list_parameters(&list).result.names.is_empty());

    let parameters = vec![msg::Parameter::default(); MAX_PARAMETERS + 1];
    let request = SetParameters_Request { parameters: parameters.clone() };
    let results = store.set_parameters(request).results;
    assert_eq!(results.len(), MAX_PARAMETERS + 1);
    let text = "4097 parameters in one request, the limit is 4096; send several requests";
    assert!(results.iter().all(|result| result.reason == text));
    let request = SetParametersAtomically_Request { parameters };
    assert_eq!(store.set_parameters_atomically(request).result.reason, text);

    let large = ParameterValue::from("x".repeat(MAX_VALUE_BYTES + 1));
    assert_eq!(
        store.set("big", large).unwrap_err().to_string(),
        "the value for parameter big has 1048577 bytes, the limit is 1048576"
    );
    for index in store.names().count()..MAX_PARAMETERS {
        store.declare(named(&format!("p{index}")), 1).unwrap();
    }
    let error = store.declare(named("more"), 1).unwrap_err().to_string();
    assert!(error.contains("at most 4096"), "{error}");
    // The test has not taken the events.
    let events = store.take_events(Stamp::default());
    assert_eq!(events.len(), MAX_EVENTS);
    assert_eq!(events.last().unwrap().new_parameters[0].name, "p4095");
    for _ in 0..20 {
        store.set("big", "x".repeat(MAX_VALUE_BYTES)).unwrap();
    }
    assert!(store.take_events(Stamp::default()).len() < 20);
}

#[test]
fn a_type_that_ros_has_not_is_refused() {
    let mut store = store();
    store.declare(named("p"), 1).unwrap();
    let value = msg::ParameterValue { r#type: 10, ..Default::default() };
    let one = |name: &str| msg::Parameter { name: name.into(), value: value.clone() };
    let request = SetParameters_Request { parameters: vec![one("p"), one("q")] };
    let results = store.set_parameters(request).results;
    assert_eq!(
        results[0].reason,
        "the value for parameter p has type 10; types are 0 (NOT_SET) to 9 (STRING_ARRAY)"
    );
    assert!(!results[1].successful);
}

proptest! {
    /// A client gets an answer or an error for any request, and a refused request leaves the store
    /// as it was.
    #[test]
    fn any_request_is_answered_or_refused(
        number in any::<i64>(),
        flips in proptest::collection::vec((any::<proptest::sample::Index>(), any::<u8>()), 0..4),
        bytes in proptest::collection::vec(any::<u8>(), 0..99),
    ) {
        let mut store = store();
        store.declare(named("a").with_integer_range(0, 10, 2), 4).unwrap();
        let a = msg::Parameter::from(Parameter::new("a", number % 12));
        let request = SetParameters_Request { parameters: vec![a.clone(), a] };
        let mut near = request.encode().to_bytes().to_vec();
        for (index, byte) in flips {
            let at = index.index(near.len());
            near[at] = byte;
        }
        for request in [Bytes::from(near), Bytes::from(bytes)] {
            for service in ParameterService::ALL {
                _ = store.answer(service, &request, 1024);
            }
            let ParameterValue::Integer(a) = *store.get("a").unwrap() else { panic!() };
            prop_assert!((0..=10).contains(&a) && a % 2 == 0);
        }
        prop_assert_eq!(store.names().count(), 3);
    }

    // On the wire a NUL ends a text.
    #[test]
    fn values_return_from_messages(
        number in any::<i64>(),
        texts in proptest::collection::vec("[^\\x00]{0,9}", 0..5),
    ) {
        for value in [
            ParameterValue::Integer(number),
            ParameterValue::Double(number as f64),
            ParameterValue::Bool(number % 2 == 0),
            ParameterValue::StringArray(texts.clone()),
            ParameterValue::ByteArray(number.to_le_bytes().to_vec()),
            ParameterValue::BoolArray(vec![true, false]),
            ParameterValue::String(texts.concat()),
            ParameterValue::IntegerArray(vec![number; 3]),
            ParameterValue::DoubleArray(vec![0.5]),
            ParameterValue::NotSet,
        ] {
            let message = msg::ParameterValue::from(value.clone());
            prop_assert_eq!(ParameterValue::try_from(message.clone()).unwrap(), value.clone());
            prop_assert!(message.encode().to_bytes().len() >= value.size());
        }
    }
}
