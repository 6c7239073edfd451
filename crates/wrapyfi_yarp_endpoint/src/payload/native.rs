//! Native objects and texts in bottles.
//!
//! ```text
//!   bottle: false     one string of JSON, as Wrapyfi    other bottles are read as lists, too
//!   bottle: true      the values of a list themselves
//!   bottle: property  pairs of key and value            a dict
//! ```

use bytes::Bytes;
use wrapyfi_yarp::bottle::Frame;
use wrapyfi_yarp::{Bottle, Dialect, Value as Element};

use super::super::options::BottleFormat;
use super::element::{self, Writer};
use super::fault;
use wrapyfi_data::Limits;
use wrapyfi_data::plugin::Plugins;
use wrapyfi_data::types::Value;
use wrapyfi_endpoint::codec::{DecodeError, EncodeError, json};

/// Reads a message with `read`: in `dialect`, or in the other one where its bytes are whole in that
/// one alone. The length of a message is known, so the sizes of floats tell who wrote them.
pub(super) fn in_either<T>(
    bytes: &Bytes,
    dialect: Dialect,
    limits: &Limits,
    read: impl Fn(Dialect) -> Result<T, DecodeError>,
) -> Result<T, DecodeError> {
    read(dialect).or_else(|error| {
        let bounds = fault::limits(limits);
        let whole = |dialect| {
            let frame = Bottle::frame(bytes, dialect, &bounds);
            matches!(frame, Ok(Frame::Complete(length)) if length == bytes.len())
        };
        if whole(dialect) || !whole(dialect.other()) {
            return Err(error);
        }
        // The other dialect's error is the one that is reported.
        read(dialect.other())
    })
}

/// Reads the bottle that a message is.
pub(super) fn bottle(
    bytes: &Bytes,
    dialect: Dialect,
    limits: &Limits,
) -> Result<Bottle, DecodeError> {
    let read = Bottle::decode_whole(bytes, dialect, &fault::limits(limits));
    read.map_err(|error| fault::bottle(&error))
}

/// The bytes of a bottle.
pub(super) fn bytes(bottle: &Bottle, dialect: Dialect) -> Result<Vec<u8>, EncodeError> {
    bottle.encode(dialect).map_err(|error| fault::encode(&error))
}

/// The bottle of one string.
pub(super) fn single(text: impl Into<Bytes>) -> Bottle {
    Bottle { values: vec![Element::String(text.into().into())] }
}

/// Writes an object.
pub(super) fn encode(
    value: &Value,
    format: BottleFormat,
    plugins: &Plugins,
    writer: Writer<'_>,
) -> Result<Vec<u8>, EncodeError> {
    let bottle = match (format, value) {
        (BottleFormat::Json, _) => single(json::encode_with(value, plugins)?),
        (BottleFormat::Bottle, _) | (BottleFormat::Property, Value::Map(_)) => {
            writer.bottle(value)?
        }
        (BottleFormat::Property, other) => {
            return Err(EncodeError::Mismatch {
                expected: "a dict, whose pairs become a Property (bottle: property)".to_owned(),
                actual: format!("a {}", other.kind()),
            });
        }
    };
    bytes(&bottle, writer.dialect)
}

/// Reads an object.
pub(super) fn decode(
    bottle: &Bottle,
    format: BottleFormat,
    plugins: &Plugins,
    dialect: Dialect,
    limits: &Limits,
) -> Result<Value, DecodeError> {
    match (format, bottle.values.as_slice()) {
        (BottleFormat::Json, [Element::String(text)]) => {
            let read = json::decode_or_text(&text.clone().into_bytes(), limits, plugins);
            // A string of YARP may hold any bytes.
            match str::from_utf8(text.as_bytes()) {
                Ok(_) => read,
                Err(_) => Ok(element::to_value(&Element::String(text.clone()), dialect)),
            }
        }
        (BottleFormat::Json | BottleFormat::Bottle, _) => Ok(element::to_list(bottle, dialect)),
        (BottleFormat::Property, pairs) => {
            let bottle = match pairs {
                [Element::Dict(whole)] => whole,
                _ => bottle,
            };
            let map = element::to_map(bottle, dialect).map(Value::from);
            map.ok_or_else(|| fault::mismatch("pairs of key and value", shown(bottle)))
        }
    }
}

/// Writes a text: one string, or with `bottle: true` the bottle whose text form it is.
pub(super) fn encode_text(
    value: &Value,
    format: BottleFormat,
    writer: Writer<'_>,
) -> Result<Vec<u8>, EncodeError> {
    let Some(text) = value.as_str() else {
        return Err(EncodeError::Mismatch {
            expected: "a text".to_owned(),
            actual: format!("a {}", value.kind()),
        });
    };
    let bottle = match format {
        BottleFormat::Json => single(text.to_owned()),
        BottleFormat::Bottle | BottleFormat::Property => typed(text, writer)?,
    };
    bytes(&bottle, writer.dialect)
}

/// The bottle of a text form, as typed into `yarp write`.
pub(super) fn typed(text: &str, writer: Writer<'_>) -> Result<Bottle, EncodeError> {
    let limits = fault::limits(writer.limits);
    let typed = Bottle::from_text_as(text.as_bytes(), writer.dialect, &limits);
    typed.map_err(|error| fault::text(&error))
}

/// Reads a text: that of the only string, or else the text form of the bottle, as `yarp read` shows
/// it. Bytes that are not UTF-8 become U+FFFD: a `std_msgs/msg/String` has no others.
pub(super) fn decode_text(bottle: &Bottle, format: BottleFormat) -> Value {
    match (format, bottle.values.as_slice()) {
        (BottleFormat::Json, [Element::String(text)]) => text.to_string_lossy().into_owned().into(),
        _ => bottle.to_text().into(),
    }
}

/// The start of a bottle for an error.
pub(super) fn shown(bottle: &Bottle) -> String {
    const SHOWN: usize = 4;
    let start: Bottle = bottle.values.iter().take(SHOWN).cloned().collect();
    let mut text: String = start.to_text().chars().take(80).collect();
    if bottle.len() > SHOWN {
        text.push_str(" …");
    }
    format!("a bottle of {}: {text}", bottle.len())
}
