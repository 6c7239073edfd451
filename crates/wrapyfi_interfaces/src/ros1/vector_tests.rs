//! Every standard type against messages that ROS 1's genpy and rosbags wrote
//! (`test/peers/ros1_vectors.py`).

use std::collections::BTreeMap;

use hmac_sha256::Hash;
use serde_json::Value;

use super::standard_text::names;
use super::tests::service;
use super::{Options, PairPlan, Rules, Transcoded, Types};
use crate::parser::{Dialect, TypeName};
use crate::store::TypeStore;
use crate::test_data::{path, unhex};

fn vectors() -> Vec<Value> {
    let text = std::fs::read_to_string(path("ros1.jsonl")).unwrap();
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

fn text<'v>(vector: &'v Value, key: &str) -> &'v str {
    vector[key].as_str().unwrap()
}

fn sha256(text: &str) -> String {
    Hash::hash(text.as_bytes()).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Plans by the part they are for, with checksum and text.
fn plans(types: &mut Types, vector: &Value) -> (BTreeMap<&'static str, PairPlan>, String, String) {
    let name = text(vector, "type");
    if text(vector, "kind") == "srv" {
        let (definition, ros2, [request, response]) = service(types, name);
        assert_eq!(ros2.name().to_string(), text(vector, "ros2"));
        let plans = BTreeMap::from([("Request", request), ("Response", response)]);
        return (plans, definition.md5sum, definition.text);
    }
    let definition = types.definition(name).unwrap();
    let plan = types.plan(&definition).unwrap_or_else(|error| panic!("{name}: {error}"));
    assert_eq!(plan.ros2_type().to_string(), text(vector, "ros2"));
    let plans = BTreeMap::from([("", plan)]);
    (plans, definition.md5sum, definition.text)
}

#[test]
fn messages_of_every_type_go_to_cdr_and_back() {
    let options = Options::default();
    let mut types = Types::new(Rules::built_in(), TypeStore::empty());
    let vectors = vectors();
    let made_by_hand = names().filter(|(_, package, _)| *package == "wrapyfi_services").count();
    assert_eq!(vectors.len(), names().count() - made_by_hand);
    let (mut cdr, mut ros1, mut wrapped, mut messages) = (Vec::new(), Vec::new(), 0, 0);
    for vector in &vectors {
        let name = text(vector, "type");
        let (plans, _, _) = plans(&mut types, vector);
        for message in vector["messages"].as_array().unwrap() {
            let plan = &plans[text(message, "part")];
            let bytes = unhex(text(message, "ros1"));
            cdr.clear();
            let done = plan.to_cdr(&bytes, &options, &mut cdr);
            let done = done.unwrap_or_else(|error| panic!("{name}: {error}"));
            assert_eq!(cdr, unhex(text(message, "cdr")), "{name}");
            let seq = u32::try_from(message["seq"].as_u64().unwrap()).unwrap();
            ros1.clear();
            let back = plan.to_ros1(&cdr, seq, &options, &mut ros1);
            assert_eq!(back, Ok(done), "{name}");
            let expected = message["back"].as_str().map_or(bytes, unhex);
            assert_eq!(ros1, expected, "{name}");
            assert_eq!(Transcoded { wrapped_times: 0, ..done }, Transcoded::default(), "{name}");
            wrapped += done.wrapped_times;
            messages += 1;
        }
    }
    assert!(messages > 350 && wrapped > 50, "{messages} messages, {wrapped} wrapped times");
}

#[test]
fn checksums_and_texts_are_those_of_ros1() {
    let mut types = Types::new(Rules::built_in(), TypeStore::empty());
    for vector in &vectors() {
        let (_, md5, shown) = plans(&mut types, vector);
        let name = text(vector, "type");
        assert_eq!(md5, text(vector, "md5"), "{name}");
        assert_eq!(sha256(&shown), text(vector, "text"), "{name}:\n{shown}");
    }
}

#[test]
fn types_that_ros2_has_have_its_hash_without_a_ros2() {
    let mut types = Types::new(Rules::built_in(), TypeStore::empty());
    let mut checked = 0;
    for vector in vectors().iter().filter(|vector| vector["hash"].is_string()) {
        let definition = types.definition(text(vector, "type")).unwrap();
        let ros2 = types.ros2_type(&definition.resolved).unwrap();
        assert_eq!(ros2.type_hash(), text(vector, "hash"), "{:?}", ros2.definition());
        checked += 1;
    }
    assert!(checked > 150, "{checked}");
}

#[test]
fn types_of_an_installed_ros2_are_taken_and_give_the_same() {
    let options = Options::default();
    let mut installed = Types::new(Rules::built_in(), crate::test_data::store());
    let mut found = 0;
    for vector in &vectors() {
        let name = TypeName::parse(Dialect::Ros2, text(vector, "ros2")).unwrap();
        if crate::test_data::store().resolve(&name).is_err() {
            continue;
        }
        let (plans, _, _) = plans(&mut installed, vector);
        for message in vector["messages"].as_array().unwrap() {
            let mut cdr = Vec::new();
            let bytes = unhex(text(message, "ros1"));
            plans[text(message, "part")].to_cdr(&bytes, &options, &mut cdr).unwrap();
            // In ROS 2 services have fields that ROS 1 lacks.
            if text(vector, "kind") == "msg" {
                assert_eq!(cdr, unhex(text(message, "cdr")), "{name}");
            }
        }
        found += 1;
    }
    assert!(found > 90, "{found}");
}
