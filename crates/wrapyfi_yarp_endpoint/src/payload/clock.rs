//! The time of a simulation: `rosgraph_msgs/msg/Clock`.
//!
//! ```text
//!   1700000000 500000000   ◀──▶  clock: { sec: 1700000000, nanosec: 500000000 }
//! ```
//!
//! That is what YARP's programs read from the port that `YARP_CLOCK` names: seconds and nanoseconds.

use bytes::Bytes;
use wrapyfi_yarp::{Bottle, Value as Element};

use super::native;
use super::rules::Rules;
use wrapyfi_data::types::{Map, Value};
use wrapyfi_endpoint::codec::{DecodeError, DecodeResult, EncodeResult};

/// Nanoseconds of a second.
const SECOND: i64 = 1_000_000_000;

/// Reads a time as fields of a `Clock`.
pub(super) fn read(bytes: &Bytes, rules: Rules<'_>) -> DecodeResult<Map> {
    let bottle = native::bottle(bytes, rules)?;
    let time = match bottle.values.as_slice() {
        [sec, nanosec] => sec.as_i64().zip(nanosec.as_i64()),
        _ => None,
    };
    let time = time.filter(|(_, nanosec)| (0..SECOND).contains(nanosec));
    let Some((sec, nanosec)) = time else {
        let wanted = "the time of a clock: seconds and nanoseconds, two integers";
        return Err(DecodeError::mismatch(wanted, native::as_text(&bottle)));
    };
    let time = Map::from([("sec", Value::from(sec)), ("nanosec", Value::from(nanosec))]);
    Ok(Map::from([("clock", Value::from(time))]))
}

/// Writes a time.
pub(super) fn write(fields: &Value, rules: Rules<'_>) -> EncodeResult<Vec<u8>> {
    let part = |name| {
        let value = fields.get("clock").and_then(|clock| clock.get(name));
        let value = value.and_then(Value::as_i64).unwrap_or_default();
        // Both fit: `builtin_interfaces/msg/Time` has 32 bits for each, and a nanosecond less than 30.
        Element::Int32(i32::try_from(value).unwrap_or(i32::MAX))
    };
    native::bytes(&Bottle { values: vec![part("sec"), part("nanosec")] }, rules.dialect)
}
