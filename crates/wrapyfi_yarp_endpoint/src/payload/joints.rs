//! State of the joints of a control board: `sensor_msgs/msg/JointState`.
//!
//! ```text
//!   state:o     p p p …                              ──▶ position
//!   stateExt:o  (p …) ok (v …) ok … (torque …) ok …  ──▶ position, velocity, effort
//!   position    ──▶  p p p …                              for a port that takes positions
//! ```
//!
//! Angles are degrees in YARP and radians in ROS, unless option `degrees` is false; what a prismatic joint
//! measures is metres in both. YARP sends no names: they are those of option `joints`, or what the
//! control board tells of its joints.

use bytes::Bytes;
use wrapyfi_yarp::Bottle;

use super::native;
use super::numbers::{self, Numbers};
use super::rules::Rules;
use wrapyfi_data::types::{Map, Tensor, Value};
use wrapyfi_endpoint::codec::{DecodeError, DecodeResult, EncodeError, EncodeResult};

/// Places in the list of `stateExt:o`, each followed by whether it is valid.
const POSITION: usize = 0;
const VELOCITY: usize = 2;
const TORQUE: usize = 12;

/// Reads the state of joints as fields of the message, without its header.
pub(super) fn read(bytes: &Bytes, rules: Rules<'_>) -> DecodeResult<Map> {
    let [position, velocity, effort] = match numbers::read(bytes, rules) {
        Ok(Numbers { values, shape: None }) => [values, Vec::new(), Vec::new()],
        Ok(Numbers { shape: Some((rows, columns)), .. }) => {
            let actual = format!("a matrix of {rows} x {columns}");
            return Err(DecodeError::mismatch("the positions of joints", actual));
        }
        Err(error) => {
            let bottle = native::bottle(bytes, rules)?;
            extended(&bottle).ok_or(error)?
        }
    };
    for (what, values) in
        [("positions", &position), ("velocities", &velocity), ("torques", &effort)]
    {
        let (names, given) = (rules.options.joints.len(), values.len());
        let counts = names > 0 && given != names && (given > 0 || what == "positions");
        if counts {
            return Err(DecodeError::mismatch(
                format!("{names} joints, as option joints names"),
                format!("{given} {what}"),
            ));
        }
    }
    let angles = |mut values: Vec<f64>| {
        for (joint, value) in values.iter_mut().enumerate() {
            if rules.options.has_degrees(joint) {
                *value = value.to_radians();
            }
        }
        numbers::field(values)
    };
    Ok(Map::from([
        ("name", rules.options.joints.iter().map(String::as_str).collect()),
        ("position", angles(position)?),
        ("velocity", angles(velocity)?),
        ("effort", numbers::field(effort)?),
    ]))
}

/// Positions, velocities and torques of a `stateExt:o`; those that it calls invalid are left out.
fn extended(bottle: &Bottle) -> Option<[Vec<f64>; 3]> {
    let part = |at: usize| {
        let values = numbers::plain(bottle.get(at)?.as_list()?)?;
        let flag = bottle.get(at + 1)?;
        let valid = flag.as_bool().or_else(|| Some(flag.as_i64()? != 0))?;
        Some(if valid { values } else { Vec::new() })
    };
    Some([part(POSITION)?, part(VELOCITY)?, part(TORQUE)?])
}

/// Writes the positions of a message, in the order of option `joints` where it is given.
pub(super) fn write(fields: &Value, rules: Rules<'_>) -> EncodeResult<Vec<u8>> {
    let (names, position) = (texts(fields, "name"), floats(fields, "position"));
    let mut values = ordered(&names, position, &rules.options.joints)?;
    for (joint, value) in values.iter_mut().enumerate() {
        if rules.options.has_degrees(joint) {
            *value = value.to_degrees();
        }
    }
    numbers::write_vector(values, rules)
}

/// The numbers of a field of a message.
pub(super) fn floats(fields: &Value, name: &str) -> Vec<f64> {
    let field = fields.get(name).and_then(Value::as_tensor);
    field.and_then(Tensor::to_vec::<f64>).unwrap_or_default()
}

/// The texts of a field of a message.
pub(super) fn texts<'a>(fields: &'a Value, name: &str) -> Vec<&'a str> {
    let items = fields.get(name).and_then(Value::as_items).unwrap_or_default();
    items.iter().filter_map(Value::as_str).collect()
}

fn ordered(names: &[&str], position: Vec<f64>, joints: &[String]) -> EncodeResult<Vec<f64>> {
    let mismatch = |expected: String, actual: String| EncodeError::mismatch(expected, actual);
    if !names.is_empty() && names.len() != position.len() {
        let (names, count) = (names.len(), position.len());
        return Err(mismatch(format!("{names} positions, one a name"), format!("{count}")));
    }
    if joints.is_empty() {
        return Ok(position);
    }
    if names.is_empty() {
        let (wanted, given) = (joints.len(), position.len());
        if wanted != given {
            let expected = format!("{wanted} joints, as option joints names");
            return Err(mismatch(expected, format!("{given} positions")));
        }
        return Ok(position);
    }
    let place = |joint: &String| {
        let found = names.iter().position(|name| name == joint).and_then(|at| position.get(at));
        found.copied().ok_or_else(|| {
            let (wanted, given) = (joints.len(), names.len());
            mismatch(
                format!("{wanted} joints, as option joints names, {joint:?} among them"),
                format!("{given} others"),
            )
        })
    };
    joints.iter().map(place).collect()
}
