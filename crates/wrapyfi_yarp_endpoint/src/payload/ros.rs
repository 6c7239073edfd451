//! ROS messages: numbers, joints, and any other type as pairs of field and value.
//!
//! ```text
//!   std_msgs/msg/Float64MultiArray, Float32…, Int32…  ◀──▶  Vector, Matrix
//!   sensor_msgs/msg/JointState                        ◀──▶  positions; to `…/command:i` a movement
//!   sensor_msgs/msg/Imu, geometry_msgs/msg/WrenchStamped  ◀──▶  vectors of sensors
//!   tf2_msgs/msg/TFMessage                            ◀──▶  transforms
//!   sensor_msgs/msg/LaserScan, nav_msgs/msg/Odometry  ◀──▶  scans, odometries
//!   geometry_msgs/msg/Twist, TwistStamped             ──▶   velocities of a base (option base)
//!   sensor_msgs/msg/CameraInfo                        ◀──   pictures
//!   rosgraph_msgs/msg/Clock                           ◀──▶  two integers of the network clock
//!   any other  ◀──▶  (linear ((x 0.1) …)) (angular …)   or JSON (bottle: false)
//!   header.stamp                    ◀──▶  envelope
//! ```

use bytes::Bytes;
use wrapyfi_interfaces::dynamic::{DynamicMessage, DynamicValue};
use wrapyfi_yarp::Value as Element;

use super::super::intrinsics::CAMERA_INFO;
use super::super::options::BottleFormat;
use super::numbers::Width;
use super::rules::Rules;
use super::{base, camera, clock, command, fault, frames, joints, laser, native, numbers, sensors};
use wrapyfi_data::types::{Header, Map, RosMessage, RosType, Stamp, Value};
use wrapyfi_endpoint::TopicSpec;
use wrapyfi_endpoint::codec::{DecodeError, DecodeResult, EncodeResult, json};

/// Joints of a control board, and movements of them.
pub(crate) const JOINTS: &str = "sensor_msgs/msg/JointState";
/// Movements of joints, point by point.
pub(crate) const TRAJECTORY: &str = "trajectory_msgs/msg/JointTrajectory";
/// Time of a simulation.
pub(crate) const CLOCK: &str = "rosgraph_msgs/msg/Clock";
const IMU: &str = "sensor_msgs/msg/Imu";
const WRENCH: &str = "geometry_msgs/msg/WrenchStamped";
const FRAMES: &str = "tf2_msgs/msg/TFMessage";
const SCAN: &str = "sensor_msgs/msg/LaserScan";
const ODOMETRY: &str = "nav_msgs/msg/Odometry";
const TWIST: &str = "geometry_msgs/msg/Twist";
const TWIST_STAMPED: &str = "geometry_msgs/msg/TwistStamped";

/// Writes a message; its bytes, and the time of its header.
pub(super) fn encode(
    message: &RosMessage,
    spec: &TopicSpec,
    rules: Rules<'_>,
) -> EncodeResult<(Vec<u8>, Option<Stamp>)> {
    let fields = fields(message, spec)?;
    let name = message.ros_type.name();
    let bytes = match (name, Width::of(name), rules.options.bottle) {
        (_, _, Some(BottleFormat::Json)) => {
            native::bytes(&native::single(json::encode(&fields, &spec.plugins)?), rules.dialect)?
        }
        (JOINTS, _, None) if command::is_for(spec, rules.options) => {
            command::of_state(&fields, spec, rules)?
        }
        (JOINTS, _, None) => joints::write(&fields, &spec.topic, rules)?,
        (IMU, _, None) => sensors::write_imu(&fields, rules)?,
        (WRENCH, _, None) => sensors::write_wrench(&fields, rules)?,
        (FRAMES, _, None) => return frames::write(&fields, rules.dialect),
        (CLOCK, _, None) => clock::write(&fields, rules)?,
        (SCAN, _, None) => laser::write(&fields, rules)?,
        (ODOMETRY, _, None) => base::write_odometry(&fields, rules)?,
        (TWIST | TWIST_STAMPED, _, None) if let Some(base) = rules.options.base => {
            let twist = fields.get("twist").unwrap_or(&fields);
            base::write_velocity(twist, base, rules)?
        }
        (_, Some(width), None) => {
            numbers::write(numbers::of_fields(&fields, width)?, width, rules.dialect)?
        }
        _ => native::bytes(&rules.writer().bottle(&fields)?, rules.dialect)?,
    };
    Ok((bytes, Header::of_fields(&fields).map(|header| header.stamp)))
}

