//! State of the joints of a control board: `sensor_msgs/msg/JointState`.
//!
//! ```text
//!   state:o     p p p …                              ──▶ position
//!   stateExt:o  (p …) ok (v …) ok … (torque …) ok …  ──▶ position, velocity, effort
//!   position    ──▶  p p p …                              for a port that takes positions
//!   position, velocity, effort  ──▶  as stateExt:o        for a port of that name
//! ```
//!
//! Angles are degrees in YARP and radians in ROS, unless option `degrees` is false; what a prismatic joint
//! measures is metres in both. YARP sends no names: they are those of option `joints`, or what the
//! control board tells of its joints.

use bytes::Bytes;
use wrapyfi_yarp::bottle::Vocab;
use wrapyfi_yarp::{Bottle, Value as Element};

use super::native;
use super::numbers::{self, Numbers};
use super::rules::Rules;
use wrapyfi_data::types::{Map, Tensor, Value};
use wrapyfi_endpoint::codec::{DecodeError, DecodeResult, EncodeError, EncodeResult};

/// Places in the list of `stateExt:o`, each followed by whether it is valid.
const POSITION: usize = 0;
const VELOCITY: usize = 2;
const TORQUE: usize = 12;
const MODES: usize = 18;
const INTERACTIONS: usize = 20;
/// Number of elements in that list.
const ELEMENTS: usize = 22;

/// Ending of the name of the port that sends states in full.
pub(in super::super) const EXTENDED_PORT: &str = "/stateExt:o";

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

/// Writes a message for the port `port`, in the order of option `joints` where it is given: its positions, or all that
/// a `stateExt:o` has.
pub(super) fn write(fields: &Value, port: &str, rules: Rules<'_>) -> EncodeResult<Vec<u8>> {
    let names = texts(fields, "name");
    let in_order = |field: &str| {
        let mut values = ordered(&names, floats(fields, field), &rules.options.joints)?;
        for (joint, value) in values.iter_mut().enumerate() {
            if field != "effort" && rules.options.has_degrees(joint) {
                *value = value.to_degrees();
            }
        }
        Ok(values)
    };
    let position = in_order("position")?;
    if !port.ends_with(EXTENDED_PORT) {
        return numbers::write_vector(position, rules);
    }
    // What a message leaves out has no number for any joint.
    let told =
        |field| if floats(fields, field).is_empty() { Ok(Vec::new()) } else { in_order(field) };
    let lists = [position, told("velocity")?, told("effort")?];
    native::bytes(&extended_of(lists, [Vec::new(), Vec::new()]), rules.dialect)
}

/// State in full, YARP's `jointData`: positions, velocities and torques of all joints, modes and modes of interaction as
/// the numbers of their words. Lists that are empty, and those of motors, are marked as invalid and filled with zeros.
pub(in super::super) fn extended_of(
    [position, velocity, torque]: [Vec<f64>; 3],
    [modes, interactions]: [Vec<i32>; 2],
) -> Bottle {
    let count = position.len();
    let floats = |values: Vec<f64>| values.into_iter().map(Element::Float64).collect::<Vec<_>>();
    let words = |values: Vec<i32>| values.into_iter().map(Element::Int32).collect::<Vec<_>>();
    let [mut position, mut velocity, mut torque] = [position, velocity, torque].map(floats);
    let [mut modes, mut interactions] = [modes, interactions].map(words);
    let values = (0..ELEMENTS).step_by(2).flat_map(|place| {
        let (mut list, zero) = match place {
            POSITION => (std::mem::take(&mut position), Element::Float64(0.0)),
            VELOCITY => (std::mem::take(&mut velocity), Element::Float64(0.0)),
            TORQUE => (std::mem::take(&mut torque), Element::Float64(0.0)),
            MODES => (std::mem::take(&mut modes), Element::Int32(0)),
            INTERACTIONS => (std::mem::take(&mut interactions), Element::Int32(0)),
            _ => (Vec::new(), Element::Float64(0.0)),
        };
        let flag = if list.is_empty() { Vocab::FAIL } else { Vocab::OK };
        list.resize(count, zero);
        [Element::List(Bottle { values: list }), Element::Vocab32(flag)]
    });
    Bottle { values: values.collect() }
}

/// The numbers of a field of a message.
pub(in super::super) fn floats(fields: &Value, name: &str) -> Vec<f64> {
    let field = fields.get(name).and_then(Value::as_tensor);
    field.and_then(Tensor::to_vec::<f64>).unwrap_or_default()
}

/// The texts of a field of a message.
pub(in super::super) fn texts<'a>(fields: &'a Value, name: &str) -> Vec<&'a str> {
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
