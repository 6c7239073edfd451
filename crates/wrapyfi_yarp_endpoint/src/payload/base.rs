//! Mobile bases: `nav_msgs/msg/Odometry` from them, `geometry_msgs/msg/Twist` and `TwistStamped` to them.
//!
//! ```text
//!   odometry:o     x y θ │ velocity of the robot: x y θ │ the same in the world: x y θ   ◀──▶  Odometry
//!   base: velocity  x y θ              MobileBaseVelocity, mobileBaseVelocityControl_nws_yarp   ◀──  Twist
//!   base: control   3 x y θ 100.0      the ports of baseControl: m/s, °/s, % of the motors      ◀──  Twist
//! ```
//!
//! Angles are degrees in YARP and radians in ROS, unless option `degrees` is false. A base moves in its plane: what a
//! `Twist` says of other directions is left out.

use bytes::Bytes;
use wrapyfi_yarp::{Bottle, Value as Element};

use super::super::options::BaseCommand;
use super::native;
use super::numbers::{self, Numbers};
use super::rules::Rules;
use super::sensors::{of_vector3, quaternion, roll_pitch_yaw, vector3};
use wrapyfi_data::types::{Header, Map, Stamp, Value};
use wrapyfi_endpoint::codec::{DecodeError, DecodeResult, EncodeError, EncodeResult};

/// Numbers of an odometry, three times three.
const ODOMETRY: usize = 9;
/// Frames of REP 105, where no others are set: nearly all of ROS needs some.
const ODOM: &str = "odom";
const BASE_LINK: &str = "base_link";
/// baseControl's word for velocities along x and y.
const CARTESIAN: i32 = 3;
/// The share of the motors' power that may be used, in per cent.
const ALL_POWER: f64 = 100.0;

/// Reads an odometry as fields of an `Odometry`.
pub(super) fn read_odometry(bytes: &Bytes, rules: Rules<'_>, stamp: Stamp) -> DecodeResult<Map> {
    let Numbers { values, shape: None } = numbers::read(bytes, rules)? else {
        return Err(DecodeError::mismatch("an odometry", "a matrix"));
    };
    let &[x, y, theta, vx, vy, turn, ..] = values.as_slice() else {
        return Err(unlike(values.len()));
    };
    if values.len() != ODOMETRY {
        return Err(unlike(values.len()));
    }
    let [theta, turn] = rules.options.radians([theta, turn]);
    let or = |name: &str, usual: &str| {
        if name.is_empty() { usual.to_owned() } else { name.to_owned() }
    };
    let header = Header { stamp, frame_id: or(&rules.options.frame_id, ODOM) };
    let orientation = quaternion([0.0, 0.0, theta]);
    let pose = Map::from([("position", vector3([x, y, 0.0])), ("orientation", orientation)]);
    let twist =
        Map::from([("linear", vector3([vx, vy, 0.0])), ("angular", vector3([0.0, 0.0, turn]))]);
    Ok(Map::from([
        ("header", Value::from(header.to_fields())),
        ("child_frame_id", or(&rules.options.child_frame_id, BASE_LINK).into()),
        ("pose", Map::from([("pose", pose)]).into()),
        ("twist", Map::from([("twist", twist)]).into()),
    ]))
}

fn unlike(count: usize) -> DecodeError {
    let wanted = format!("{ODOMETRY} numbers of an odometry");
    DecodeError::mismatch(wanted, format!("a vector of {count}"))
}

/// Writes an odometry. The velocity in the world is that of the robot, turned as the robot is.
pub(super) fn write_odometry(fields: &Value, rules: Rules<'_>) -> EncodeResult<Vec<u8>> {
    let part = |outer: &str, inner: &str| {
        fields.get(outer).and_then(|fields| fields.get(outer)).and_then(|it| it.get(inner)).cloned()
    };
    let [x, y, _] = of_vector3(part("pose", "position").as_ref());
    let [_, _, theta] = roll_pitch_yaw(part("pose", "orientation").as_ref());
    let [vx, vy, _] = of_vector3(part("twist", "linear").as_ref());
    let [_, _, turn] = of_vector3(part("twist", "angular").as_ref());
    let (sin, cos) = theta.sin_cos();
    let [theta, turn] = rules.options.degrees([theta, turn]);
    let world = [vx * cos - vy * sin, vx * sin + vy * cos, turn];
    numbers::write_vector([[x, y, theta], [vx, vy, turn], world].concat(), rules)
}

/// Writes the velocity that a `Twist` asks of a base.
pub(super) fn write_velocity(
    twist: &Value,
    base: BaseCommand,
    rules: Rules<'_>,
) -> EncodeResult<Vec<u8>> {
    let [x, y, _] = of_vector3(twist.get("linear"));
    let [_, _, turn] = of_vector3(twist.get("angular"));
    let [turn] = rules.options.degrees([turn]);
    let velocity = [x, y, turn];
    if let Some(odd) = velocity.iter().find(|value| !value.is_finite()) {
        return Err(EncodeError::mismatch("a velocity of numbers", odd.to_string()));
    }
    match base {
        BaseCommand::Velocity => numbers::write_vector(velocity.into(), rules),
        BaseCommand::Control => {
            let numbers = velocity.into_iter().chain([ALL_POWER]).map(Element::Float64);
            let values = std::iter::once(Element::Int32(CARTESIAN)).chain(numbers).collect();
            native::bytes(&Bottle { values }, rules.dialect)
        }
    }
}
