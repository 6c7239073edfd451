//! Text to bottles, as YARP reads it: it takes nearly anything.
//!
//! ```text
//!   [set] pos (1 2.5), "two words"
//!   └┬──┘ └┬┘ └──┬──┘  └────┬────┘    words: apart by blanks and commas, outside of ( ) { } " "
//!  vocab string list      string      meaning: by the first letter, or the shape of a number
//! ```

mod number;

use bytes::Bytes;

use super::error::BottleError;
use super::{Bottle, Text, Value, Vocab, Vocab64};
use crate::{Dialect, WireLimits};

/// Reads words into values.
pub(super) struct TextReader<'a> {
    dialect: Dialect,
    limits: &'a WireLimits,
    elements_left: usize,
}

impl<'a> TextReader<'a> {
    pub(super) fn new(dialect: Dialect, limits: &'a WireLimits) -> Self {
        Self { dialect, limits, elements_left: limits.max_elements }
    }

    /// The bottle of `text`. `depth` counts the lists around it.
    pub(super) fn bottle(&mut self, text: &[u8], depth: usize) -> Result<Bottle, BottleError> {
        let limit = self.limits.depth();
        if depth >= limit {
            return Err(BottleError::TooDeep { limit });
        }
        let mut values = Vec::new();
        for word in Words::new(text) {
            self.elements_left = self
                .elements_left
                .checked_sub(1)
                .ok_or(BottleError::TooManyElements(self.limits.max_elements))?;
            values.push(self.value(word, depth)?);
        }
        Ok(Bottle { values })
    }

    /// The value of one word, which is not empty.
    fn value(&mut self, word: &[u8], depth: usize) -> Result<Value, BottleError> {
        if let Some(value) = scalar(word) {
            return Ok(value);
        }
        Ok(match word.first() {
            Some(b'(') => Value::List(self.bottle(inside(word), depth + 1)?),
            Some(b'[') if self.dialect == Dialect::V4 && inside(word).len() > 4 => {
                Value::Vocab64(Vocab64::from_bytes(inside(word)))
            }
            Some(b'[') => Value::Vocab32(Vocab::from_bytes(inside(word))),
            Some(b'{') => Value::Blob(blob(inside(word))),
            _ => string(word),
        })
    }
}

/// Words that mean themselves: `null`, and numbers.
fn scalar(word: &[u8]) -> Option<Value> {
    if word == b"null" {
        return Some(Value::vocab("null"));
    }
    number::read(word)
}

/// Bytes between the first and the last, whatever those are.
fn inside(word: &[u8]) -> &[u8] {
    word.get(1..word.len().saturating_sub(1)).unwrap_or_default()
}

fn string(word: &[u8]) -> Value {
    let quoted = word.first() == Some(&b'"');
    let raw = if quoted { inside(word) } else { word };
    let mut text = Vec::with_capacity(raw.len());
    let mut bytes = raw.iter().copied();
    while let Some(byte) = bytes.next() {
        if byte != b'\\' {
            text.push(byte);
            continue;
        }
        match bytes.next() {
            Some(b'n') => text.push(b'\n'),
            Some(b'r') => text.push(b'\r'),
            Some(b'0') => text.push(0),
            Some(other) => text.push(other),
            None => {}
        }
    }
    match text.as_slice() {
        b"true" if !quoted => Value::from(true),
        b"false" if !quoted => Value::from(false),
        _ => Value::String(Text::from(text)),
    }
}

/// Bytes as decimal numbers. A word that is no number counts as 0, and of a larger one the low
/// byte.
fn blob(text: &[u8]) -> Bytes {
    let byte = |word: &[u8]| match scalar(word) {
        Some(Value::Float64(number)) => number as i32 as u8,
        Some(Value::Vocab32(vocab)) => vocab.0 as u8,
        Some(value) => value.as_i64().unwrap_or(0) as u8,
        None if word.first() == Some(&b'[') => Vocab::from_bytes(inside(word)).0 as u8,
        None => match string(word) {
            Value::Vocab32(vocab) => vocab.0 as u8,
            _ => 0,
        },
    };
    Words::new(text).map(byte).collect()
}

/// The words of a text, in order. One that is not finished at the end is dropped.
struct Words<'a> {
    text: &'a [u8],
    at: usize,
    quoted: bool,
    /// Open `(` less closing `)`; below zero, nothing separates any more.
    round: i64,
    /// Open `{` less closing `}`.
    curly: i64,
}

impl<'a> Words<'a> {
    fn new(text: &'a [u8]) -> Self {
        Self { text, at: 0, quoted: false, round: 0, curly: 0 }
    }

    fn separates(&self, byte: u8) -> bool {
        let separator = matches!(byte, b' ' | b'\t' | b'\n' | b'\r' | b',');
        separator && !self.quoted && self.round == 0 && self.curly == 0
    }
}

impl<'a> Iterator for Words<'a> {
    type Item = &'a [u8];

    fn next(&mut self) -> Option<&'a [u8]> {
        let text = self.text;
        let mut start = self.at;
        // The end of the text separates like a blank.
        while self.at <= text.len() {
            let byte = text.get(self.at).copied().unwrap_or(b' ');
            let at = self.at;
            self.at += 1;
            if byte == b'\\' {
                // Takes what follows as it is, even the end: then the word stays unfinished.
                self.at += 1;
                continue;
            }
            if byte == b'"' {
                self.quoted = !self.quoted;
            }
            if !self.quoted {
                match byte {
                    b'(' => self.round += 1,
                    b')' => self.round -= 1,
                    b'{' => self.curly += 1,
                    b'}' => self.curly -= 1,
                    _ => {}
                }
            }
            if self.separates(byte) {
                let word = text.get(start..at).unwrap_or_default();
                start = self.at;
                if !word.is_empty() {
                    return Some(word);
                }
            }
        }
        None
    }
}
