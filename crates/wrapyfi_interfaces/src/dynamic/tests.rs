use bytes::Bytes;
use proptest::collection::vec;
use proptest::prelude::*;
use serde_json::{Value, json};

use super::*;
use crate::parser::{Dialect, TypeName};
use crate::store::ResolvedType;
use crate::{Message, test_data};

const LIMIT: usize = 1 << 20;

fn resolved(text: &str) -> ResolvedType {
    let name = TypeName::new("demo_msgs", "Thing").unwrap();
    ResolvedType::from_text(Dialect::Ros2, &name, text).unwrap()
}

fn plan(text: &str) -> TypePlan {
    resolved(text).plan().unwrap()
}

fn plan_of(name: &str) -> TypePlan {
    test_data::store().resolve_name(name).unwrap().plan().unwrap()
}

fn refuse(plan: &TypePlan, json: &Value) -> String {
    plan.from_json(json, LIMIT).unwrap_err().to_string()
}

#[test]
fn fields_are_read_and_changed_by_path() {
    let mut joints = plan_of("sensor_msgs/msg/JointState").default_message();
    assert_eq!(joints.type_name(), "sensor_msgs/msg/JointState");
    joints.set("header.stamp.sec", -5).unwrap();
    joints.set("header.frame_id", "base").unwrap();
    joints.set("name", vec!["a".to_owned(), "b".to_owned()]).unwrap();
    joints.set("position", vec![0.5, 1.0]).unwrap();
    let header = joints.get("header.stamp").unwrap();
    assert_eq!(
        format!("{header:?}"),
        "Message(builtin_interfaces/msg/Time { sec: I32(-5), nanosec: U32(0) })"
    );
    assert_eq!(joints.get("header.stamp.sec").unwrap().as_integer(), Some(-5));
    assert_eq!(joints.get("header.frame_id").unwrap().as_str(), Some("base"));
    assert_eq!(joints.get("position"), Some(&vec![0.5, 1.0].into()));
    assert_eq!(joints.get("position.x"), None);
    let names: Vec<&str> = joints.fields().map(|(name, _)| name).collect();
    assert_eq!(names, ["header", "name", "position", "velocity", "effort"]);
    assert_eq!(
        joints.set("header.stamp.second", 1).unwrap_err().to_string(),
        "header.stamp.second: builtin_interfaces/msg/Time has no such field; did you mean \"sec\"?"
    );
    assert_eq!(
        joints.set("position", vec![1_u8]).unwrap_err().to_string(),
        "position: needs float64[], found 1 uint8"
    );
    assert_eq!(
        joints.set("name.first", "x").unwrap_err().to_string(),
        "name.first: needs a message with the field \"first\", found 2 string"
    );
    let header = plan_of("std_msgs/msg/Header").default_message();
    joints.set("header", header).unwrap();
    let time = plan_of("builtin_interfaces/msg/Time").default_message();
    assert!(matches!(joints.set("header", time), Err(ValueError::Kind { .. })));
}

#[test]
fn bounds_and_counts_are_checked_where_values_are_made() {
    let plan =
        plan("string<=3 s\nwstring<=2 w\nuint8[<=2] few\nint16[3] three\nstring<=3[] many\n");
    let mut message = plan.default_message();
    message.set("s", "éàü").unwrap();
    let error = |result: Result<(), ValueError>| result.unwrap_err().to_string();
    assert_eq!(error(message.set("s", "four")), "s has 4 characters, it must have at most 3");
    assert_eq!(error(message.set("w", "a😀")), "w has 3 characters, it must have at most 2");
    assert_eq!(
        error(message.set("few", vec![1_u8, 2, 3])),
        "few has 3 elements, it must have at most 2"
    );
    assert_eq!(
        error(message.set("three", vec![1_i16])),
        "three has 1 elements, it must have exactly 3"
    );
    assert_eq!(
        error(message.set("many", vec!["a".to_owned(), "long".to_owned()])),
        "many[1] has 4 characters, it must have at most 3"
    );
    assert_eq!(
        refuse(&plan, &json!({"many": ["a", "long"]})),
        "many[1] has 4 characters, it must have at most 3"
    );
    assert_eq!(
        refuse(&plan, &json!({"three": [1, 2]})),
        "three has 2 elements, it must have exactly 3"
    );
}