/// The fields of a message.
pub(in super::super) fn fields(message: &RosMessage, spec: &TopicSpec) -> EncodeResult<Value> {
    message.to_value(spec.limits.message_bytes).map_err(|error| {
        let what = format!("a malformed {}: {error}", message.ros_type);
        fault::unwritable("bottle", what, "$", "look at its publisher")
    })
}

/// Reads a message. `stamp` becomes that of its header where the bytes bring none.
pub(super) fn decode(
    bytes: &Bytes,
    ros_type: RosType,
    spec: &TopicSpec,
    rules: Rules<'_>,
    stamp: Stamp,
) -> DecodeResult<RosMessage> {
    let name = ros_type.name();
    let fields = match (name, Width::of(name), rules.options.bottle) {
        (JOINTS, _, None) => joints::read(bytes, rules)?,
        (IMU, _, None) => sensors::read_imu(bytes, rules)?,
        (WRENCH, _, None) => sensors::read_wrench(bytes, rules)?,
        (FRAMES, _, None) => frames::read(bytes, rules, stamp)?,
        (CLOCK, _, None) => clock::read(bytes, rules)?,
        (SCAN, _, None) => laser::read(bytes, rules)?,
        (ODOMETRY, _, None) => base::read_odometry(bytes, rules, stamp)?,
        (CAMERA_INFO, _, None) if let Some(size) = camera::size(bytes, rules.limits) => {
            camera::info(size, rules.options)?
        }
        (_, Some(width), None) => numbers::to_fields(numbers::read(bytes, rules)?, width)?,
        _ => pairs(bytes, ros_type, spec, rules)?,
    };
    let header = || Header { stamp, frame_id: rules.options.frame_id.clone() };
    RosMessage::from_value_with(ros_type, fields.into(), header, rules.limits.message_bytes)
        .map_err(|error| DecodeError::mismatch(ros_type.name(), format!("other fields: {error}")))
}

/// The fields in a dict: pairs of name and value, or JSON.
fn pairs(
    bytes: &Bytes,
    ros_type: RosType,
    spec: &TopicSpec,
    rules: Rules<'_>,
) -> DecodeResult<Map> {
    let bottle = native::bottle(bytes, rules)?;
    let format = match bottle.values.as_slice() {
        [Element::String(_)] => BottleFormat::Json,
        _ => BottleFormat::Property,
    };
    let value = native::decode(&bottle, format, &spec.plugins, rules)?;
    match named(value, &ros_type.plan().default_message()) {
        Value::Map(fields) => Ok(fields),
        other => Err(DecodeError::mismatch(
            format!("the fields of a {ros_type} as pairs (name value)"),
            format!("a {}", other.kind()),
        )),
    }
}

/// `value` with lists of pairs made dicts where the message has messages, since text carriers know no dicts, and with
/// truths for 1 and 0.
pub(super) fn named(value: Value, defaults: &DynamicMessage) -> Value {
    let map = match value {
        Value::Map(map) => map,
        Value::List(items) => match as_pairs(&items) {
            Some(map) => map,
            None => return Value::List(items),
        },
        other => return other,
    };
    let field = |(key, value): (Value, Value)| {
        let inner = key.as_str().and_then(|name| defaults.get(name));
        let value = match inner {
            Some(DynamicValue::Message(inner)) => named(value, inner),
            _ => truth(value, inner),
        };
        (key, value)
    };
    map.into_iter().map(field).collect::<Map>().into()
}

/// The numbers 1 and 0 as what a field that is true or false means by them: bottles of YARP often have no other form.
pub(super) fn truth(value: Value, field: Option<&DynamicValue>) -> Value {
    match (value, field) {
        (Value::Int(number @ (0 | 1)), Some(DynamicValue::Bool(_))) => (number == 1).into(),
        (value, _) => value,
    }
}

/// Lists of name and value as a dict.
pub(super) fn as_pairs(items: &[Value]) -> Option<Map> {
    let pair = |item: &Value| match item {
        Value::List(pair) => match pair.as_slice() {
            [key @ Value::Str(_), value] => Some((key.clone(), value.clone())),
            _ => None,
        },
        _ => None,
    };
    items.iter().map(pair).collect()
}
