//! Bottles: YARP's self-describing lists, as bytes and as text.
//!
//! ```text
//!   01 01 00 00  02 00 00 00 …  ──decode──▶  Bottle { values: [Int32(1), Int32(2)] }  ──▶  "1 2"
//!   00 00 00 00  05 00 00 00 …  ◀──encode──          (serde: any other format)        ◀──
//! ```
//!
//! Strings and blobs share the bytes they were read from. A list of numbers of one type is copied
//! in one go, as YARP writes it: without a code for each.

mod error;
mod value;

use bytes::Bytes;

pub use error::{BottleError, EncodeError, TextError};
pub use value::{Text, Value, Vocab, Vocab64};

use crate::{Dialect, Limits};

/// A list of values: what YARP sends unless it sends an image, a sound or a vector.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Bottle {
    /// The elements in order.
    pub values: Vec<Value>,
}

/// What [`Bottle::frame`] found out about bytes that are still arriving.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Frame {
    /// The bottle takes so many bytes, and they are all there.
    Complete(usize),
    /// At least so many further bytes are needed before anything more can be said.
    NeedMore(usize),
}

#[allow(clippy::unimplemented, clippy::needless_pass_by_value)]
impl Bottle {
    /// A bottle without elements.
    #[must_use]
    pub const fn new() -> Self {
        Self { values: Vec::new() }
    }

    /// Reads the bottle at the start of `bytes`; what follows it is left alone. Returns it with the
    /// number of bytes it took. Strings and blobs share `bytes`.
    ///
    /// # Errors
    /// When the bytes are not a whole bottle of that dialect, or exceed `limits`.
    pub fn decode(
        bytes: &Bytes,
        dialect: Dialect,
        limits: &Limits,
    ) -> Result<(Self, usize), BottleError> {
        let _ = (bytes, dialect, limits);
        unimplemented!()
    }

    /// How long the bottle at the start of `bytes` is, without building it: replies to requests
    /// come with no length before them.
    ///
    /// # Errors
    /// When the bytes so far cannot be the start of a bottle, or exceed `limits`.
    pub fn frame(bytes: &[u8], dialect: Dialect, limits: &Limits) -> Result<Frame, BottleError> {
        let _ = (bytes, dialect, limits);
        unimplemented!()
    }

    /// The bottle as bytes, as YARP writes it.
    ///
    /// # Errors
    /// When the dialect has no code for a value, or a length exceeds 31 bits.
    pub fn encode(&self, dialect: Dialect) -> Result<Vec<u8>, EncodeError> {
        let mut bytes = Vec::new();
        self.encode_into(&mut bytes, dialect)?;
        Ok(bytes)
    }

    /// [`Bottle::encode`] behind what `out` holds. After an error, `out` is as it was.
    ///
    /// # Errors
    /// As [`Bottle::encode`].
    pub fn encode_into(&self, out: &mut Vec<u8>, dialect: Dialect) -> Result<(), EncodeError> {
        let _ = (out, dialect);
        unimplemented!()
    }

    /// Reads YARP's text form, as typed into `yarp write` or sent over the text carriers. Like
    /// YARP, it takes any text: an unfinished list or string at the end is dropped.
    ///
    /// # Errors
    /// When the text exceeds `limits`.
    pub fn from_text(text: &[u8], limits: &Limits) -> Result<Self, TextError> {
        Self::from_text_as(text, Dialect::V3, limits)
    }

    /// [`Bottle::from_text`]; in [`Dialect::V4`], `[abcdefgh]` with more than four letters is a
    /// 64-bit vocab, which V3 cuts to four.
    ///
    /// # Errors
    /// As [`Bottle::from_text`].
    pub fn from_text_as(text: &[u8], dialect: Dialect, limits: &Limits) -> Result<Self, TextError> {
        let _ = (text, dialect, limits);
        unimplemented!()
    }

    /// The text form, on one line, with U+FFFD for bytes that are not UTF-8.
    #[must_use]
    pub fn to_text(&self) -> String {
        String::from_utf8_lossy(&self.to_text_bytes()).into_owned()
    }

    /// The text form, on one line, with every byte of its strings.
    #[must_use]
    pub fn to_text_bytes(&self) -> Vec<u8> {
        unimplemented!()
    }

    /// The value that belongs to `key`: in `(speed 3) name arm`, 3 to `speed` and `arm` to `name`.
    #[must_use]
    pub fn find(&self, key: &str) -> Option<&Value> {
        let _ = key;
        unimplemented!()
    }

    /// How many elements there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.values.len()
    }

    /// Whether there are no elements.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// The element at `index`, from 0.
    #[must_use]
    pub fn get(&self, index: usize) -> Option<&Value> {
        self.values.get(index)
    }

    /// Appends an element.
    pub fn push(&mut self, value: impl Into<Value>) {
        self.values.push(value.into());
    }
}

impl From<Vec<Value>> for Bottle {
    fn from(values: Vec<Value>) -> Self {
        Self { values }
    }
}

impl FromIterator<Value> for Bottle {
    fn from_iter<T: IntoIterator<Item = Value>>(values: T) -> Self {
        Self { values: values.into_iter().collect() }
    }
}

impl Extend<Value> for Bottle {
    fn extend<T: IntoIterator<Item = Value>>(&mut self, values: T) {
        self.values.extend(values);
    }
}

impl IntoIterator for Bottle {
    type Item = Value;
    type IntoIter = std::vec::IntoIter<Value>;

    fn into_iter(self) -> Self::IntoIter {
        self.values.into_iter()
    }
}

impl<'a> IntoIterator for &'a Bottle {
    type Item = &'a Value;
    type IntoIter = std::slice::Iter<'a, Value>;

    fn into_iter(self) -> Self::IntoIter {
        self.values.iter()
    }
}
