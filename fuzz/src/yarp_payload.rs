//! The target of what YARP's ports bring: payloads, requests and replies.

#![allow(clippy::indexing_slicing, reason = "every index is below the length")]

use bytes::Bytes;
use wrapyfi_data::types::{MessageType, RosType, ServiceKind, Stamp};
use wrapyfi_endpoint::codec::EncodeError;
use wrapyfi_endpoint::{ServiceSpec, TopicSpec};
use wrapyfi_interfaces::store::TypeStore;
use wrapyfi_yarp::Dialect;
use wrapyfi_yarp::port::PortPayload;
use wrapyfi_yarp_endpoint::options::{BottleFormat, YarpOptions};
use wrapyfi_yarp_endpoint::payload;

use crate::{LIMITS, bounded};

/// Memory for each byte: a list of numbers of one byte becomes an element and a value for each, and
/// both a second time in a list that grows.
const ELEMENT: usize = 320;
/// Room for what is packed inside, such as arrays in JSON.
const UNPACKED: usize = 8 * LIMITS.message_bytes;

const NOW: Stamp = Stamp { sec: 1, nanosec: 2 };
const ROS: [&str; 9] = [
    "std_msgs/msg/Float64MultiArray",
    "sensor_msgs/msg/JointState",
    "std_msgs/msg/Header",
    "sensor_msgs/msg/Imu",
    "geometry_msgs/msg/WrenchStamped",
    "tf2_msgs/msg/TFMessage",
    "sensor_msgs/msg/LaserScan",
    "sensor_msgs/msg/CameraInfo",
    "nav_msgs/msg/Odometry",
];
/// Types with angles.
const TURNED: [&str; 4] = [
    "sensor_msgs/msg/JointState",
    "sensor_msgs/msg/Imu",
    "sensor_msgs/msg/LaserScan",
    "nav_msgs/msg/Odometry",
];

/// A message of a topic, or of a service where bit 7 of the first byte is set; its other bits choose
/// the type. The second byte chooses the options and the dialect.
pub fn yarp_payload(data: &[u8]) {
    let [choice, form, body @ ..] = data else { return };
    let dialect = if form & 1 == 0 { Dialect::V3 } else { Dialect::V4 };
    let bottle =
        [None, Some(BottleFormat::Json), Some(BottleFormat::Bottle), Some(BottleFormat::Property)];
    let options = YarpOptions {
        bottle: bottle[usize::from(form >> 1 & 3)],
        packed_rows: form & 8 != 0,
        wrapyfi_images: form & 16 != 0,
        ..YarpOptions::default()
    };
    let bytes = Bytes::copy_from_slice(body);
    let choice_of = usize::from(choice & 0x7f);
    if choice & 0x80 != 0 {
        service(&bytes, choice_of, &options, dialect);
    } else {
        topic(&bytes, choice_of, form & 32 != 0, &options, dialect);
    }
}

fn topic(bytes: &Bytes, choice: usize, raw: bool, options: &YarpOptions, dialect: Dialect) {
    let ros = |name: &&str| RosType::new(&TypeStore::generated().resolve_name(name).ok()?).ok();
    let types = ROS.iter().filter_map(ros).map(MessageType::Ros);
    let types: Vec<_> = MessageType::ALL.into_iter().chain(types).collect();
    let spec = TopicSpec { limits: LIMITS, ..TopicSpec::new("/t", types[choice % types.len()]) };
    let sent =
        if raw { PortPayload::raw(bytes.clone()) } else { PortPayload::object(bytes.clone()) };
    let size = bytes.len() + UNPACKED / ELEMENT;
    let read = |sent: &PortPayload, spec: &TopicSpec| {
        payload::decode(sent, None, spec, options, dialect, NOW)
    };
    let Ok(first) = bounded(size, ELEMENT, || read(&sent, &spec)) else { return };
    // A message that was read may be longer when written.
    let mut wide = spec.clone();
    wide.limits.message_bytes *= 16;
    let written = match payload::encode(&first, &wide, options, dialect) {
        Ok(written) => written.payload,
        // Bytes have no form in JSON, and some pictures none in JPEG or on ports of Wrapyfi.
        Err(EncodeError::Unrepresentable { .. }) => return,
        Err(error) => panic!("what was read cannot be written: {error}"),
    };
    let again = read(&written, &wide).expect("its own bytes");
    let rewritten = payload::encode(&again, &wide, options, dialect).expect("what was read");
    // Degrees and radians differ in the last digit.
    if !TURNED.contains(&spec.message_type.ros_type()) {
        assert!(written == rewritten.payload, "changed by writing and reading");
    }
}

fn service(bytes: &Bytes, choice: usize, options: &YarpOptions, dialect: Dialect) {
    let set = ServiceKind::resolve("std_srvs/srv/SetBool", &mut TypeStore::generated()).ok();
    let kinds: Vec<_> = ServiceKind::ALL.into_iter().chain(set).collect();
    let mut spec = ServiceSpec::new("/s", kinds[choice / 2 % kinds.len()]);
    spec.limits = LIMITS;
    let size = bytes.len() + UNPACKED / ELEMENT;
    if choice & 1 == 0 {
        _ = bounded(size, ELEMENT, || payload::decode_request(bytes, &spec, options, dialect));
    } else {
        _ = bounded(size, ELEMENT, || {
            payload::decode_reply(bytes, &spec, options, dialect, NOW).is_ok()
        });
    }
}
