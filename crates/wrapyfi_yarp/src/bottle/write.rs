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
    Some(match value {
        Value::Int8(_) => Kind::Int8,
        Value::Int16(_) => Kind::Int16,
        Value::Int32(_) => Kind::Int32,
        Value::Int64(_) => Kind::Int64,
        Value::Float32(_) => Kind::Float32,
        Value::Float64(_) => Kind::Float64,
        Value::Vocab32(_) => Kind::Vocab32,
        Value::Vocab64(_) => Kind::Vocab64,
        Value::String(_) => Kind::String,
        Value::Blob(_) => Kind::Blob,
        Value::List(_) | Value::Dict(_) => return None,
    })
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
        Value::Int8(number) => out.extend_from_slice(&number.to_le_bytes()),
        Value::Int16(number) => out.extend_from_slice(&number.to_le_bytes()),
        Value::Int32(number) => out.extend_from_slice(&number.to_le_bytes()),
        Value::Int64(number) => out.extend_from_slice(&number.to_le_bytes()),
        Value::Float32(number) => out.extend_from_slice(&number.to_le_bytes()),
        Value::Float64(number) => out.extend_from_slice(&number.to_le_bytes()),
        Value::Vocab32(vocab) => out.extend_from_slice(&vocab.0.to_le_bytes()),
        Value::Vocab64(vocab) => out.extend_from_slice(&vocab.0.to_le_bytes()),
        Value::String(text) => block("a string", text.as_bytes(), out)?,
        Value::Blob(bytes) => block("a blob", bytes, out)?,
        Value::List(_) | Value::Dict(_) => {}
    }
    Ok(())
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
