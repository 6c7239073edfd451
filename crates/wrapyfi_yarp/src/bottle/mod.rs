//! Bottles: YARP's self-describing lists, as bytes and as text.
//!
//! ```text
//!   01 01 00 00  02 00 00 00 …  ──decode──▶  Bottle { values: [Int32(1), Int32(2)] }  ──▶  "1 2"
//!   00 00 00 00  05 00 00 00 …  ◀──encode──                                           ◀──
//! ```
//!
//! Strings and blobs share the bytes they were read from. A list of numbers of one type is copied
//! in one go, as YARP writes it: without a code for each.

mod error;
mod kind;
mod list;
mod read;
mod scan;
mod text_read;
mod text_write;
mod value;
mod write;

use bytes::Bytes;

pub use error::{BottleError, EncodeError};
pub use list::Bottle;
pub use scan::BottleScan;
pub(crate) use text_write::significant;
pub use value::{Text, Value, Vocab, Vocab64};

use read::Reader;
use text_read::TextReader;
use text_write::is_key;

use crate::{Dialect, WireLimits};

/// State of a bottle whose bytes are still arriving, found by [`Bottle::frame`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Frame {
    /// The bottle takes so many bytes, and they are all there.
    Complete(usize),
    /// Least number of further bytes that are needed before anything more can be said.
    NeedMore(usize),
}

impl Bottle {
    /// Reads the bottle at the start of `bytes`; what follows it is left alone. Returns it with the
    /// number of bytes it took. Strings and blobs share `bytes`.
    ///
    /// # Errors
    /// When the bytes are not a whole bottle of that dialect, or exceed `limits`.
    pub fn decode(
        bytes: &Bytes,
        dialect: Dialect,
        limits: &WireLimits,
    ) -> Result<(Self, usize), BottleError> {
        let mut reader = Reader::new(bytes, dialect, limits);
        let bottle = reader.bottle(0)?;
        Ok((bottle, reader.end()?))
    }

    /// [`Bottle::decode`] of a message whose length is known: the bottle has to fill `bytes`.
    ///
    /// # Errors
    /// As [`Bottle::decode`], and when bytes are left over.
    pub fn decode_whole(
        bytes: &Bytes,
        dialect: Dialect,
        limits: &WireLimits,
    ) -> Result<Self, BottleError> {
        let (bottle, used) = Self::decode(bytes, dialect, limits)?;
        let length = bytes.len();
        if used < length {
            return Err(BottleError::Damaged(format!(
                "the bottle ends after {used} of {length} bytes: the message is damaged, or in a \
                 dialect other than {dialect}"
            )));
        }
        Ok(bottle)
    }

    /// [`Bottle::decode_whole`] from a peer whose dialect is not known: in `preferred`, and in the
    /// other one where that does not fit the length. Returns the dialect that did; an empty bottle,
    /// or one without floats, fits both. Only for bytes whose length comes from a frame: what a
    /// sender of the wrong dialect means shows in nothing else.
    ///
    /// # Errors
    /// When neither fits: the error of `preferred`.
    pub fn decode_either(
        bytes: &Bytes,
        preferred: Dialect,
        limits: &WireLimits,
    ) -> Result<(Self, Dialect), BottleError> {
        let error = match Self::decode_whole(bytes, preferred, limits) {
            Ok(bottle) => return Ok((bottle, preferred)),
            Err(error) => error,
        };
        let other = preferred.other();
        Self::decode_whole(bytes, other, limits).map_or(Err(error), |bottle| Ok((bottle, other)))
    }

    /// Length of the bottle at the start of `bytes`, without building it: replies to requests come
    /// with no length before them. [`BottleScan`] does the same without starting again.
    ///
    /// # Errors
    /// When the bytes so far cannot be the start of a bottle, or exceed `limits`.
    pub fn frame(
        bytes: &[u8],
        dialect: Dialect,
        limits: &WireLimits,
    ) -> Result<Frame, BottleError> {
        BottleScan::new(dialect, limits).advance(bytes)
    }

    /// True when `bytes` are a bottle of that dialect, and nothing else.
    pub fn is_whole(bytes: &[u8], dialect: Dialect, limits: &WireLimits) -> bool {
        Self::frame(bytes, dialect, limits) == Ok(Frame::Complete(bytes.len()))
    }

    /// The bottle as bytes, as YARP writes it.
    ///
    /// # Errors
    /// When the dialect has no code for a value, or a length exceeds 31 bits.
    pub fn encode(&self, dialect: Dialect) -> Result<Vec<u8>, EncodeError> {
        let mut bytes = Vec::new();
        write::bottle(self, &mut bytes, dialect)?;
        Ok(bytes)
    }

    /// Reads YARP's text form, as typed into `yarp write` or sent over the text carriers. Like
    /// YARP, it takes any text: an unfinished list or string at the end is dropped.
    ///
    /// # Errors
    /// When the text exceeds `limits`.
    pub fn from_text(text: &[u8], limits: &WireLimits) -> Result<Self, BottleError> {
        Self::from_text_as(text, Dialect::V3, limits)
    }

    /// [`Bottle::from_text`]; in [`Dialect::V4`], `[abcdefgh]` with more than four letters is a
    /// 64-bit vocab, which V3 cuts to four.
    ///
    /// # Errors
    /// As [`Bottle::from_text`].
    pub fn from_text_as(
        text: &[u8],
        dialect: Dialect,
        limits: &WireLimits,
    ) -> Result<Self, BottleError> {
        let (length, limit) = (text.len(), limits.max_message_bytes);
        if length > limit {
            return Err(BottleError::TooLong { length, limit });
        }
        TextReader::new(dialect, limits).bottle(text, 0)
    }

    /// The text form, on one line, with U+FFFD for bytes that are not UTF-8.
    pub fn to_text(&self) -> String {
        String::from_utf8_lossy(&self.to_text_bytes()).into_owned()
    }

    /// The text form, on one line, with every byte of its strings. As in YARP, reading it back loses
    /// the widths of numbers, dictionaries (they become lists), letters of vocabs beyond ASCII, and
    /// strings that are `null`, `inf` or `nan`, which have no quotes.
    pub fn to_text_bytes(&self) -> Vec<u8> {
        let mut text = Vec::new();
        text_write::bottle(self, &mut text);
        text
    }

    /// The value that belongs to `key`: in `(speed 3) name arm`, 3 to `speed` and `arm` to `name`.
    /// The key may be a string, a vocab or a number. A first match with nothing behind it has no
    /// value, as in YARP.
    pub fn find(&self, key: &str) -> Option<&Value> {
        let (index, element) = self.keyed(key)?;
        match element {
            Value::List(list) => list.values.get(1),
            _ => self.values.get(index + 1),
        }
    }

    /// The first element that is `key`, or a list that begins with it.
    fn keyed(&self, key: &str) -> Option<(usize, &Value)> {
        self.values.iter().enumerate().find(|(_, element)| match element {
            Value::List(list) => list.values.first().is_some_and(|first| is_key(first, key)),
            other => is_key(other, key),
        })
    }
}
