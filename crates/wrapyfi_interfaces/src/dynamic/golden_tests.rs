//! Every interface of ROS 2 against what its nodes serialised.

use std::collections::BTreeMap;

use bytes::Bytes;
use serde_json::Value;

use super::shape::ElementShape;
use super::{DynamicMessage, DynamicValue, Primitives, TypePlan};
use crate::cdr::CdrError;
use crate::parser::Container;
use crate::store::TypeStore;
use crate::test_data::{json, path, store, unhex};

const LIMIT: usize = 1 << 20;

/// Plans by type, compiled when first asked for.
struct Plans {
    store: TypeStore,
    compiled: BTreeMap<String, TypePlan>,
}

impl Plans {
    fn new() -> Self {
        Self { store: store(), compiled: BTreeMap::new() }
    }

    fn of(&mut self, name: &str) -> &TypePlan {
        let store = &mut self.store;
        self.compiled
            .entry(name.to_owned())
            .or_insert_with(|| store.resolve_name(name).unwrap().plan().unwrap())
    }
}

fn hex(value: &Value) -> Bytes {
    unhex(value.as_str().unwrap()).into()
}

/// Vectors of every package.
fn cases() -> Vec<Value> {
    let mut files: Vec<_> =
        std::fs::read_dir(path("cdr")).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    files.sort();
    let files = files.iter().map(|file| file.to_str().unwrap());
    files
        .filter(|file| *file != "edge_cases.json")
        .flat_map(|file| match json(&format!("cdr/{file}")) {
            Value::Array(cases) => cases,
            other => panic!("{other}"),
        })
        .collect()
}

#[test]
fn every_recorded_message_decodes_to_its_values_and_encodes_to_its_bytes() {
    let mut plans = Plans::new();
    let cases = cases();
    assert_eq!(cases.len(), 1735);
    for case in cases {
        let name = case["type"].as_str().unwrap();
        let label = format!("{name} {}", case["case"]);
        let plan = plans.of(name);
        let cyclone = hex(&case["hex"]);
        let message = plan.decode(&cyclone, LIMIT).unwrap();
        assert_eq!(message.to_json(), case["values"], "{label}");
        assert_eq!(plan.encode(&message).unwrap().to_bytes(), cyclone, "{label}");
        let from_json = plan.from_json(&case["values"], LIMIT).unwrap();
        assert_eq!(from_json.encode().to_bytes(), cyclone, "{label}");
        if case["case"] == "default" {
            assert_eq!(plan.default_message().encode().to_bytes(), cyclone, "{label}");
            let nothing = plan.from_json(&serde_json::json!({}), LIMIT).unwrap();
            assert_eq!(nothing.encode().to_bytes(), cyclone, "{label}");
        }
        // Fast DDS leaves garbage in the padding and behind the message.
        if let Some(fast) = case.get("hex_rmw_fastrtps_cpp") {
            let message = plan.decode(&hex(fast), LIMIT).unwrap();
            assert_eq!(message.encode().to_bytes(), cyclone, "{label}");
        }
        assert!(cyclone.len() >= 4 + plan.min_size(), "{label}");
        let truncated = plan.decode(&cyclone.slice(..cyclone.len() - 1), LIMIT);
        assert!(truncated.is_err(), "{label}: {truncated:?}");
    }
}

#[test]
fn odd_input_gives_what_ros_gives_or_an_error() {
    // Refused on purpose: we never replace characters, and XCDR2 is another encoding.
    let refused = ["String invalid UTF-8", "String encapsulation CDR2_BE 0006, body big-endian"];
    let mut plans = Plans::new();
    let edge_cases = json("cdr/edge_cases.json");
    for case in edge_cases["decode"].as_array().unwrap() {
        let label = case["case"].as_str().unwrap();
        let decoded = plans.of(case["type"].as_str().unwrap()).decode(&hex(&case["hex"]), LIMIT);
        let results: Vec<&Value> = ["both", "rmw_cyclonedds_cpp", "rmw_fastrtps_cpp"]
            .iter()
            .filter_map(|rmw| case.get(rmw))
            .map(|outcome| &outcome["result"])
            .collect();
        match decoded {
            Ok(message) => assert!(results.contains(&&message.to_json()), "{label}: {message:?}"),
            Err(error) => {
                let refused = refused.contains(&label) || results.iter().any(|r| r.is_null());
                assert!(refused, "{label}: {error}");
            }
        }
    }
    for case in edge_cases["encode"].as_array().unwrap() {
        let outcome = case.get("both").unwrap_or(&case["rmw_cyclonedds_cpp"]);
        let Some(bytes) = outcome.get("hex") else { continue };
        let label = case["case"].as_str().unwrap();
        let name = if label.starts_with("std_msgs/String") {
            "std_msgs/msg/String"
        } else {
            "golden_msgs/msg/Bounded"
        };
        let message = plans.of(name).decode(&hex(bytes), LIMIT).unwrap();
        assert_eq!(message.encode().to_bytes(), hex(bytes), "{label}");
    }
}

/// A plain big-endian encoder, written from the rules of the vectors.
struct BigEndian(Vec<u8>);

impl BigEndian {
    fn number<const N: usize>(&mut self, bytes: [u8; N]) {
        self.0.resize(4 + (self.0.len() - 4).next_multiple_of(N), 0xa5);
        self.0.extend(bytes);
    }

    fn count(&mut self, count: usize) {
        self.number((count as u32).to_be_bytes());
    }

