//! Messages and hashes recorded from real ROS 2 nodes (`tests/data`).

use std::collections::BTreeMap;
use std::path::Path;

use bytes::Bytes;
use serde_json::{Value, json};

use crate::description::describe;
use crate::hash::{hashed_text, type_hash};
use crate::parser::{MessageDefinition, TypeName, parse_message};
use crate::test_data::{json as data, unhex};
use crate::{Message, builtin_interfaces, rmw_dds_common, sensor_msgs, std_msgs};

/// The generated modules again, with the odd shapes of `tests/data/interfaces`.
#[allow(dead_code, unreachable_pub)]
mod golden {
    include!(concat!(env!("OUT_DIR"), "/golden.rs"));
}
use golden::golden_msgs::msg as odd;

fn float(value: f64) -> Value {
    match value {
        v if v.is_nan() => json!("NaN"),
        v if v.is_infinite() => json!(if v > 0.0 { "Infinity" } else { "-Infinity" }),
        v => json!(v),
    }
}

/// Values as the vectors write them.
trait Recorded: Message {
    fn json(&self) -> Value;
}

macro_rules! recorded {
    ($($message:ty: $this:ident => $json:expr;)*) => {$(
        impl Recorded for $message {
            fn json(&self) -> Value {
                let $this = self;
                $json
            }
        }
    )*};
}

fn all<M: Recorded>(messages: &[M]) -> Vec<Value> {
    messages.iter().map(M::json).collect()
}

recorded! {
    builtin_interfaces::msg::Time: m => json!({"sec": m.sec, "nanosec": m.nanosec});
    builtin_interfaces::msg::Duration: m => json!({"sec": m.sec, "nanosec": m.nanosec});
    std_msgs::msg::String: m => json!({"data": m.data});
    std_msgs::msg::Header: m => json!({"stamp": m.stamp.json(), "frame_id": m.frame_id});
    golden::std_msgs::msg::Empty: _m => json!({});
    sensor_msgs::msg::Image: m => json!({
        "header": m.header.json(), "height": m.height, "width": m.width, "encoding": m.encoding,
        "is_bigendian": m.is_bigendian, "step": m.step, "data": m.data.to_vec()
    });
    sensor_msgs::msg::CompressedImage: m => json!({
        "header": m.header.json(), "format": m.format, "data": m.data.to_vec()
    });
    crate::wrapyfi_ros2_interfaces::msg::ROS2AudioMessage: m => json!({
        "header": m.header.json(), "chunk_size": m.chunk_size, "channels": m.channels,
        "sample_rate": m.sample_rate, "encoding": m.encoding, "is_bigendian": m.is_bigendian,
        "bitrate": m.bitrate, "coding_format": m.coding_format, "step": m.step,
        "data": m.data.to_vec()
    });
    rmw_dds_common::msg::Gid: m => json!({"data": m.data});
    rmw_dds_common::msg::NodeEntitiesInfo: m => json!({
        "node_namespace": m.node_namespace, "node_name": m.node_name,
        "reader_gid_seq": all(&m.reader_gid_seq), "writer_gid_seq": all(&m.writer_gid_seq)
    });
    rmw_dds_common::msg::ParticipantEntitiesInfo: m => json!({
        "gid": m.gid.json(), "node_entities_info_seq": all(&m.node_entities_info_seq)
    });
    odd::Inner: m => json!({"tag": m.tag, "value": float(m.value), "name": m.name});
    odd::Tiny: m => json!({"a": m.a});
    odd::EmptyHolder: m => json!({
        "nothing": m.nothing.json(), "nothings": all(&m.nothings), "after": m.after
    });
    odd::Alignment: m => json!({
        "u8": m.u8, "u16": m.u16, "u8b": m.u8b, "u32": m.u32, "u8c": m.u8c, "u64": m.u64,
        "flag": m.flag, "f32": float(m.f32.into()), "i8": m.i8, "f64": float(m.f64), "s": m.s,
        "f64_seq": m.f64_seq.iter().copied().map(float).collect::<Vec<_>>(), "u8d": m.u8d,
        "inner_seq": all(&m.inner_seq), "inner_arr": all(&m.inner_arr),
        "tiny_seq": all(&m.tiny_seq), "u64_seq": m.u64_seq, "last": m.last
    });
    odd::Limits: m => json!({
        "i8": m.i8, "i16": m.i16, "i32": m.i32, "i64": m.i64, "u8": m.u8, "u16": m.u16,
        "u32": m.u32, "u64": m.u64, "f32": float(m.f32.into()), "f64": float(m.f64),
        "text": m.text, "triple": m.triple,
        "numbers": m.numbers.iter().copied().map(float).collect::<Vec<_>>(),
        "flags": m.flags, "words": m.words
    });
}

