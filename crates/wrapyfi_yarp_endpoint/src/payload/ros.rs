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
//!   any other  ◀──▶  (linear ((x 0.1) …)) (angular …)   or JSON (bottle: false)
//!   header.stamp                    ◀──▶  envelope
//! ```

use bytes::Bytes;
use wrapyfi_interfaces::dynamic::{DynamicMessage, DynamicValue};
use wrapyfi_yarp::{Dialect, Value as Element};

use super::super::intrinsics::CAMERA_INFO;
use super::super::options::{BottleFormat, YarpOptions};
use super::element::Writer;
use super::numbers::Width;
use super::{base, camera, command, fault, frames, joints, laser, native, numbers, sensors};
use wrapyfi_data::types::{Header, Map, RosMessage, RosType, Stamp, Value};
use wrapyfi_endpoint::TopicSpec;
use wrapyfi_endpoint::codec::{DecodeError, EncodeError, json};

/// Joints of a control board, and movements of them.
pub(crate) const JOINTS: &str = "sensor_msgs/msg/JointState";
/// Movements of joints, point by point.
pub(crate) const TRAJECTORY: &str = "trajectory_msgs/msg/JointTrajectory";
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
    options: &YarpOptions,
    dialect: Dialect,
) -> Result<(Vec<u8>, Option<Stamp>), EncodeError> {
    let fields = fields(message, spec)?;
    let name = message.ros_type.name();
    let bytes = match (name, Width::of(name), options.bottle) {
        (_, _, Some(BottleFormat::Json)) => {
            native::bytes(&native::single(json::encode_with(&fields, &spec.plugins)?), dialect)?
        }
        (JOINTS, _, None) if command::is_for(spec, options) => {
            command::of_state(&fields, spec, options, dialect)?
        }
        (JOINTS, _, None) => joints::write(&fields, options, dialect)?,
        (IMU, _, None) => sensors::write_imu(&fields, options, dialect)?,
        (WRENCH, _, None) => sensors::write_wrench(&fields, dialect)?,
        (FRAMES, _, None) => return frames::write(&fields, dialect),
        (SCAN, _, None) => laser::write(&fields, options, dialect)?,
        (ODOMETRY, _, None) => base::write_odometry(&fields, options, dialect)?,
        (TWIST | TWIST_STAMPED, _, None) if let Some(base) = options.base => {
            let twist = fields.get("twist").unwrap_or(&fields);
            base::write_velocity(twist, base, options, dialect)?
        }
        (_, Some(width), None) => {
            numbers::write(numbers::of_fields(&fields, width)?, width, dialect)?
        }
        _ => native::bytes(&Writer { dialect, limits: &spec.limits }.bottle(&fields)?, dialect)?,
    };
    Ok((bytes, Header::of_fields(&fields).map(|header| header.stamp)))
}

/// The fields of a message.
pub(super) fn fields(message: &RosMessage, spec: &TopicSpec) -> Result<Value, EncodeError> {
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
    options: &YarpOptions,
    dialect: Dialect,
    stamp: Stamp,
) -> Result<RosMessage, DecodeError> {
    let limits = &spec.limits;
    let name = ros_type.name();
    let fields = match (name, Width::of(name), options.bottle) {
        (JOINTS, _, None) => joints::read(bytes, options, dialect, limits)?,
        (IMU, _, None) => sensors::read_imu(bytes, options, dialect, limits)?,
        (WRENCH, _, None) => sensors::read_wrench(bytes, options, dialect, limits)?,
        (FRAMES, _, None) => frames::read(bytes, dialect, limits, stamp)?,
        (SCAN, _, None) => laser::read(bytes, options, dialect, limits)?,
        (ODOMETRY, _, None) => base::read_odometry(bytes, options, dialect, limits, stamp)?,
        (CAMERA_INFO, _, None) if let Some(size) = camera::size(bytes, limits) => {
            camera::info(size, options)?
        }
        (_, Some(width), None) => {
            numbers::to_fields(numbers::read(bytes, dialect, limits)?, width)?
        }
        _ => pairs(bytes, ros_type, spec, dialect)?,
    };
    let header = || Header { stamp, frame_id: options.frame_id.clone() };
    RosMessage::from_value_with(ros_type, fields.into(), header, limits.message_bytes)
        .map_err(|error| fault::mismatch(ros_type.name(), format!("other fields: {error}")))
}

/// The fields in a dict: pairs of name and value, or JSON.
fn pairs(
    bytes: &Bytes,
    ros_type: RosType,
    spec: &TopicSpec,
    dialect: Dialect,
) -> Result<Map, DecodeError> {
    let bottle = native::bottle(bytes, dialect, &spec.limits)?;
    let format = match bottle.values.as_slice() {
        [Element::String(_)] => BottleFormat::Json,
        _ => BottleFormat::Property,
    };
    let value = native::decode(&bottle, format, &spec.plugins, dialect, &spec.limits)?;
    match named(value, &ros_type.plan().default_message()) {
        Value::Map(fields) => Ok(fields),
        other => Err(fault::mismatch(
            format!("the fields of a {ros_type} as pairs (name value)"),
            format!("a {}", other.kind()),
        )),
    }
}

/// `value` with lists of pairs made dicts where the message has messages: text carriers know no
/// dicts.
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
            _ => value,
        };
        (key, value)
    };
    map.into_iter().map(field).collect::<Map>().into()
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
