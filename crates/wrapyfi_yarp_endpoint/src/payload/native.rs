//! Native objects and texts in bottles.
//!
//! ```text
//!   bottle: false     one string of JSON, as Wrapyfi    other bottles are read as lists, too
//!   no option         the same, where Wrapyfi sends     another's one string is itself
//!   bottle: true      the values of a list themselves
//!   bottle: property  pairs of key and value            a dict
//! ```

use bytes::Bytes;
use wrapyfi_yarp::{Bottle, Dialect, Value as Element};

use super::super::options::BottleFormat;
use super::element::{self, Writer};
use super::fault;
use super::rules::Rules;
use wrapyfi_data::plugin::Plugins;
use wrapyfi_data::types::Value;
use wrapyfi_endpoint::codec::{DecodeError, DecodeResult, EncodeError, EncodeResult, json};

/// Reads a message with `read`: in `dialect`, or in the other one where its bytes are whole in that
/// one alone. The length of a message is known, so the sizes of floats tell who wrote them.
pub(super) fn in_either<T>(
    bytes: &Bytes,
    rules: Rules<'_>,
    read: impl Fn(Rules<'_>) -> DecodeResult<T>,
) -> DecodeResult<T> {
    read(rules).or_else(|error| {
        let bounds = fault::limits(rules.limits);
        let whole = |dialect| Bottle::is_whole(bytes, dialect, &bounds);
        let other = rules.dialect.other();
        if whole(rules.dialect) || !whole(other) {
            return Err(error);
        }
        // The other dialect's error is the one that is reported.
        read(Rules { dialect: other, ..rules })
    })
}

/// Reads the bottle that a message is.
pub(super) fn bottle(bytes: &Bytes, rules: Rules<'_>) -> DecodeResult<Bottle> {
    let read = Bottle::decode_whole(bytes, rules.dialect, &fault::limits(rules.limits));
    read.map_err(|error| fault::bottle(&error))
}

/// The bytes of a bottle.
pub(super) fn bytes(bottle: &Bottle, dialect: Dialect) -> EncodeResult<Vec<u8>> {
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
) -> EncodeResult<Vec<u8>> {
    let bottle = match (format, value) {
        (BottleFormat::Json | BottleFormat::Plain, _) => single(json::encode(value, plugins)?),
        (BottleFormat::Bottle, _) | (BottleFormat::Property, Value::Map(_)) => {
            writer.bottle(value)?
        }
        (BottleFormat::Property, other) => {
            return Err(EncodeError::mismatch(
                "a dict, whose pairs become a Property (bottle: property)",
                format!("a {}", other.kind()),
            ));
        }
    };
    bytes(&bottle, writer.dialect)
}

/// Reads an object.
pub(super) fn decode(
    bottle: &Bottle,
    format: BottleFormat,
    plugins: &Plugins,
    rules: Rules<'_>,
) -> DecodeResult<Value> {
    match (format, bottle.values.as_slice()) {
        (BottleFormat::Json, [Element::String(text)]) => {
            let read = json::decode_or_text(&text.clone().into_bytes(), rules.limits, plugins);
            // A string of YARP may hold any bytes.
            match str::from_utf8(text.as_bytes()) {
                Ok(_) => read,
                Err(_) => Ok(element::to_value(&Element::String(text.clone()), rules.dialect)),
            }
        }
        (BottleFormat::Plain, [Element::String(text)]) => {
            Ok(match str::from_utf8(text.as_bytes()) {
                Ok(text) => text.to_owned().into(),
                Err(_) => element::to_value(&Element::String(text.clone()), rules.dialect),
            })
        }
        (BottleFormat::Json | BottleFormat::Plain | BottleFormat::Bottle, _) => {
            Ok(element::to_list(bottle, rules.dialect))
        }
        (BottleFormat::Property, pairs) => {
            let bottle = match pairs {
                [Element::Dict(whole)] => whole,
                _ => bottle,
            };
            let map = element::to_map(bottle, rules.dialect).map(Value::from);
            map.ok_or_else(|| DecodeError::mismatch("pairs of key and value", as_text(bottle)))
        }
    }
}

/// Writes a text: one string, or with `bottle: true` the bottle whose text form it is.
pub(super) fn encode_text(
    value: &Value,
    format: BottleFormat,
    writer: Writer<'_>,
) -> EncodeResult<Vec<u8>> {
    let Some(text) = value.as_str() else {
        return Err(EncodeError::mismatch("a text", format!("a {}", value.kind())));
    };
    let bottle = match format {
        BottleFormat::Json | BottleFormat::Plain => single(text.to_owned()),
        BottleFormat::Bottle | BottleFormat::Property => typed(text, writer)?,
    };
    bytes(&bottle, writer.dialect)
}

/// The bottle of a text form, as typed into `yarp write`.
pub(super) fn typed(text: &str, writer: Writer<'_>) -> EncodeResult<Bottle> {
    let limits = fault::limits(writer.limits);
    let typed = Bottle::from_text_as(text.as_bytes(), writer.dialect, &limits);
    typed.map_err(|error| fault::text(&error))
}

/// Reads a text: that of the only string, or else the text form of the bottle, as `yarp read` shows
/// it. Bytes that are not UTF-8 become U+FFFD: a `std_msgs/msg/String` has no others.
pub(super) fn decode_text(bottle: &Bottle, format: BottleFormat) -> Value {
    match (format, bottle.values.as_slice()) {
        (BottleFormat::Json | BottleFormat::Plain, [Element::String(text)]) => {
            text.to_string_lossy().into_owned().into()
        }
        _ => bottle.to_text().into(),
    }
}

/// The start of a bottle for an error.
pub(super) fn as_text(bottle: &Bottle) -> String {
    const SHOWN: usize = 4;
    const LETTERS: usize = 80;
    let cut = |value: &Element| match value {
        // The text of all rows of an image takes so long that the next images are dropped.
        Element::Blob(bytes) => Element::Blob(bytes.slice(..bytes.len().min(LETTERS))),
        other => other.clone(),
    };
    let start: Bottle = bottle.values.iter().take(SHOWN).map(cut).collect();
    let mut text: String = start.to_text().chars().take(LETTERS).collect();
    if bottle.len() > SHOWN {
        text.push_str(" …");
    }
    format!("a bottle of {}: {text}", bottle.len())
}