/// Decodes `cdr`, compares with the recorded values and gives the bytes of encoding it again.
fn round_trip<M: Recorded>(case: &Value, cdr: &[u8]) -> Vec<u8> {
    assert_eq!(M::ROS_TYPE, case["type"]);
    let message = M::decode(&Bytes::copy_from_slice(cdr), cdr.len()).unwrap();
    assert_eq!(message.json(), case["values"], "{case}");
    let parts = message.encode();
    assert_eq!(parts.len(), parts.to_bytes().len());
    if case["case"] == "default" {
        assert_eq!(M::default(), message, "{case}");
    }
    parts.to_bytes().to_vec()
}

fn round_trip_any(case: &Value, cdr: &[u8]) -> Vec<u8> {
    match case["type"].as_str().unwrap() {
        "builtin_interfaces/msg/Time" => round_trip::<builtin_interfaces::msg::Time>(case, cdr),
        "builtin_interfaces/msg/Duration" => {
            round_trip::<builtin_interfaces::msg::Duration>(case, cdr)
        }
        "std_msgs/msg/Header" => round_trip::<std_msgs::msg::Header>(case, cdr),
        "std_msgs/msg/String" => round_trip::<std_msgs::msg::String>(case, cdr),
        "std_msgs/msg/Empty" => round_trip::<golden::std_msgs::msg::Empty>(case, cdr),
        "sensor_msgs/msg/Image" => round_trip::<sensor_msgs::msg::Image>(case, cdr),
        "sensor_msgs/msg/CompressedImage" => {
            round_trip::<sensor_msgs::msg::CompressedImage>(case, cdr)
        }
        "wrapyfi_ros2_interfaces/msg/ROS2AudioMessage" => {
            round_trip::<crate::wrapyfi_ros2_interfaces::msg::ROS2AudioMessage>(case, cdr)
        }
        "rmw_dds_common/msg/Gid" => round_trip::<rmw_dds_common::msg::Gid>(case, cdr),
        "rmw_dds_common/msg/NodeEntitiesInfo" => {
            round_trip::<rmw_dds_common::msg::NodeEntitiesInfo>(case, cdr)
        }
        "rmw_dds_common/msg/ParticipantEntitiesInfo" => {
            round_trip::<rmw_dds_common::msg::ParticipantEntitiesInfo>(case, cdr)
        }
        "golden_msgs/msg/Alignment" => round_trip::<odd::Alignment>(case, cdr),
        "golden_msgs/msg/EmptyHolder" => round_trip::<odd::EmptyHolder>(case, cdr),
        "golden_msgs/msg/Inner" => round_trip::<odd::Inner>(case, cdr),
        "golden_msgs/msg/Limits" => round_trip::<odd::Limits>(case, cdr),
        "golden_msgs/msg/Tiny" => round_trip::<odd::Tiny>(case, cdr),
        other => panic!("no struct for {other}"),
    }
}

#[test]
fn recorded_messages_decode_to_their_values_and_encode_to_their_bytes() {
    let cases = data("cdr.json");
    let cases = cases.as_array().unwrap();
    assert_eq!(cases.len(), 88);
    for case in cases {
        let cyclone = unhex(case["hex"].as_str().unwrap());
        assert_eq!(round_trip_any(case, &cyclone), cyclone, "{case}");
        // Fast DDS leaves garbage in the padding and behind the message.
        if let Some(fast) = case["hex_rmw_fastrtps_cpp"].as_str() {
            assert_eq!(round_trip_any(case, &unhex(fast)), cyclone, "{case}");
        }
    }
}

