//! Messages of a served board: what its ports send, and what ROS gets.
//!
//! ```text
//!   Axes ─▶ state:o      p p p …
//!        ─▶ stateExt:o   (p …) [ok] (v …) [ok] … (torque …) [ok] … (mode …) [ok] (interaction …) [ok]
//!   Movement ─▶ trajectory_msgs/msg/JointTrajectory     all axes, each at its time
//!            ─▶ sensor_msgs/msg/JointState              the axes that move, and position, velocity or effort
//! ```

use std::time::Duration;

use wrapyfi_yarp::bottle::{EncodeError as BottleEncodeError, Vocab};
use wrapyfi_yarp::{Bottle, Dialect, Value as Element};

use super::super::payload;
use super::axes::{Axes, Axis, Joints, Movement, Quantity};
use super::requests::Carries;
use wrapyfi_data::types::{Header, Map, RosMessage, RosType, Stamp, Tensor, Value};
use wrapyfi_endpoint::codec::{DecodeError, DecodeResult};

/// Mode of interaction of every axis: stiff.
const STIFF: &str = "stif";

/// Reads the joints of a `JointState`.
pub(super) fn joints(fields: &Value) -> Joints<'_> {
    let [position, velocity, effort] =
        ["position", "velocity", "effort"].map(|name| payload::floats(fields, name));
    Joints { names: payload::texts(fields, "name"), position, velocity, effort }
}

/// Message of `state:o`.
pub(super) fn plain(axes: &Axes, dialect: Dialect) -> Result<Vec<u8>, BottleEncodeError> {
    let position = |axis: &Axis| Element::Float64(axis.position);
    Bottle { values: axes.all().iter().map(position).collect() }.encode(dialect)
}

/// Message of `stateExt:o`.
pub(super) fn extended(axes: &Axes, dialect: Dialect) -> Result<Vec<u8>, BottleEncodeError> {
    let floats = |of: fn(&Axis) -> f64| axes.all().iter().map(of).collect();
    let words = |of: fn(&Axis) -> &'static str| {
        axes.all().iter().map(|axis| Vocab::new(of(axis)).0).collect()
    };
    let lists = [floats(|it| it.position), floats(|it| it.velocity), floats(|it| it.effort)];
    let modes = [words(|axis| axis.mode.word()), words(|_| STIFF)];
    payload::extended_of(lists, modes).encode(dialect)
}

/// Quantities that messages of this type carry; `None` where it is no type of movements.
pub(super) fn carries(ros_type: RosType) -> Option<Carries> {
    match ros_type.name() {
        payload::TRAJECTORY => Some(Carries::Positions),
        payload::JOINTS => Some(Carries::All),
        _ => None,
    }
}

/// Message of ROS that asks for a movement.
pub(super) fn message(
    movement: &Movement,
    names: &[String],
    ros_type: RosType,
    (stamp, frame_id): (Stamp, &str),
    max_bytes: usize,
) -> DecodeResult<RosMessage> {
    let floats = |values: &[f64]| {
        Tensor::from_elements(&[values.len()], values.to_vec())
            .map(Value::from)
            .map_err(|error| DecodeError::malformed("movement", error.to_string()))
    };
    let texts = |names: &[&String]| names.iter().map(|name| name.as_str()).collect::<Value>();
    let fields = match carries(ros_type) {
        Some(Carries::Positions) => {
            let point = |(time, places): &(Duration, Vec<f64>)| {
                let time = Map::from([
                    ("sec", Value::from(i64::try_from(time.as_secs()).unwrap_or(i64::MAX))),
                    ("nanosec", i64::from(time.subsec_nanos()).into()),
                ]);
                let point =
                    Map::from([("positions", floats(places)?), ("time_from_start", time.into())]);
                Ok(Value::from(point))
            };
            let points = movement.points.iter().map(point).collect::<DecodeResult<Vec<Value>>>()?;
            let all: Vec<&String> = names.iter().collect();
            Map::from([
                ("joint_names", texts(&all)),
                ("points", Value::List(points)),
                // At once, whatever the clock of the robot says.
                (
                    "header",
                    Value::from(
                        Header { stamp: Stamp::default(), frame_id: frame_id.to_owned() }
                            .to_fields(),
                    ),
                ),
            ])
        }
        _ => {
            let moved: Vec<&String> =
                movement.joints.iter().filter_map(|&joint| names.get(joint)).collect();
            let field = match movement.quantity {
                Quantity::Position => "position",
                Quantity::Velocity => "velocity",
                Quantity::Effort => "effort",
            };
            Map::from([("name", texts(&moved)), (field, floats(&movement.values)?)])
        }
    };
    let header = || Header { stamp, frame_id: frame_id.to_owned() };
    RosMessage::from_value_with(ros_type, fields.into(), header, max_bytes)
        .map_err(|error| DecodeError::mismatch(ros_type.name(), format!("other fields: {error}")))
}

