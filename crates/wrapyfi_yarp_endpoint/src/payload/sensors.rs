//! Inertial and force sensors: `sensor_msgs/msg/Imu`, `geometry_msgs/msg/WrenchStamped`.
//!
//! ```text
//!   inertial    roll pitch yaw │ acceleration │ angular velocity │ magnetic field   ◀──▶  Imu
//!   forces      force │ torque                                                      ◀──▶  WrenchStamped
//!   measures:o  (gyroscopes) (accelerometers) … 12 lists of ((x y z) time)           ──▶  either
//! ```
//!
//! Angles are degrees in YARP and radians in ROS, unless option `degrees` is false. `measures:o` is that of
//! `multipleanalogsensorsserver`: option `sensor` says which sensor of each list is meant.

use bytes::Bytes;
use wrapyfi_yarp::Bottle;

use super::native;
use super::numbers::{self, Numbers};
use super::rules::Rules;
use wrapyfi_data::types::{Map, Value};
use wrapyfi_endpoint::codec::{DecodeError, DecodeResult, EncodeResult};

/// Numbers of an inertial sensor, four times three.
const INERTIAL: usize = 12;
/// Numbers of a force and torque sensor.
const FORCES: usize = 6;
/// Lists of `measures:o`, in the order of YARP's `SensorStreamingData`; older programs lack the last
/// ones.
const GYROSCOPES: usize = 0;
const ACCELEROMETERS: usize = 1;
const ORIENTATIONS: usize = 3;
const FORCE_TORQUES: usize = 5;

/// Three numbers.
type Vector3 = [f64; 3];

/// Content of a message: one vector, or the lists of `measures:o`.
enum Message {
    Numbers(Vec<f64>),
    Measures(Bottle),
}

fn message(bytes: &Bytes, rules: Rules<'_>) -> DecodeResult<Message> {
    let bottle = match numbers::read(bytes, rules) {
        Ok(Numbers { values, shape: None }) if !values.is_empty() => {
            return Ok(Message::Numbers(values));
        }
        _ => native::bottle(bytes, rules)?,
    };
    if bottle.len() > FORCE_TORQUES && bottle.values.iter().all(|list| list.as_list().is_some()) {
        return Ok(Message::Measures(bottle));
    }
    let wanted = "a vector of numbers, or the lists of measures:o";
    Err(DecodeError::mismatch(wanted, native::as_text(&bottle)))
}

/// The numbers of a sensor in a list of `measures:o`; none where the list is shorter.
fn measure<const N: usize>(bottle: &Bottle, list: usize, sensor: usize) -> Option<[f64; N]> {
    let measurement = bottle.get(list)?.as_list()?.get(sensor)?.as_list()?;
    let values = numbers::plain(measurement.get(0)?.as_list()?)?;
    <[f64; N]>::try_from(values).ok()
}

fn missing(what: &str, bottle: &Bottle, sensor: usize) -> DecodeError {
    let wanted = format!("{what} number {sensor} (option sensor) among the measurements");
    DecodeError::mismatch(wanted, native::as_text(bottle))
}

/// Reads an inertial sensor as fields of an `Imu`, without its header.
pub(super) fn read_imu(bytes: &Bytes, rules: Rules<'_>) -> DecodeResult<Map> {
    let (angles, acceleration, velocity) = match message(bytes, rules)? {
        Message::Numbers(values) => {
            let &[r, p, y, ax, ay, az, wx, wy, wz, _, _, _] = values.as_slice() else {
                let count = values.len();
                let wanted = format!("{INERTIAL} numbers of an inertial sensor");
                return Err(DecodeError::mismatch(wanted, format!("a vector of {count}")));
            };
            (Some([r, p, y]), Some([ax, ay, az]), Some([wx, wy, wz]))
        }
        Message::Measures(bottle) => {
            let list = |list| measure::<3>(&bottle, list, rules.options.sensor);
            let found = (list(ORIENTATIONS), list(ACCELEROMETERS), list(GYROSCOPES));
            if matches!(found, (None, None, None)) {
                return Err(missing("an inertial sensor", &bottle, rules.options.sensor));
            }
            found
        }
    };
    let mut fields = Map::new();
    for (name, measured) in [
        ("orientation", angles.map(|angles| quaternion(rules.options.radians(angles)))),
        ("angular_velocity", velocity.map(|velocity| vector3(rules.options.radians(velocity)))),
        ("linear_acceleration", acceleration.map(vector3)),
    ] {
        drop(match measured {
            Some(value) => fields.insert(name, value),
            None => fields.insert(format!("{name}_covariance"), unmeasured()?),
        });
    }
    Ok(fields)
}

/// Writes the vector of an inertial sensor; ROS has no magnetic field there.
pub(super) fn write_imu(fields: &Value, rules: Rules<'_>) -> EncodeResult<Vec<u8>> {
    let angles = rules.options.degrees(roll_pitch_yaw(fields.get("orientation")));
    let acceleration = of_vector3(fields.get("linear_acceleration"));
    let velocity = rules.options.degrees(of_vector3(fields.get("angular_velocity")));
    let values = [angles, acceleration, velocity, [0.0; 3]].concat();
    numbers::write_vector(values, rules)
}

