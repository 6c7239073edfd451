//! Native objects: one string of JSON, as Wrapyfi writes them.

use bytes::Bytes;
use wrapyfi_yarp::{Bottle, Dialect, Value as Element};

use super::super::options::YarpOptions;
use super::fault;
use crate::codec::{DecodeError, EncodeError, json};
use crate::endpoint::TopicSpec;
use crate::types::Value;

/// Writes an object as one string of JSON.
pub(super) fn encode(
    value: &Value,
    spec: &TopicSpec,
    _options: &YarpOptions,
    dialect: Dialect,
) -> Result<Vec<u8>, EncodeError> {
    let text = json::encode_with(value, &spec.plugins)?;
    let bottle = Bottle { values: vec![Element::string(text)] };
    bottle.encode(dialect).map_err(|error| fault::encode(&error))
}

/// Reads an object out of a bottle of one string of JSON.
pub(super) fn decode(
    bytes: &Bytes,
    spec: &TopicSpec,
    _options: &YarpOptions,
    dialect: Dialect,
) -> Result<Value, DecodeError> {
    let bottle = Bottle::decode_whole(bytes, dialect, &fault::limits(&spec.limits));
    match bottle.map_err(|error| fault::bottle(&error))?.values.as_slice() {
        [Element::String(text)] => {
            json::decode_with(&text.clone().into_bytes(), &spec.limits, &spec.plugins)
        }
        other => Err(fault::mismatch("one string", format!("{} values", other.len()))),
    }
}