#[cfg(test)]
mod tests {
    use super::super::super::options::YarpOptions;
    use super::*;
    use wrapyfi_data::types::MessageType;
    use wrapyfi_interfaces::store::TypeStore;

    fn ros(name: &str) -> RosType {
        match MessageType::resolve(name, &mut TypeStore::generated()).unwrap() {
            MessageType::Ros(ros_type) => ros_type,
            other => panic!("{other}"),
        }
    }

    fn axes() -> Axes {
        let options = YarpOptions { prismatic: vec!["lift".into()], ..YarpOptions::default() };
        let mut axes = Axes::new(&options);
        let state = Joints {
            names: vec!["pan", "lift"],
            position: vec![std::f64::consts::PI, 0.25],
            velocity: vec![0.0, 0.5],
            effort: vec![],
        };
        axes.take(&state, &options).unwrap();
        axes
    }

    #[test]
    fn the_states_are_those_of_a_board_of_yarp() {
        let text = |bytes: Vec<u8>| {
            let limits = wrapyfi_yarp::WireLimits::default();
            Bottle::decode_whole(&bytes.into(), Dialect::V3, &limits).unwrap().to_text()
        };
        assert_eq!(text(plain(&axes(), Dialect::V3).unwrap()), "180.0 0.25");
        let zeros = "(0.0 0.0)";
        let position = Vocab::new("pos").0;
        let stiff = Vocab::new(STIFF).0;
        assert_eq!(
            text(extended(&axes(), Dialect::V3).unwrap()),
            format!(
                "(180.0 0.25) [ok] (0.0 0.5) [ok] {zeros} [fail] {zeros} [fail] {zeros} [fail] {zeros} [fail] \
                 {zeros} [ok] {zeros} [fail] {zeros} [fail] ({position} {position}) [ok] ({stiff} {stiff}) [ok]"
            )
        );
    }

    #[test]
    fn a_movement_is_a_trajectory_of_all_joints_or_a_state_of_those_that_move() {
        let movement = Movement {
            quantity: Quantity::Position,
            joints: vec![1],
            values: vec![0.5],
            points: vec![(Duration::from_millis(2500), vec![1.0, 0.5])],
        };
        let names = ["pan".to_owned(), "lift".to_owned()];
        let made = |name: &str| {
            let place = (Stamp { sec: 7, nanosec: 0 }, "base");
            let message = message(&movement, &names, ros(name), place, 1 << 20).unwrap();
            message.to_value(1 << 20).unwrap()
        };
        let trajectory = made("trajectory_msgs/msg/JointTrajectory");
        assert_eq!(payload::texts(&trajectory, "joint_names"), ["pan", "lift"]);
        let point = trajectory.get("points").and_then(|points| points.as_items()?.first()).unwrap();
        assert_eq!(payload::floats(point, "positions"), [1.0, 0.5]);
        let time = point.get("time_from_start").unwrap();
        let part = |name| time.get(name).and_then(Value::as_i64);
        assert_eq!((part("sec"), part("nanosec")), (Some(2), Some(500_000_000)));
        let header = Header::of_fields(&trajectory).unwrap();
        assert_eq!((header.stamp, header.frame_id.as_str()), (Stamp::default(), "base"));
        let state = made("sensor_msgs/msg/JointState");
        assert_eq!(payload::texts(&state, "name"), ["lift"]);
        assert_eq!(payload::floats(&state, "position"), [0.5]);
        assert_eq!(Header::of_fields(&state).unwrap().stamp.sec, 7);
    }
}
