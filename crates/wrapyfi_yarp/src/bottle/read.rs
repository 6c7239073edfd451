//! Bytes to bottles.

use bytes::Bytes;

use super::error::BottleError;
use super::kind::{Code, Kind, LIST};
use super::{Bottle, Text, Value, Vocab, Vocab64};
use crate::{Dialect, WireLimits};

/// Elements for which a list of mixed kinds reserves memory before it has read them: lists in lists
/// that claim more than they send gain nothing.
const RESERVED: usize = 4;
/// Least bytes that an element with its code takes: an int8.
const LEAST: usize = 5;

/// Reads values one after the other.
pub(super) struct Reader<'a> {
    bytes: &'a Bytes,
    at: usize,
    dialect: Dialect,
    limits: &'a WireLimits,
    elements_left: usize,
}

impl<'a> Reader<'a> {
    pub(super) fn new(bytes: &'a Bytes, dialect: Dialect, limits: &'a WireLimits) -> Self {
        Self { bytes, at: 0, dialect, limits, elements_left: limits.max_elements }
    }

    /// A bottle with its own list code. `depth` counts the lists around it.
    pub(super) fn bottle(&mut self, depth: usize) -> Result<Bottle, BottleError> {
        let at = self.at;
        let code = self.int("a list code")?;
        self.list(list_kind(code, at, self.dialect)?, depth)
    }

    /// Offset of the next value; never beyond the limit of a message.
    pub(super) fn end(&self) -> Result<usize, BottleError> {
        if self.at > self.limits.max_message_bytes {
            let limit = self.limits.max_message_bytes;
            return Err(BottleError::TooLong { length: self.at, limit });
        }
        Ok(self.at)
    }

    fn list(&mut self, kind: Option<Kind>, depth: usize) -> Result<Bottle, BottleError> {
        if depth >= self.limits.depth() {
            return Err(BottleError::TooDeep { limit: self.limits.depth() });
        }
        let count_at = self.at;
        let count = self.length("the count of a list")?;
        let least = kind.map_or(LEAST, Kind::size);
        let left = self.left();
        let needed = count.saturating_mul(least);
        if needed > left {
            return Err(BottleError::Damaged(format!(
                "a list of {count} elements at byte {count_at} needs {needed} bytes or more, \
                 {left} are left: the message is damaged"
            )));
        }
        self.elements_left = self
            .elements_left
            .checked_sub(count)
            .ok_or(BottleError::TooManyElements(self.limits.max_elements))?;
        let values = match kind {
            Some(kind) if kind.is_sized() => numbers(kind, self.take("numbers of a list", needed)?),
            Some(kind) => {
                let mut values = Vec::with_capacity(count);
                for _ in 0..count {
                    values.push(self.value(kind)?);
                }
                values
            }
            None => {
                let mut values = Vec::with_capacity(count.min(RESERVED));
                for _ in 0..count {
                    values.push(self.element(depth)?);
                }
                values
            }
        };
        Ok(Bottle { values })
    }

    /// A value behind its code.
    fn element(&mut self, depth: usize) -> Result<Value, BottleError> {
        let at = self.at;
        let code = self.int("a type code")?;
        match Code::of(code, self.dialect) {
            Some(Code::Value(kind)) => self.value(kind),
            Some(Code::List(kind)) => self.list(kind, depth + 1).map(Value::List),
            Some(Code::Dict) => self.bottle(depth + 1).map(Value::Dict),
            None => Err(wrong_code(code, at, self.dialect)),
        }
    }

    fn value(&mut self, kind: Kind) -> Result<Value, BottleError> {
        match kind {
            Kind::String => self.block("a string").map(|bytes| Value::String(Text::from(bytes))),
            Kind::Blob => self.block("a blob").map(Value::Blob),
            number => {
                let bytes = self.take(number.name(), number.size())?;
                let value = numbers(number, bytes).pop();
                Ok(value.unwrap_or(Value::Int32(0)))
            }
        }
    }

    /// A length and so many bytes, shared with the message.
    fn block(&mut self, what: &'static str) -> Result<Bytes, BottleError> {
        let length = self.length(what)?;
        let start = self.at;
        self.take(what, length)?;
        Ok(self.bytes.slice(start..self.at))
    }

    fn length(&mut self, what: &'static str) -> Result<usize, BottleError> {
        let at = self.at;
        BottleError::length(what, at, self.int(what)?)
    }

    fn int(&mut self, what: &'static str) -> Result<i32, BottleError> {
        let bytes = self.take(what, 4)?;
        Ok(bytes.first_chunk().map_or(0, |bytes| i32::from_le_bytes(*bytes)))
    }

    fn take(&mut self, what: &'static str, needed: usize) -> Result<&'a [u8], BottleError> {
        let (at, left) = (self.at, self.left());
        let taken = self.bytes.get(at..).and_then(|rest| rest.get(..needed));
        let taken = taken.ok_or_else(|| {
            BottleError::Damaged(format!(
                "{what} at byte {at} needs {needed} bytes, {left} are left: the message was cut short"
            ))
        })?;
        self.at += needed;
        Ok(taken)
    }

    fn left(&self) -> usize {
        self.bytes.len().saturating_sub(self.at)
    }
}

/// Kind of the elements of the list that a code begins, where they come without codes.
pub(super) fn list_kind(
    code: i32,
    at: usize,
    dialect: Dialect,
) -> Result<Option<Kind>, BottleError> {
    match Code::of(code, dialect) {
        Some(Code::List(kind)) => Ok(kind),
        None if code & LIST != 0 => Err(wrong_code(code, at, dialect)),
        _ => Err(BottleError::Damaged(format!(
            "a bottle begins with a list code (256 and above), not with {code}: it is no bottle"
        ))),
    }
}

/// Says of a code that `dialect` lacks whether the other dialect has it.
pub(super) fn wrong_code(code: i32, at: usize, dialect: Dialect) -> BottleError {
    let Some(Code::Value(kind) | Code::List(Some(kind))) = Code::of(code, dialect.other()) else {
        return BottleError::Damaged(format!(
            "type code {code} at byte {at} is none of YARP's: the message is damaged, or not a bottle"
        ));
    };
    BottleError::OtherDialect { code, at, meaning: kind.name(), dialect }
}

/// Numbers of one kind that fill `bytes`, in one pass and one allocation.
fn numbers(kind: Kind, bytes: &[u8]) -> Vec<Value> {
    fn all<const N: usize>(bytes: &[u8], value: impl Fn([u8; N]) -> Value) -> Vec<Value> {
        bytes.as_chunks::<N>().0.iter().map(|chunk| value(*chunk)).collect()
    }
    match kind {
        Kind::Int8 => all(bytes, |chunk| Value::Int8(i8::from_le_bytes(chunk))),
        Kind::Int16 => all(bytes, |chunk| Value::Int16(i16::from_le_bytes(chunk))),
        Kind::Int32 => all(bytes, |chunk| Value::Int32(i32::from_le_bytes(chunk))),
        Kind::Int64 => all(bytes, |chunk| Value::Int64(i64::from_le_bytes(chunk))),
        Kind::Float32 => all(bytes, |chunk| Value::Float32(f32::from_le_bytes(chunk))),
        Kind::Float64 => all(bytes, |chunk| Value::Float64(f64::from_le_bytes(chunk))),
        Kind::Vocab32 => all(bytes, |chunk| Value::Vocab32(Vocab(i32::from_le_bytes(chunk)))),
        Kind::Vocab64 => all(bytes, |chunk| Value::Vocab64(Vocab64(i64::from_le_bytes(chunk)))),
        Kind::String | Kind::Blob => Vec::new(),
    }
}