#[test]
fn json_errors_name_path_value_and_remedy() {
    let plan = plan_of("geometry_msgs/msg/PoseArray");
    assert_eq!(
        refuse(&plan, &json!({"poses": [{}, {"positon": {}}]})),
        "poses[1].positon: geometry_msgs/msg/Pose has no such field; did you mean \"position\"?"
    );
    assert_eq!(
        refuse(&plan, &json!({"qqq": 1})),
        "qqq: geometry_msgs/msg/PoseArray has no such field"
    );
    assert_eq!(
        refuse(&plan, &json!({"poses": [{"position": {"x": "one"}}]})),
        "poses[0].position.x: needs a number, \"NaN\", \"Infinity\" or \"-Infinity\" for float64, \
         found the string \"one\""
    );
    assert_eq!(
        refuse(&plan, &json!({"header": {"stamp": {"nanosec": -1}}})),
        "header.stamp.nanosec: -1 is no uint32, which goes from 0 to 4294967295"
    );
    assert_eq!(
        refuse(&plan, &json!({"header": {"stamp": {"sec": 1.5}}})),
        "header.stamp.sec: needs an integer for int32, found the number 1.5"
    );
    assert_eq!(
        refuse(&plan, &json!({"header": []})),
        "header: needs an object with the fields of std_msgs/msg/Header, found an array of 0 \
         elements"
    );
    assert_eq!(
        refuse(&plan, &json!(null)),
        "needs an object with the fields of geometry_msgs/msg/PoseArray, found null"
    );
    let plan = self::plan("float32 f\nuint8[] bytes\nuint64 big\nbool yes\n");
    assert_eq!(
        refuse(&plan, &json!({"f": 1e39})),
        format!("f: {} is no float32, which goes from -3.4028235e38 to 3.4028235e38", 1e39)
    );
    assert_eq!(
        refuse(&plan, &json!({"bytes": [1, 256]})),
        "bytes[1]: 256 is no uint8, which goes from 0 to 255"
    );
    assert_eq!(
        refuse(&plan, &json!({"bytes": "AQI="})),
        "bytes: needs an array for uint8[], found the string \"AQI=\""
    );
    assert_eq!(refuse(&plan, &json!({"yes": 1})), "yes: needs true or false, found the number 1");
    let message =
        plan.from_json(&json!({"big": u64::MAX, "f": "-Infinity", "bytes": [2.0]}), LIMIT);
    let message = message.unwrap();
    assert_eq!(message.get("big").unwrap().as_integer(), Some(u64::MAX.into()));
    assert_eq!(message.get("bytes"), Some(&Bytes::from_static(&[2]).into()));
    assert_eq!(
        serde_json::to_string(&message).unwrap(),
        r#"{"f":"-Infinity","bytes":[2],"big":18446744073709551615,"yes":false}"#
    );
}

#[test]
fn short_json_cannot_become_a_large_message() {
    let plan = plan(
        "Big[] many\n========\nMSG: demo_msgs/Big\nuint8[1000000] a\nstring text \"default\"\n",
    );
    let error = plan.from_json(&json!({"many": [{}, {}]}), LIMIT).unwrap_err();
    assert_eq!(error, ValueError::TooLarge { path: "many".into(), limit: LIMIT });
    plan.from_json(&json!({"many": [{}]}), LIMIT).unwrap();
    let plan = plan_of("std_msgs/msg/String");
    let error = plan.from_json(&json!({"data": "x".repeat(100)}), 100).unwrap_err();
    assert_eq!(error, ValueError::TooLarge { path: "data".into(), limit: 100 });
}