/// Reads forces and torques as fields of a `WrenchStamped`, without its header.
pub(super) fn read_wrench(bytes: &Bytes, rules: Rules<'_>) -> DecodeResult<Map> {
    let values = match message(bytes, rules)? {
        Message::Numbers(values) => <[f64; FORCES]>::try_from(values).map_err(|values| {
            let wanted = format!("{FORCES} numbers, force and torque");
            DecodeError::mismatch(wanted, format!("a vector of {}", values.len()))
        })?,
        Message::Measures(bottle) => measure(&bottle, FORCE_TORQUES, rules.options.sensor)
            .ok_or_else(|| missing("a force and torque sensor", &bottle, rules.options.sensor))?,
    };
    let [fx, fy, fz, tx, ty, tz] = values;
    let wrench = Map::from([("force", vector3([fx, fy, fz])), ("torque", vector3([tx, ty, tz]))]);
    Ok(Map::from([("wrench", wrench)]))
}

/// Writes the vector of forces and torques.
pub(super) fn write_wrench(fields: &Value, rules: Rules<'_>) -> EncodeResult<Vec<u8>> {
    let wrench = fields.get("wrench");
    let part = |name| of_vector3(wrench.and_then(|wrench| wrench.get(name)));
    let values = [part("force"), part("torque")].concat();
    numbers::write_vector(values, rules)
}

/// The covariance that says that nothing was measured.
fn unmeasured() -> DecodeResult<Value> {
    numbers::field(vec![-1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
}

pub(super) fn vector3([x, y, z]: Vector3) -> Value {
    Map::from([("x", x), ("y", y), ("z", z)]).into()
}

fn number(fields: Option<&Value>, name: &str) -> f64 {
    fields.and_then(|fields| fields.get(name)).and_then(Value::as_f64).unwrap_or_default()
}

pub(super) fn of_vector3(fields: Option<&Value>) -> Vector3 {
    ["x", "y", "z"].map(|name| number(fields, name))
}

pub(super) fn of_quaternion(fields: Option<&Value>) -> [f64; 4] {
    ["x", "y", "z", "w"].map(|name| number(fields, name))
}

/// The orientation of these angles, which YARP turns about z, then y, then x.
pub(super) fn quaternion(angles: Vector3) -> Value {
    let [(sr, cr), (sp, cp), (sy, cy)] = angles.map(|angle| (angle / 2.0).sin_cos());
    Map::from([
        ("x", sr * cp * cy - cr * sp * sy),
        ("y", cr * sp * cy + sr * cp * sy),
        ("z", cr * cp * sy - sr * sp * cy),
        ("w", cr * cp * cy + sr * sp * sy),
    ])
    .into()
}

pub(super) fn roll_pitch_yaw(orientation: Option<&Value>) -> Vector3 {
    let [x, y, z, w] = of_quaternion(orientation);
    let roll = (2.0 * (w * x + y * z)).atan2(1.0 - 2.0 * (x * x + y * y));
    let pitch = (2.0 * (w * y - z * x)).clamp(-1.0, 1.0).asin();
    let yaw = (2.0 * (w * z + x * y)).atan2(1.0 - 2.0 * (y * y + z * z));
    [roll, pitch, yaw]
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::super::options::YarpOptions;
    use super::super::numbers::Width;
    use super::*;
    use wrapyfi_data::Limits;
    use wrapyfi_yarp::Dialect;

    proptest! {
        #[test]
        fn angles_come_back(roll in -3.1..3.1, pitch in -1.5..1.5, yaw in -3.1..3.1) {
            let back = roll_pitch_yaw(Some(&quaternion([roll, pitch, yaw])));
            for (one, other) in [roll, pitch, yaw].into_iter().zip(back) {
                prop_assert!((one - other).abs() < 1e-9, "{back:?}");
            }
        }

        #[test]
        fn vectors_of_sensors_come_back(
            values in proptest::collection::vec(-50.0..50.0, INERTIAL),
            degrees: bool,
        ) {
            let (limits, options) = (Limits::default(), YarpOptions { degrees, ..YarpOptions::default() });
            let mut values = values;
            // Within what is said of angles, and no magnetic field.
            let scale = if degrees { 1.0 } else { 1.0 / 50.0 };
            values.iter_mut().take(3).for_each(|angle| *angle *= scale);
            values.iter_mut().skip(9).for_each(|field| *field = 0.0);
            for dialect in [Dialect::V3, Dialect::V4] {
                let rules = Rules::new(&options, dialect, &limits);
                let vector = |values: &[f64]| {
                    let numbers = Numbers { values: values.to_vec(), shape: None };
                    Bytes::from(numbers::write(numbers, Width::Float64, dialect).unwrap())
                };
                let fields = read_imu(&vector(&values), rules).unwrap();
                let bytes = write_imu(&fields.into(), rules).unwrap().into();
                let back = numbers::read(&bytes, rules).unwrap().values;
                for (one, other) in values.iter().zip(&back) {
                    prop_assert!((one - other).abs() < 1e-9, "{back:?}");
                }
                let forces = vector(&values[..FORCES]);
                let fields = read_wrench(&forces, rules).unwrap();
                prop_assert_eq!(&write_wrench(&fields.into(), rules).unwrap(), &forces);
            }
        }
    }
}
