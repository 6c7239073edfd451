//! Bottles to bytes.

use super::error::EncodeError;
use super::kind::{DICT, Kind, LIST};
use super::{Bottle, Value};
use crate::Dialect;

/// Appends the bottle with its list code.
pub(super) fn bottle(
    bottle: &Bottle,
    out: &mut Vec<u8>,
    dialect: Dialect,
) -> Result<(), EncodeError> {
    let code = common_code(bottle, dialect)?;
    put(out, LIST + code.unwrap_or(0));
    put(out, length("a list", bottle.values.len())?);
    if code.is_some() {
        out.reserve(bottle.values.iter().map(least_size).sum());
    }
    for value in &bottle.values {
        match value {
            Value::List(list) => self::bottle(list, out, dialect)?,
            Value::Dict(list) => {
                put(out, DICT);
                self::bottle(list, out, dialect)?;
            }
            value => {
                if code.is_none() {
                    put(out, code_of(value, dialect)?.unwrap_or(0));
                }
                raw(value, out)?;
            }
        }
    }
    Ok(())
}

/// The code that all elements share, where they are no lists.
fn common_code(bottle: &Bottle, dialect: Dialect) -> Result<Option<i32>, EncodeError> {
    let Some((first, rest)) = bottle.values.split_first() else { return Ok(None) };
    let Some(kind) = kind(first) else { return Ok(None) };
    if !rest.iter().all(|value| self::kind(value) == Some(kind)) {
        return Ok(None);
    }
    code_of(first, dialect)
}

fn code_of(value: &Value, dialect: Dialect) -> Result<Option<i32>, EncodeError> {
    let Some(kind) = kind(value) else { return Ok(None) };
    match (kind.code(dialect), value) {
        (Some(code), _) => Ok(Some(code)),
        (None, Value::Vocab64(vocab)) => Err(EncodeError::NoVocab64(format!("{vocab:?}"))),
        (None, other) => Err(EncodeError::NoVocab64(format!("{other:?}"))),
    }
}

fn kind(value: &Value) -> Option<Kind> {
    match value {
        Value::String(_) => Some(Kind::String),
        Value::Blob(_) => Some(Kind::Blob),
        value => number(value).map(|(kind, _)| kind),
    }
}

/// Kind and bytes of a number or vocab; as many of the bytes count as its kind has.
fn number(value: &Value) -> Option<(Kind, [u8; 8])> {
    let (kind, bits) = match value {
        Value::Int8(number) => (Kind::Int8, i64::from(*number)),
        Value::Int16(number) => (Kind::Int16, i64::from(*number)),
        Value::Int32(number) => (Kind::Int32, i64::from(*number)),
        Value::Int64(number) => (Kind::Int64, *number),
        Value::Float32(number) => (Kind::Float32, i64::from(number.to_bits())),
        Value::Float64(number) => (Kind::Float64, number.to_bits().cast_signed()),
        Value::Vocab32(vocab) => (Kind::Vocab32, i64::from(vocab.0)),
        Value::Vocab64(vocab) => (Kind::Vocab64, vocab.0),
        Value::String(_) | Value::Blob(_) | Value::List(_) | Value::Dict(_) => return None,
    };
    Some((kind, bits.to_le_bytes()))
}

fn least_size(value: &Value) -> usize {
    let block = match value {
        Value::String(text) => text.as_bytes().len(),
        Value::Blob(bytes) => bytes.len(),
        _ => 0,
    };
    kind(value).map_or(0, Kind::size) + block
}

/// Writes the bytes of a value, which follow its code.
fn raw(value: &Value, out: &mut Vec<u8>) -> Result<(), EncodeError> {
    match value {
        Value::String(text) => block("a string", text.as_bytes(), out),
        Value::Blob(bytes) => block("a blob", bytes, out),
        value => {
            let number = number(value);
            let bytes = number.as_ref().and_then(|(kind, bytes)| bytes.get(..kind.size()));
            out.extend_from_slice(bytes.unwrap_or_default());
            Ok(())
        }
    }
}

fn block(what: &'static str, bytes: &[u8], out: &mut Vec<u8>) -> Result<(), EncodeError> {
    put(out, length(what, bytes.len())?);
    out.extend_from_slice(bytes);
    Ok(())
}

fn length(what: &'static str, length: usize) -> Result<i32, EncodeError> {
    i32::try_from(length).ok().ok_or(EncodeError::TooLong { what, length })
}

fn put(out: &mut Vec<u8>, number: i32) {
    out.extend_from_slice(&number.to_le_bytes());
}