#[test]
fn large_bytes_are_shared_both_ways() {
    let plan = plan_of("sensor_msgs/msg/Image");
    let mut image = plan.default_message();
    let data = Bytes::from(vec![7; 1 << 20]);
    image.set("data", data.clone()).unwrap();
    let parts = plan.encode(&image).unwrap();
    assert!(parts.pieces().iter().any(|piece| piece.as_ptr() == data.as_ptr()));
    let cdr = parts.to_bytes();
    let decoded = plan.decode(&cdr, cdr.len()).unwrap();
    let Some(DynamicValue::Primitives(Primitives::Bytes(shared))) = decoded.get("data") else {
        panic!("{decoded:?}")
    };
    assert_eq!(shared.as_ptr(), cdr[cdr.len() - data.len()..].as_ptr());
    // The struct made at build time sees the same message.
    let image = crate::sensor_msgs::msg::Image::decode(&cdr, cdr.len()).unwrap();
    assert_eq!(image.data, data);
    let other = plan_of("std_msgs/msg/String").encode(&decoded).unwrap_err();
    assert_eq!(other.to_string(), "needs std_msgs/msg/String, found sensor_msgs/msg/Image");
}

#[test]
fn small_definitions_cannot_become_large_messages() {
    assert_eq!(
        resolved("Inner[1] inner\n========\nMSG: demo_msgs/Inner\nfloat64[1073741824] x\n")
            .plan()
            .unwrap_err()
            .to_string(),
        "demo_msgs/msg/Inner has at least 8589934592 bytes, over the limit of 67108864; use \
         sequences for its largest arrays"
    );
    // Each level doubles: small text, huge message.
    let levels: String =
        (1..60).map(|i| format!("========\nMSG: demo_msgs/L{i}\nL{}[2] a\n", i + 1)).collect();
    let doubling = format!("L1[2] first\n{levels}========\nMSG: demo_msgs/L60\nuint8 x\n");
    let error = resolved(&doubling).plan().unwrap_err().to_string();
    assert!(error.contains("values, over the limit of 1048576"), "{error}");
}

#[test]
fn plans_are_compared_by_what_they_hold() {
    let text = "uint8 a\nInner[] inner\n========\nMSG: demo_msgs/Inner\nfloat64[4] x\n";
    let one = plan(text);
    let mut message = plan(text).default_message();
    message.set("a", 3_u8).unwrap();
    assert_eq!(one, plan(text));
    one.encode(&message).unwrap();
    let other = plan(&text.replace("[4] x", "[4] y"));
    assert_eq!(
        other.encode(&message).unwrap_err().to_string(),
        "needs demo_msgs/msg/Thing, found another definition of the same name"
    );
    // Each level refers to the next twice: 2^60 ways down.
    let levels: String = (1..=60)
        .map(|i| format!("========\nMSG: demo_msgs/L{i}\nL{0}[] a\nL{0}[] b\n", i + 1))
        .collect();
    let text = format!("L1 first\n{levels}========\nMSG: demo_msgs/L61\nuint8 x\n");
    assert_eq!(plan(&text), plan(&text));
    let message = plan(&text).default_message();
    assert_eq!(plan(&text).decode(&message.encode().to_bytes(), LIMIT).unwrap(), message);
}

#[test]
fn few_bytes_cannot_become_many_messages() {
    let nested = |depth: usize| {
        let levels: String =
            (1..depth).map(|i| format!("========\nMSG: demo_msgs/L{i}\nL{} a\n", i + 1)).collect();
        resolved(&format!("L1[] many\n{levels}========\nMSG: demo_msgs/L{depth}\nuint8 x\n")).plan()
    };
    nested(10).unwrap();
    assert_eq!(
        nested(40).unwrap_err().to_string(),
        "demo_msgs/msg/L25 nests 17 values around 1 bytes, over the limit of 16; use fewer messages"
    );
}

#[test]
fn runs_are_padded_from_wherever_they_start() {
    // The text moves the run behind it through all eight phases.
    let plan =
        plan("string s\nuint8 a\nuint64 b\nuint16 c\nfloat32 d\nbool e\nint8 f\nfloat64 g\n");
    for length in 0..9 {
        let mut message = plan.default_message();
        message.set("s", "x".repeat(length)).unwrap();
        for (name, value) in [("b", DynamicValue::U64(u64::MAX)), ("g", (-0.5).into())] {
            message.set(name, value).unwrap();
        }
        message.set("c", 0x1234_u16).unwrap();
        message.set("d", 2.5_f32).unwrap();
        message.set("f", -1_i8).unwrap();
        let cdr = message.encode().to_bytes();
        assert_eq!(plan.decode(&cdr, LIMIT).unwrap(), message);
        for cut in 0..cdr.len() {
            assert!(plan.decode(&cdr.slice(..cut), LIMIT).is_err());
        }
    }
}

