//! Text to values, in one pass.

use std::cell::Cell;

use bytes::Bytes;

use super::super::{DecodeError, Path};
use super::number;
use crate::Limits;
use crate::json_text::{self as text, RawString, TAG, Text};
use crate::plugin::Plugins;
use crate::types::{Map, Tensor, Value};

pub(super) type Result<T> = std::result::Result<T, DecodeError>;

/// A text, the position that reading has reached, and the budget of its values.
pub(super) struct Decoder<'a> {
    pub(super) bytes: &'a Bytes,
    pub(super) at: usize,
    pub(super) limits: &'a Limits,
    pub(super) plugins: &'a Plugins,
    /// Number of bytes that the values may still take.
    room: usize,
    /// Number of bytes that plug-ins have unpacked.
    pub(super) unpacked: Cell<u64>,
    /// Tensors that `tensor` tags refer to; `None` where these tags are ordinary members.
    pub(super) tensors: Option<&'a [Tensor]>,
}

/// Memory that the values of one message may take, as a multiple of the largest message. Short
/// values take far more than their text, up to two hundred times as much for `[[0],[0],…]`. Of the
/// messages of honest senders, lists of numbers come nearest, with some thirty times.
const ROOM_FACTOR: usize = 16;
/// Least room, for small limits.
const LEAST_ROOM: usize = 1 << 20;

/// Bytes that an allocation takes beside its content.
const ALLOCATION: usize = 32;

fn room(limits: &Limits) -> usize {
    limits.message_bytes.saturating_mul(ROOM_FACTOR).max(LEAST_ROOM)
}

pub(super) fn run(
    text: &Bytes,
    tensors: Option<&[Tensor]>,
    limits: &Limits,
    plugins: &Plugins,
) -> Result<Value> {
    DecodeError::check_size(text.len(), limits.message_bytes)?;
    let unpacked = Cell::new(0);
    let room = room(limits);
    let mut decoder = Decoder { bytes: text, at: 0, limits, plugins, room, unpacked, tensors };
    if text.starts_with(b"\xEF\xBB\xBF") {
        return Err(decoder.malformed(&Path::Root, "a byte order mark begins the text"));
    }
    let value = decoder.value(&Path::Root, 0)?;
    match decoder.peek() {
        None => Ok(value),
        Some(_) => Err(decoder.malformed(&Path::Root, "more text follows the value")),
    }
}

/// Meaning of an object's `__wrapyfi__` member for the object.
pub(super) enum Tagged {
    /// The object stands for this value.
    Value(Value),
    /// The object belongs to a plug-in with this key that is unknown, or that refused it for the
    /// reason given.
    Opaque { key: String, refused: Option<String> },
    /// The object is an ordinary one, with this value under the member.
    Plain(Value),
}

impl<'a> Decoder<'a> {
    pub(super) fn malformed(&self, path: &Path<'_>, reason: impl std::fmt::Display) -> DecodeError {
        DecodeError::Malformed {
            format: "JSON",
            path: path.to_string(),
            reason: format!("{reason} (byte {})", self.at),
        }
    }

