//! Scans of a laser: `sensor_msgs/msg/LaserScan`.
//!
//! ```text
//!   angle_min angle_max range_min range_max (distance …) status   ◀──▶  LaserScan
//!   0.0 360.0 0.1 8.0 (1.5 inf 1.25 …) 0                                 0 ° is ahead, to the left is more
//! ```
//!
//! That is YARP's `LaserScan2D`, as `rangefinder2D_nws_yarp` streams it. Angles are degrees in YARP and radians
//! in ROS, unless option `degrees` is false. YARP's `angle_max` is the end of the last ray's share, ROS's is the
//! last ray: the number of rays divides YARP's range. The status has no place in ROS.

use bytes::Bytes;
use wrapyfi_yarp::{Bottle, Value as Element};

use super::rules::Rules;
use super::{native, numbers};
use wrapyfi_data::types::{Map, Tensor, Value};
use wrapyfi_endpoint::codec::{DecodeError, DecodeResult, EncodeResult};

/// Status of a device that works, `DEVICE_OK_IN_USE`.
const IN_USE: i32 = 1;

/// The parts of a scan: first and last angle, least and greatest distance, then the distances.
fn parts(bottle: &Bottle) -> Option<([f64; 4], Vec<f64>)> {
    let [bounds @ .., scan, status] = bottle.values.as_slice() else { return None };
    status.as_i64()?;
    let bounds = bounds.iter().map(Element::as_f64).collect::<Option<Vec<f64>>>()?;
    Some((bounds.try_into().ok()?, numbers::plain(scan.as_list()?)?))
}

/// True when a message can only be a laser scan: floats where a scan has them.
pub(crate) fn is_scan(bottle: &Bottle) -> bool {
    let is_float = |element: &Element| matches!(element, Element::Float64(_));
    match bottle.values.as_slice() {
        [bounds @ .., Element::List(scan), Element::Int32(0..=3)] => {
            bounds.len() == 4
                && bounds.iter().all(is_float)
                && !scan.is_empty()
                && scan.values.iter().all(is_float)
        }
        _ => false,
    }
}

/// Reads a scan as fields of a `LaserScan`, without its header.
pub(super) fn read(bytes: &Bytes, rules: Rules<'_>) -> DecodeResult<Map> {
    let bottle = native::bottle(bytes, rules)?;
    let parts = parts(&bottle).ok_or_else(|| {
        let wanted = "a scan: angle_min angle_max range_min range_max (distances) status";
        DecodeError::mismatch(wanted, native::as_text(&bottle))
    })?;
    let ([first, end, least, most], distances) = parts;
    let [first, end] = rules.options.radians([first, end]);
    let count = distances.len();
    // Far fewer rays than a double can count.
    let step = if count == 0 { 0.0 } else { (end - first) / count as f64 };
    let last = if count == 0 { first } else { end - step };
    let ranges = Tensor::from_elements(&[count], distances.into_iter().map(narrow).collect());
    let ranges = ranges.map_err(|error| DecodeError::malformed("scan", error.to_string()))?;
    let number = |value| Value::from(f64::from(narrow(value)));
    Ok(Map::from([
        ("angle_min", number(first)),
        ("angle_max", number(last)),
        ("angle_increment", number(step)),
        ("range_min", number(least)),
        ("range_max", number(most)),
        ("ranges", Value::from(ranges)),
    ]))
}

/// The nearest number of the width that ROS has here.
fn narrow(value: f64) -> f32 {
    value as f32
}

/// Writes a scan.
pub(super) fn write(fields: &Value, rules: Rules<'_>) -> EncodeResult<Vec<u8>> {
    let number = |name| fields.get(name).and_then(Value::as_f64).unwrap_or_default();
    let ranges = fields.get("ranges").and_then(Value::as_tensor).and_then(Tensor::to_vec::<f32>);
    let scan: Bottle =
        ranges.unwrap_or_default().into_iter().map(|ray| Element::Float64(ray.into())).collect();
    let (first, step) = (number("angle_min"), number("angle_increment"));
    // Far fewer rays than a double can count.
    let end = step.mul_add(scan.len() as f64, first);
    let [first, end] = rules.options.degrees([first, end]);
    let bounds = [first, end, number("range_min"), number("range_max")];
    let values = bounds.into_iter().map(Element::Float64);
    let rest = [Element::List(scan), Element::Int32(IN_USE)];
    native::bytes(&Bottle { values: values.chain(rest).collect() }, rules.dialect)
}