#[test]
fn a_message_is_small() {
    assert!(size_of::<DynamicValue>() <= 40, "{}", size_of::<DynamicValue>());
}

proptest! {
    #[test]
    fn any_bytes_are_read_or_refused(
        mut bytes in vec(any::<u8>(), 0..200),
        small in vec(0_u8..4, 0..200),
        order in 0_u8..3,
    ) {
        // Small numbers make lengths that fit.
        for (byte, small) in bytes.iter_mut().zip(small) {
            if *byte & 1 == 0 { *byte = small; }
        }
        for (byte, header) in bytes.iter_mut().zip([0, order]) {
            *byte = header;
        }
        let cdr = Bytes::from(bytes);
        for name in ["test_msgs/msg/Arrays", "test_msgs/msg/WStrings", "golden_msgs/msg/Bounded",
            "golden_msgs/msg/EmptyHolder", "sensor_msgs/msg/PointCloud2", "golden_msgs/msg/Alignment"]
        {
            let plan = PLANS.with(|plans| plans.iter().find(|p| p.type_name() == name).unwrap().clone());
            if let Ok(message) = plan.decode(&cdr, LIMIT) {
                let again = message.encode().to_bytes();
                let decoded = plan.decode(&again, LIMIT).unwrap();
                prop_assert_eq!(decoded.encode().to_bytes(), again);
            }
        }
    }

    #[test]
    fn values_return_through_cdr_and_json(
        u8 in any::<u8>(), u16: u16, u64: u64, flag: bool, f32: f32, f64: f64, s in "[^\0]{0,20}",
        f64_seq in vec(any::<f64>(), 0..9), u64_seq in vec(any::<u64>(), 0..9),
        names in vec("[^\0]{0,9}", 0..4),
    ) {
        let plan = PLANS.with(|plans| {
            plans.iter().find(|p| p.type_name() == "golden_msgs/msg/Alignment").unwrap().clone()
        });
        let mut message = plan.default_message();
        message.set("u8", u8).unwrap();
        message.set("u16", u16).unwrap();
        message.set("u64", u64).unwrap();
        message.set("flag", flag).unwrap();
        message.set("f32", f32).unwrap();
        message.set("f64", f64).unwrap();
        message.set("s", s).unwrap();
        message.set("f64_seq", f64_seq).unwrap();
        message.set("u64_seq", u64_seq).unwrap();
        let Some(DynamicValue::Messages(pair)) = message.get("inner_arr") else { unreachable!() };
        let inner = pair[0].clone();
        let inners: Vec<DynamicMessage> = names.into_iter().map(|name| {
            let mut inner = inner.clone();
            inner.set("name", name).unwrap();
            inner
        }).collect();
        message.set("inner_seq", inners).unwrap();
        let cdr = plan.encode(&message).unwrap().to_bytes();
        prop_assert_eq!(&plan.decode(&cdr, cdr.len()).unwrap().encode().to_bytes(), &cdr);
        let text = serde_json::to_string(&message).unwrap();
        let json: Value = serde_json::from_str(&text).unwrap();
        let from_json = plan.from_json(&json, LIMIT).unwrap();
        prop_assert_eq!(from_json.encode().to_bytes(), cdr);
    }
}

thread_local! {
    /// Compiled once for all cases of the properties.
    static PLANS: Vec<TypePlan> = {
        let mut store = test_data::store();
        ["test_msgs/msg/Arrays", "test_msgs/msg/WStrings", "golden_msgs/msg/Bounded",
            "golden_msgs/msg/EmptyHolder", "sensor_msgs/msg/PointCloud2", "golden_msgs/msg/Alignment"]
            .iter()
            .map(|name| store.resolve_name(name).unwrap().plan().unwrap())
            .collect()
    };
}
