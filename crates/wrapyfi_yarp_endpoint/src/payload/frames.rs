//! Transforms between coordinate frames: `tf2_msgs/msg/TFMessage`.
//!
//! ```text
//!   tf:o   0 ((parent child time static x y z qx qy qz qw) …)   ◀──▶  transforms
//! ```
//!
//! That is how YARP's `frameTransformGet_nws_yarp` streams them: whether it went well, then all that it
//! knows. One transform alone, or a list of them, is read as well. A transform without a time of its
//! own has that of the message. Being static is a matter of the topic in ROS: a written transform says
//! that it is not.

use bytes::Bytes;
use wrapyfi_yarp::{Bottle, Dialect, Value as Element};

use super::native;
use super::rules::Rules;
use super::sensors::{of_quaternion, of_vector3, vector3};
use wrapyfi_data::types::{Header, Map, Stamp, Value};
use wrapyfi_endpoint::codec::{DecodeError, DecodeResult, EncodeResult};

/// Elements of a transform.
const PARTS: usize = 11;
/// YARP's word that it went well.
const WENT_WELL: i32 = 0;

/// Reads transforms as fields of a `TFMessage`. `stamp` is for those without a time.
pub(super) fn read(bytes: &Bytes, rules: Rules<'_>, stamp: Stamp) -> DecodeResult<Map> {
    let bottle = native::bottle(bytes, rules)?;
    let list = match bottle.values.as_slice() {
        [result, Element::List(list)] if result.as_i64().is_some() => list,
        _ => &bottle,
    };
    let transforms: Option<Vec<Value>> = match transform(&bottle, stamp) {
        Some(single) => Some(vec![single]),
        None => list.into_iter().map(|one| transform(one.as_list()?, stamp)).collect(),
    };
    let transforms = transforms.ok_or_else(|| {
        let wanted = "transforms (parent child time static x y z qx qy qz qw)";
        DecodeError::mismatch(wanted, native::as_text(&bottle))
    })?;
    Ok(Map::from([("transforms", Value::List(transforms))]))
}

fn transform(bottle: &Bottle, stamp: Stamp) -> Option<Value> {
    let parts = <&[Element; PARTS]>::try_from(bottle.values.as_slice()).ok()?;
    let [parent, child, time, _is_static, place @ ..] = parts;
    let mut numbers = [0.0; 7];
    for (number, element) in numbers.iter_mut().zip(place) {
        *number = element.as_f64()?;
    }
    let [tx, ty, tz, x, y, z, w] = numbers;
    let own = Stamp::from_secs_f64(time.as_f64()?);
    let stamp = if own == Stamp::default() { stamp } else { own };
    let header = Header { stamp, frame_id: parent.as_str()?.to_owned() };
    let rotation = Map::from([("x", x), ("y", y), ("z", z), ("w", w)]);
    let place =
        Map::from([("translation", vector3([tx, ty, tz])), ("rotation", Value::from(rotation))]);
    let fields = Map::from([
        ("header", Value::from(header.to_fields())),
        ("child_frame_id", child.as_str()?.into()),
        ("transform", place.into()),
    ]);
    Some(fields.into())
}

/// Writes the transforms of a message, and says the time of the first one.
pub(super) fn write(fields: &Value, dialect: Dialect) -> EncodeResult<(Vec<u8>, Option<Stamp>)> {
    let transforms = fields.get("transforms").and_then(Value::as_items).unwrap_or_default();
    let mut first = None;
    let one = |fields: &Value| {
        let Header { stamp, frame_id } = Header::of_fields(fields).unwrap_or_default();
        first.get_or_insert(stamp);
        let child = fields.get("child_frame_id").and_then(Value::as_str).unwrap_or_default();
        let place = fields.get("transform");
        let [tx, ty, tz] = of_vector3(place.and_then(|place| place.get("translation")));
        let [x, y, z, w] = of_quaternion(place.and_then(|place| place.get("rotation")));
        let names = [Element::string(frame_id), Element::string(child.to_owned())];
        let when = [stamp.as_secs_f64().into(), Element::Int8(0)];
        let place = [tx, ty, tz, x, y, z, w].map(Element::Float64);
        let values = names.into_iter().chain(when).chain(place).collect();
        Element::List(Bottle { values })
    };
    let transforms: Bottle = transforms.iter().map(one).collect();
    let bottle = Bottle { values: vec![Element::Int32(WENT_WELL), Element::List(transforms)] };
    Ok((native::bytes(&bottle, dialect)?, first))
}