    fn text(&mut self, wide: bool, text: &str) {
        if wide {
            let units: Vec<u16> = text.encode_utf16().collect();
            self.count(units.len());
            units.iter().for_each(|unit| self.number(u32::from(*unit).to_be_bytes()));
        } else {
            self.count(text.len() + 1);
            self.0.extend(text.bytes());
            self.0.push(0);
        }
    }

    fn primitives(&mut self, values: &Primitives) {
        match values {
            Primitives::Bool(v) => v.iter().for_each(|v| self.0.push(u8::from(*v))),
            Primitives::Bytes(v) => self.0.extend(v),
            Primitives::I8(v) => v.iter().for_each(|v| self.number(v.to_be_bytes())),
            Primitives::I16(v) => v.iter().for_each(|v| self.number(v.to_be_bytes())),
            Primitives::U16(v) => v.iter().for_each(|v| self.number(v.to_be_bytes())),
            Primitives::I32(v) => v.iter().for_each(|v| self.number(v.to_be_bytes())),
            Primitives::U32(v) => v.iter().for_each(|v| self.number(v.to_be_bytes())),
            Primitives::I64(v) => v.iter().for_each(|v| self.number(v.to_be_bytes())),
            Primitives::U64(v) => v.iter().for_each(|v| self.number(v.to_be_bytes())),
            Primitives::F32(v) => v.iter().for_each(|v| self.number(v.to_be_bytes())),
            Primitives::F64(v) => v.iter().for_each(|v| self.number(v.to_be_bytes())),
        }
    }

    fn message(&mut self, message: &DynamicMessage) {
        for (field, value) in message.shape.fields.iter().zip(&message.values) {
            let counted = matches!(field.container, Container::Sequence { .. });
            let wide = matches!(field.element, ElementShape::Text { wide: true, .. });
            match value {
                DynamicValue::Bool(v) => self.0.push(u8::from(*v)),
                DynamicValue::I8(v) => self.number(v.to_be_bytes()),
                DynamicValue::U8(v) => self.number(v.to_be_bytes()),
                DynamicValue::I16(v) => self.number(v.to_be_bytes()),
                DynamicValue::U16(v) => self.number(v.to_be_bytes()),
                DynamicValue::I32(v) => self.number(v.to_be_bytes()),
                DynamicValue::U32(v) => self.number(v.to_be_bytes()),
                DynamicValue::I64(v) => self.number(v.to_be_bytes()),
                DynamicValue::U64(v) => self.number(v.to_be_bytes()),
                DynamicValue::F32(v) => self.number(v.to_be_bytes()),
                DynamicValue::F64(v) => self.number(v.to_be_bytes()),
                DynamicValue::Text(text) => self.text(wide, text),
                DynamicValue::Message(message) => self.message(message),
                DynamicValue::Primitives(values) => {
                    if counted {
                        self.count(values.len());
                    }
                    self.primitives(values);
                }
                DynamicValue::Texts(texts) => {
                    if counted {
                        self.count(texts.len());
                    }
                    texts.iter().for_each(|text| self.text(wide, text));
                }
                DynamicValue::Messages(messages) => {
                    if counted {
                        self.count(messages.len());
                    }
                    messages.iter().for_each(|message| self.message(message));
                }
            }
        }
        if message.values.is_empty() {
            self.0.push(0);
        }
    }
}

#[test]
fn big_endian_messages_decode_as_little_endian_ones() {
    let mut plans = Plans::new();
    for case in cases() {
        let plan = plans.of(case["type"].as_str().unwrap());
        let little = plan.decode(&hex(&case["hex"]), LIMIT).unwrap();
        let mut big = BigEndian(vec![0, 0, 0, 0]);
        big.message(&little);
        let decoded = plan.decode(&big.0.into(), LIMIT).unwrap();
        // As bytes, since NaN is not equal to itself.
        assert_eq!(decoded.encode().to_bytes(), hex(&case["hex"]), "{}", case["type"]);
    }
}

/// Nodes of ROS 2 Lyrical send a device's buffer as a mark, the maker and a description.
#[test]
fn a_buffer_of_a_device_is_told_from_a_lie() {
    let mut plans = Plans::new();
    let plan = plans.of("std_msgs/msg/UInt8MultiArray");
    // No dimensions, no offset; the mark, the length of "cuda" with its NUL, and its letters.
    let cdr = hex(&"000100000000000000000000ffffffff050000006375646100000000".into());
    let error = plan.decode(&cdr, LIMIT).unwrap_err().to_string();
    assert!(error.starts_with("data claims 4294967295 elements"), "{error}");
    assert!(error.contains("the memory of a device (rosidl::Buffer)"), "{error}");
}

#[test]
fn a_lie_about_a_length_names_its_field() {
    let mut plans = Plans::new();
    let plan = plans.of("std_msgs/msg/Float64MultiArray");
    let cdr = hex(&"000100000000000000000000ffffff7f00000000000000000000f03f".into());
    assert_eq!(
        plan.decode(&cdr, LIMIT).unwrap_err(),
        CdrError::Length {
            path: "data".into(),
            claimed: 0x7fff_ffff,
            needed: 0x7fff_ffff * 8,
            available: 12
        }
    );
    let plan = plans.of("geometry_msgs/msg/PoseStamped");
    let mut cdr = plan.default_message().encode().to_bytes();
    cdr.truncate(4 + 16 + 24 + 12);
    assert_eq!(
        plan.decode(&cdr, LIMIT).unwrap_err(),
        CdrError::Truncated { path: "pose.orientation.y".into(), needed: 8, available: 4 }
    );
    assert_eq!(
        plan.decode(&cdr, 8).unwrap_err(),
        CdrError::TooLarge { actual: cdr.len(), limit: 8 }
    );
}