#[test]
fn messages_of_wrapyfi_decode_to_their_values_and_encode_to_their_bytes() {
    let cases = data("wrapyfi.json");
    let cases = cases.as_array().unwrap();
    assert_eq!(cases.len(), 27);
    for case in cases {
        let recorded = unhex(case["hex"].as_str().unwrap());
        let mut encoded = round_trip_any(case, &recorded);
        encoded.resize(encoded.len().next_multiple_of(4), 0);
        assert_eq!(encoded, recorded, "{case}");
    }
}

#[test]
fn discovery_samples_decode_and_encode_to_their_bytes() {
    let gid = |gid: &rmw_dds_common::msg::Gid| -> String {
        let hex = |bytes: &[u8]| bytes.iter().map(|b| format!("{b:02x}")).collect::<String>();
        format!("{}:{}", hex(&gid.data[..12]), hex(&gid.data[12..]))
    };
    let gids = |value: &Value| -> Vec<String> {
        let entry = |v: &Value| v["gid"].as_str().unwrap().to_owned();
        value.as_array().unwrap().iter().map(entry).collect()
    };
    let samples = data("ros_discovery_info.json");
    for sample in samples.as_array().unwrap() {
        let cdr = Bytes::from(unhex(sample["hex"].as_str().unwrap()));
        let info = rmw_dds_common::msg::ParticipantEntitiesInfo::decode(&cdr, 1 << 16).unwrap();
        let recorded = &sample["decoded"];
        assert_eq!(gid(&info.gid), recorded["gid"]);
        let nodes = recorded["node_entities_info_seq"].as_array().unwrap();
        assert_eq!(info.node_entities_info_seq.len(), nodes.len());
        for (node, recorded) in info.node_entities_info_seq.iter().zip(nodes) {
            assert_eq!(node.node_namespace, recorded["node_namespace"]);
            assert_eq!(node.node_name, recorded["node_name"]);
            let readers: Vec<_> = node.reader_gid_seq.iter().map(gid).collect();
            assert_eq!(readers, gids(&recorded["reader_gid_seq"]));
            let writers: Vec<_> = node.writer_gid_seq.iter().map(gid).collect();
            assert_eq!(writers, gids(&recorded["writer_gid_seq"]));
        }
        if sample["rmw"] == "rmw_cyclonedds_cpp" {
            assert_eq!(info.encode().to_bytes(), cdr);
        }
    }
}

#[test]
fn a_listener_announces_itself_with_these_bytes() {
    let gid = |entity: [u8; 4]| {
        let mut data = *b"\x01\x10\x6e\x5b\x4c\xbe\x47\xbf\xc9\xa8\xc3\xe6\0\0\0\0";
        data[12..].copy_from_slice(&entity);
        rmw_dds_common::msg::Gid { data }
    };
    let info = rmw_dds_common::msg::ParticipantEntitiesInfo {
        gid: gid([0, 0, 1, 0xc1]),
        node_entities_info_seq: vec![rmw_dds_common::msg::NodeEntitiesInfo {
            node_namespace: "/".into(),
            node_name: "listener".into(),
            reader_gid_seq: vec![],
            writer_gid_seq: vec![gid([0, 0, 6, 3])],
        }],
    };
    let expected = "00010000\
        01106e5b4cbe47bfc9a8c3e6000001c1\
        01000000\
        020000002f000000\
        090000006c697374656e657200000000\
        00000000\
        0100000001106e5b4cbe47bfc9a8c3e600000603";
    assert_eq!(info.encode().to_bytes(), unhex(expected));
}

