//! Writer of pickles part by part, as the machine that reads them works: the parts lie on its
//! stack, and one instruction makes a value of them. It is for objects that call constructors on
//! objects, where nested closures would hide the order of the parts.
//!
//! ```text
//!   to.global("pandas", "RangeIndex").mark().int(0).int(3).int(1).tuple_since_mark().reduce()
//! ```

use bytes::Bytes;
use num_bigint::BigInt;

use super::{Part, PluginError};
use crate::codec::pickle::{Protocol, Writer};

const MARK: u8 = b'(';
const TUPLE: u8 = b't';
const LIST: u8 = b'l';
const DICT: u8 = b'd';
const REDUCE: u8 = b'R';
const POP: u8 = b'0';
const MEMOIZE: u8 = 0x94;
const LONG_BINGET: u8 = b'j';

/// A pickle of protocol 5 in the making.
pub(super) struct Stack {
    writer: Writer,
    memo: u32,
}

impl Stack {
    /// An empty pickle.
    pub(super) fn new() -> Self {
        Self { writer: Writer::new(Protocol::V5), memo: 0 }
    }

    /// Ends the pickle and returns it with the buffers beside it, as the parts of a plug-in.
    pub(super) fn into_parts(self) -> Result<Vec<Part>, PluginError> {
        let pickled = self.writer.finish().map_err(|error| {
            PluginError::unsupported("an object that no pickle holds", error.to_string())
        })?;
        let buffers = pickled.buffers.into_iter().map(Part::base64);
        Ok(std::iter::once(Part::Latin1(pickled.data.into())).chain(buffers).collect())
    }

    fn with(&mut self, write: impl FnOnce(&mut Writer)) -> &mut Self {
        write(&mut self.writer);
        self
    }

    pub(super) fn none(&mut self) -> &mut Self {
        self.with(Writer::none)
    }

    pub(super) fn bool(&mut self, value: bool) -> &mut Self {
        self.with(|to| to.bool(value))
    }

    pub(super) fn int(&mut self, value: i64) -> &mut Self {
        self.with(|to| to.int(value))
    }

    pub(super) fn big_int(&mut self, value: &BigInt) -> &mut Self {
        self.with(|to| to.big_int(value))
    }

    pub(super) fn float(&mut self, value: f64) -> &mut Self {
        self.with(|to| to.float(value))
    }

    pub(super) fn str(&mut self, text: &str) -> &mut Self {
        self.with(|to| to.str(text))
    }

    pub(super) fn bytes(&mut self, bytes: &[u8]) -> &mut Self {
        self.with(|to| to.bytes(bytes))
    }

    /// Adds a buffer beside the pickle.
    pub(super) fn buffer(&mut self, content: Bytes) -> &mut Self {
        self.with(|to| to.buffer(content))
    }

    /// Writes a function or class by name.
    pub(super) fn global(&mut self, module: &'static str, name: &'static str) -> &mut Self {
        self.with(|to| to.global(module, name))
    }

    /// Marks the begin of a tuple, list or dict.
    pub(super) fn mark(&mut self) -> &mut Self {
        self.with(|to| to.op(MARK))
    }

    pub(super) fn tuple_since_mark(&mut self) -> &mut Self {
        self.with(|to| to.op(TUPLE))
    }

    pub(super) fn list_since_mark(&mut self) -> &mut Self {
        self.with(|to| to.op(LIST))
    }

    /// Makes a dict of key, value, key, value, … since the mark.
    pub(super) fn dict_since_mark(&mut self) -> &mut Self {
        self.with(|to| to.op(DICT))
    }

    /// Makes a `tuple` of the last `count` parts, 1 to 3.
    pub(super) fn tuple(&mut self, count: u8) -> &mut Self {
        self.with(|to| to.op(0x84 + count.clamp(1, 3)))
    }

    /// Applies the function below the tuple on top to that tuple.
    pub(super) fn reduce(&mut self) -> &mut Self {
        self.with(|to| to.op(REDUCE))
    }

    /// Drops the part on top.
    pub(super) fn pop(&mut self) -> &mut Self {
        self.with(|to| to.op(POP))
    }

    /// Puts the part on top into the memo, where it stays; [`Self::recall`] pushes it again.
    pub(super) fn remember(&mut self) -> u32 {
        let number = self.memo;
        self.memo += 1;
        self.with(|to| to.op(MEMOIZE));
        number
    }

    /// Pushes the object with this number in the memo.
    pub(super) fn recall(&mut self, number: u32) -> &mut Self {
        self.with(|to| {
            to.op(LONG_BINGET);
            to.raw(&number.to_le_bytes());
        })
    }

    /// Writes a `numpy.ndarray` over a buffer beside the pickle. `descr` is NumPy's: `<f8`,
    /// `<M8[ns]`.
    pub(super) fn array(&mut self, descr: &str, length: usize, data: Bytes) -> &mut Self {
        self.with(|to| to.described_beside(&format!("'{descr}'"), &[length], data))
    }

    /// Writes a `numpy.ndarray` of the `count` objects that `items` writes.
    pub(super) fn objects(&mut self, count: usize, items: impl FnOnce(&mut Writer)) -> &mut Self {
        self.with(|to| to.object_array(&[count], items))
    }
}