    pub(super) fn rest(&self) -> &'a [u8] {
        self.bytes.get(self.at..).unwrap_or_default()
    }

    /// Skips white space and returns the next byte.
    pub(super) fn peek(&mut self) -> Option<u8> {
        let rest = self.rest();
        let space = |byte: &u8| matches!(byte, b' ' | b'\t' | b'\n' | b'\r');
        match rest.iter().position(|byte| !space(byte)) {
            Some(spaces) => {
                self.at += spaces;
                rest.get(spaces).copied()
            }
            None => {
                self.at = self.bytes.len();
                None
            }
        }
    }

    pub(super) fn take(&mut self, wanted: u8) -> bool {
        let found = self.peek() == Some(wanted);
        self.at += usize::from(found);
        found
    }

    fn expect(&mut self, wanted: u8, path: &Path<'_>) -> Result<()> {
        if self.take(wanted) {
            return Ok(());
        }
        Err(self.unexpected(path, &format!("{:?}", char::from(wanted))))
    }

    fn unexpected(&mut self, path: &Path<'_>, wanted: &str) -> DecodeError {
        match self.peek() {
            None => self.malformed(path, format!("the text ends where {wanted} should be")),
            Some(byte) if byte.is_ascii_graphic() => {
                self.malformed(path, format!("{:?} where {wanted} should be", char::from(byte)))
            }
            Some(byte) => {
                self.malformed(path, format!("byte {byte:#04x} where {wanted} should be"))
            }
        }
    }

    fn check_depth(&self, path: &Path<'_>, depth: usize) -> Result<()> {
        if depth <= self.limits.depth {
            return Ok(());
        }
        Err(DecodeError::over("nesting", path.to_string(), depth, self.limits.depth))
    }

    /// Takes `bytes` from the memory that the values may still take.
    fn take_room(&mut self, path: &Path<'_>, bytes: usize) -> Result<()> {
        if let Some(left) = self.room.checked_sub(bytes) {
            self.room = left;
            return Ok(());
        }
        let limit = room(self.limits);
        let wanted = (limit - self.room).saturating_add(bytes);
        Err(DecodeError::over("memory of the values", path.to_string(), wanted, limit))
    }

    /// Makes room for one more in `items`, which grow as a [`Vec`] does; the memory is taken from
    /// the budget before it is allocated.
    fn grow<T>(&mut self, path: &Path<'_>, items: &mut Vec<T>) -> Result<()> {
        if items.len() < items.capacity() {
            return Ok(());
        }
        // Most containers of messages are small: the first step is one, not four as in Vec.
        let more = items.capacity().max(1);
        self.take_room(path, more.saturating_mul(size_of::<T>()).saturating_add(ALLOCATION))?;
        items.reserve_exact(more);
        Ok(())
    }

    /// Reads a value inside `depth` containers.
    pub(super) fn value(&mut self, path: &Path<'_>, depth: usize) -> Result<Value> {
        match self.peek() {
            Some(b'{') => self.object(path, depth + 1),
            Some(b'[') => self.list(path, depth + 1).map(Value::List),
            Some(b'"') => {
                self.take_room(path, ALLOCATION)?;
                Ok(match self.text(path)? {
                    Text::Valid(text) => Value::Str(text),
                    Text::Utf16(units) => Value::Utf16(units),
                })
            }
            _ => self.scalar(path),
        }
    }

    fn scalar(&mut self, path: &Path<'_>) -> Result<Value> {
        let rest = self.rest();
        let words = [
            (&b"null"[..], Value::Null),
            (b"true", Value::Bool(true)),
            (b"false", Value::Bool(false)),
            (b"NaN", Value::Float(f64::NAN)),
            (b"Infinity", Value::Float(f64::INFINITY)),
        ];
        if let Some(b'-' | b'0'..=b'9') = rest.first() {
            let (value, length) =
                number::read(rest).map_err(|reason| self.malformed(path, reason))?;
            self.at += length;
            return Ok(value);
        }
        match words.into_iter().find(|(word, _)| rest.starts_with(word)) {
            Some((word, value)) => {
                self.at += word.len();
                Ok(value)
            }
            None => Err(self.unexpected(path, "a value")),
        }
    }

    /// Reads the string that begins here, without decoding it.
    pub(super) fn raw_string(&mut self, path: &Path<'_>) -> Result<RawString<'a>> {
        if self.peek() != Some(b'"') {
            return Err(self.unexpected(path, "a string in double quotes"));
        }
        let rest = self.rest().get(1..).unwrap_or_default();
        let string = text::find_end(rest);
        let string = string.ok_or_else(|| self.malformed(path, "a string does not end"))?;
        self.at += string.inner.len() + 2;
        Ok(string)
    }

    pub(super) fn text(&mut self, path: &Path<'_>) -> Result<Text> {
        let string = self.raw_string(path)?;
        string.decode().map_err(|reason| self.malformed(path, reason))
    }

    /// Reads a list that is itself the container number `depth`.
    pub(super) fn list(&mut self, path: &Path<'_>, depth: usize) -> Result<Vec<Value>> {
        self.check_depth(path, depth)?;
        self.expect(b'[', path)?;
        let mut items = Vec::new();
        if self.take(b']') {
            return Ok(items);
        }
        loop {
            self.grow(path, &mut items)?;
            items.push(self.value(&Path::Index(path, items.len()), depth)?);
            if !self.take(b',') {
                break;
            }
        }
        self.expect(b']', path)?;
        Ok(items)
    }

    fn object(&mut self, path: &Path<'_>, depth: usize) -> Result<Value> {
        self.check_depth(path, depth)?;
        let start = self.at;
        self.expect(b'{', path)?;
        let mut pairs = Vec::new();
        let mut tagged = None;
        if !self.take(b'}') {
            loop {
                let key = self.text(path)?;
                self.take_room(path, ALLOCATION)?;
                self.grow(path, &mut pairs)?;
                self.expect(b':', path)?;
                match key {
                    Text::Valid(key) if key == TAG => match self.tag(path, depth)? {
                        Tagged::Plain(value) => {
                            tagged = None;
                            pairs.push((Value::Str(key), value));
                        }
                        meaning => tagged = Some(meaning),
                    },
                    Text::Valid(key) => {
                        let value = self.value(&Path::Key(path, &key), depth)?;
                        pairs.push((Value::Str(key), value));
                    }
                    Text::Utf16(units) => {
                        let shown = String::from_utf16_lossy(&units);
                        let value = self.value(&Path::Key(path, &shown), depth)?;
                        pairs.push((Value::Utf16(units), value));
                    }
                }
                if !self.take(b',') {
                    break;
                }
            }
            self.expect(b'}', path)?;
        }
        Ok(match tagged {
            Some(Tagged::Value(value) | Tagged::Plain(value)) => value,
            Some(Tagged::Opaque { key, refused }) => {
                let json = self.bytes.slice(start..self.at);
                Value::Tagged(crate::types::Tagged { key, json, refused })
            }
            None => Value::Map(Map::from_iter(pairs)),
        })
    }

    /// Checks a value without building it.
    pub(super) fn skip(&mut self, path: &Path<'_>, depth: usize) -> Result<()> {
        let (open, close) = match self.peek() {
            Some(open @ b'{') => (open, b'}'),
            Some(open @ b'[') => (open, b']'),
            Some(b'"') => return self.skip_string(path),
            _ => return self.scalar(path).map(drop),
        };
        self.check_depth(path, depth + 1)?;
        self.expect(open, path)?;
        if self.take(close) {
            return Ok(());
        }
        loop {
            if open == b'{' {
                self.skip_string(path)?;
                self.expect(b':', path)?;
            }
            self.skip(path, depth + 1)?;
            if !self.take(b',') {
                break;
            }
        }
        self.expect(close, path)
    }

    fn skip_string(&mut self, path: &Path<'_>) -> Result<()> {
        let string = self.raw_string(path)?;
        string.check().map_err(|reason| self.malformed(path, reason))
    }
}