#[test]
fn names_and_hashes_are_those_of_ros() {
    fn check<M: Message>(hashes: &Value, dds: &str) {
        assert_eq!(M::TYPE_HASH, hashes[M::ROS_TYPE], "{}", M::ROS_TYPE);
        assert_eq!(M::DDS_TYPE, dds);
    }
    let hashes = data("type_hashes.json");
    check::<builtin_interfaces::msg::Time>(&hashes, "builtin_interfaces::msg::dds_::Time_");
    check::<builtin_interfaces::msg::Duration>(&hashes, "builtin_interfaces::msg::dds_::Duration_");
    check::<std_msgs::msg::Header>(&hashes, "std_msgs::msg::dds_::Header_");
    check::<std_msgs::msg::String>(&hashes, "std_msgs::msg::dds_::String_");
    check::<golden::std_msgs::msg::Empty>(&hashes, "std_msgs::msg::dds_::Empty_");
    check::<sensor_msgs::msg::Image>(&hashes, "sensor_msgs::msg::dds_::Image_");
    check::<sensor_msgs::msg::CompressedImage>(&hashes, "sensor_msgs::msg::dds_::CompressedImage_");
    check::<sensor_msgs::msg::CameraInfo>(&hashes, "sensor_msgs::msg::dds_::CameraInfo_");
    check::<sensor_msgs::msg::LaserScan>(&hashes, "sensor_msgs::msg::dds_::LaserScan_");
    check::<golden::nav_msgs::msg::Odometry>(&hashes, "nav_msgs::msg::dds_::Odometry_");
    check::<golden::geometry_msgs::msg::TwistStamped>(
        &hashes,
        "geometry_msgs::msg::dds_::TwistStamped_",
    );
    check::<rmw_dds_common::msg::Gid>(&hashes, "rmw_dds_common::msg::dds_::Gid_");
    check::<rmw_dds_common::msg::NodeEntitiesInfo>(
        &hashes,
        "rmw_dds_common::msg::dds_::NodeEntitiesInfo_",
    );
    check::<rmw_dds_common::msg::ParticipantEntitiesInfo>(
        &hashes,
        "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_",
    );
    check::<crate::wrapyfi_ros2_interfaces::msg::ROS2AudioMessage>(
        &hashes,
        "wrapyfi_ros2_interfaces::msg::dds_::ROS2AudioMessage_",
    );
    check::<odd::Alignment>(&hashes, "golden_msgs::msg::dds_::Alignment_");
    check::<odd::EmptyHolder>(&hashes, "golden_msgs::msg::dds_::EmptyHolder_");
    check::<odd::Inner>(&hashes, "golden_msgs::msg::dds_::Inner_");
    check::<odd::Limits>(&hashes, "golden_msgs::msg::dds_::Limits_");
    check::<odd::Tiny>(&hashes, "golden_msgs::msg::dds_::Tiny_");
}

#[test]
fn bounds_and_wide_strings_are_described_as_ros_does() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data");
    let mut definitions: BTreeMap<TypeName, MessageDefinition> = BTreeMap::new();
    for (name, path) in
        [("Bounded", "Bounded.msg"), ("Inner", "interfaces/golden_msgs/msg/Inner.msg")]
    {
        let name = TypeName::new("golden_msgs", name).unwrap();
        let text = std::fs::read_to_string(root.join(path)).unwrap();
        definitions.insert(name.clone(), parse_message(&name, &text).unwrap());
    }
    let bounded = &definitions[&TypeName::new("golden_msgs", "Bounded").unwrap()];
    let description = describe(bounded, &definitions).unwrap();
    let name = "golden_msgs/msg/Bounded";
    assert_eq!(hashed_text(&description), data("hash_inputs.json")[name]["canonical_json"]);
    assert_eq!(type_hash(&description), data("type_hashes.json")[name]);

    definitions.retain(|name, _| name.name() == "Bounded");
    let bounded = definitions.values().next().unwrap();
    assert_eq!(
        describe(bounded, &definitions).unwrap_err().to_string(),
        "golden_msgs/msg/Inner is not defined, but golden_msgs/msg/Bounded has a field \
         \"inners\" of that type"
    );
}

#[test]
fn constants_are_generated() {
    assert_eq!((odd::Limits::ANSWER, odd::Limits::HELLO), (42, "hello"));
    assert_eq!((odd::Limits::PI.to_string().as_str(), odd::Limits::SMALL), ("3.14159", 15));
    assert_eq!(odd::Limits::YES.to_string(), "true");
}

/// Words that Rust keeps for itself are names of fields, types and packages in ROS.
#[test]
fn words_of_rust_are_names() {
    let reserved = odd::Reserved {
        r#type: 1,
        self_: 2,
        r#yield: 3,
        last: golden::crate_::msg::Self_ { super_: 4 },
        ..odd::Reserved::default()
    };
    let cdr = reserved.encode().to_bytes();
    assert_eq!(odd::Reserved::decode(&cdr, 1024).unwrap(), reserved);
    assert_eq!(golden::crate_::msg::Self_::ROS_TYPE, "crate/msg/Self");
    let cut = odd::Reserved::decode(&cdr.slice(..6), 1024).unwrap_err().to_string();
    assert!(cut.contains("as"), "{cut}");
}
