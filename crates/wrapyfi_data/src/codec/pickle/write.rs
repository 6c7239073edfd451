//! Writes pickles that Python loads: data, and the names that make objects of it.
//!
//! ```text
//!   Writer: values and containers in order ─▶ opcodes     buffers beside them (protocol 5)
//! ```

use bytes::Bytes;
use num_bigint::BigInt;

use super::super::EncodeError;
use super::error::unwritable;
use super::opcode as op;

/// Format of a pickle. All of them are read by any Python 3 that knows them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Protocol {
    /// Protocol of Python 2.3, which `torch.save` writes.
    V2 = 2,
    /// Protocol of Python 3.4, which `paddle.save` writes.
    V4 = 4,
    /// Protocol of Python 3.8, which Wrapyfi writes: buffers may travel beside the pickle.
    V5 = 5,
}

/// A pickle, and the buffers that travel beside it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pickled {
    /// The pickle.
    pub data: Vec<u8>,
    /// Out-of-band buffers in their order; none before protocol 5.
    pub buffers: Vec<Bytes>,
}

/// Writes one pickle. Each method writes one object; containers write theirs inside a closure.
///
/// ```
/// use wrapyfi_data::codec::pickle::{Protocol, Writer};
///
/// let mut writer = Writer::new(Protocol::V2);
/// writer.tuple(|tuple| {
///     tuple.str("speed");
///     tuple.float(1.5);
/// });
/// let pickle = writer.finish()?;
/// assert_eq!(pickle.data, b"\x80\x02(X\x05\0\0\0speedG?\xf8\0\0\0\0\0\0t.");
/// # Ok::<(), wrapyfi_data::EncodeError>(())
/// ```
#[derive(Debug)]
pub struct Writer {
    protocol: Protocol,
    out: Vec<u8>,
    buffers: Vec<Bytes>,
    /// The first thing that could not be written.
    fault: Option<EncodeError>,
}

impl Writer {
    /// An empty pickle.
    #[must_use]
    pub fn new(protocol: Protocol) -> Self {
        Self { protocol, out: vec![op::PROTO, protocol as u8], buffers: Vec::new(), fault: None }
    }

    /// Protocol of the pickle.
    #[must_use]
    pub fn protocol(&self) -> Protocol {
        self.protocol
    }

    /// Ends the pickle after the one object that was written.
    ///
    /// # Errors
    /// When something inside has no form in this protocol.
    pub fn finish(mut self) -> Result<Pickled, EncodeError> {
        self.out.push(op::STOP);
        match self.fault {
            Some(fault) => Err(fault),
            None => Ok(Pickled { data: self.out, buffers: self.buffers }),
        }
    }

    pub(crate) fn op(&mut self, code: u8) {
        self.out.push(code);
    }

    pub(crate) fn raw(&mut self, bytes: &[u8]) {
        self.out.extend_from_slice(bytes);
    }

    pub(super) fn fail(&mut self, what: impl Into<String>, remedy: &str) {
        self.fault.get_or_insert_with(|| unwritable(what, remedy));
    }

    /// `None`.
    pub fn none(&mut self) {
        self.op(op::NONE);
    }

    /// `True` or `False`.
    pub fn bool(&mut self, value: bool) {
        self.op(if value { op::NEWTRUE } else { op::NEWFALSE });
    }

    /// An integer.
    pub fn int(&mut self, value: i64) {
        if let Ok(value) = u8::try_from(value) {
            self.raw(&[op::BININT1, value]);
        } else if let Ok(value) = i32::try_from(value) {
            self.op(op::BININT);
            self.raw(&value.to_le_bytes());
        } else {
            self.raw(&[op::LONG1, 8]);
            self.raw(&value.to_le_bytes());
        }
    }

    /// A size or an index.
    pub fn size(&mut self, value: usize) {
        match i64::try_from(value) {
            Ok(value) => self.int(value),
            Err(_) => self.big_int(&value.into()),
        }
    }

    /// An integer of any size.
    pub fn big_int(&mut self, value: &BigInt) {
        let bytes = value.to_signed_bytes_le();
        self.counted(op::LONG1, op::LONG4, None, &bytes);
    }

    /// A float.
    pub fn float(&mut self, value: f64) {
        self.op(op::BINFLOAT);
        self.raw(&value.to_be_bytes());
    }

    /// Text.
    pub fn str(&mut self, text: &str) {
        self.utf8(text.as_bytes());
    }

    /// Text that may have lone surrogates, as UTF-16 code units.
    pub fn utf16(&mut self, units: &[u16]) {
        let mut bytes = Vec::with_capacity(units.len() * 3);
        for unit in char::decode_utf16(units.iter().copied()) {
            match unit {
                Ok(c) => bytes.extend_from_slice(c.encode_utf8(&mut [0; 4]).as_bytes()),
                // What it would be in UTF-8: Python's `surrogatepass`.
                Err(lone) => {
                    let [low, high] = lone.unpaired_surrogate().to_le_bytes();
                    bytes.extend([0xED, 0x80 | high << 2 & 0x3C | low >> 6, 0x80 | low & 0x3F]);
                }
            }
        }
        self.utf8(&bytes);
    }

    fn utf8(&mut self, bytes: &[u8]) {
        if self.protocol >= Protocol::V4 {
            self.counted(op::SHORT_BINUNICODE, op::BINUNICODE, Some(op::BINUNICODE8), bytes);
        } else {
            self.counted(op::BINUNICODE, op::BINUNICODE, None, bytes);
        }
    }

    /// `bytes`.
    pub fn bytes(&mut self, bytes: &[u8]) {
        if self.protocol >= Protocol::V4 {
            self.counted(op::SHORT_BINBYTES, op::BINBYTES, Some(op::BINBYTES8), bytes);
            return;
        }
        // Python 2 had no bytes of their own: they are made of text, one character each.
        let text: String = bytes.iter().copied().map(char::from).collect();
        self.call("_codecs", "encode", |args| {
            args.str(&text);
            args.str("latin1");
        });
    }

    /// A `bytearray`.
    pub fn byte_array(&mut self, bytes: &[u8]) {
        if self.protocol >= Protocol::V5 {
            self.op(op::BYTEARRAY8);
            self.raw(&(bytes.len() as u64).to_le_bytes());
            self.raw(bytes);
        } else {
            self.call("builtins", "bytearray", |args| args.bytes(bytes));
        }
    }

    /// A buffer that may be written to: beside the pickle in protocol 5, a `bytearray` before.
    pub fn buffer(&mut self, content: Bytes) {
        if self.protocol >= Protocol::V5 {
            self.op(op::NEXT_BUFFER);
            self.buffers.push(content);
        } else {
            self.byte_array(&content);
        }
    }

    /// Bytes behind their length. A short length takes one byte where `short` and `long` differ.
    fn counted(&mut self, short: u8, long: u8, huge: Option<u8>, bytes: &[u8]) {
        match (u8::try_from(bytes.len()), u32::try_from(bytes.len()), huge) {
            (Ok(length), _, _) if short != long => self.raw(&[short, length]),
            (_, Ok(length), _) => {
                self.op(long);
                self.raw(&length.to_le_bytes());
            }
            (_, _, Some(huge)) => {
                self.op(huge);
                self.raw(&(bytes.len() as u64).to_le_bytes());
            }
            _ => {
                let what = format!("text or an integer of {} bytes", bytes.len());
                return self.fail(what, "protocol 4 or later can hold the text");
            }
        }
        self.raw(bytes);
    }

    /// A `list` of what `items` writes.
    pub fn list(&mut self, items: impl FnOnce(&mut Self)) {
        self.op(op::EMPTY_LIST);
        self.append(items);
    }

    /// A `tuple` of what `items` writes.
    pub fn tuple(&mut self, items: impl FnOnce(&mut Self)) {
        self.op(op::MARK);
        items(self);
        self.op(op::TUPLE);
    }

    /// A `dict` of what `pairs` writes: key, value, key, value.
    pub fn dict(&mut self, pairs: impl FnOnce(&mut Self)) {
        self.op(op::EMPTY_DICT);
        self.set_items(pairs);
    }

    /// A `set` of what `members` writes.
    pub fn set(&mut self, members: impl FnOnce(&mut Self)) {
        if self.protocol >= Protocol::V4 {
            self.raw(&[op::EMPTY_SET, op::MARK]);
            members(self);
            self.op(op::ADDITEMS);
        } else {
            self.call("__builtin__", "set", |args| args.list(members));
        }
    }

    /// A `frozenset` of what `members` writes.
    pub fn frozen_set(&mut self, members: impl FnOnce(&mut Self)) {
        if self.protocol >= Protocol::V4 {
            self.op(op::MARK);
            members(self);
            self.op(op::FROZENSET);
        } else {
            self.call("__builtin__", "frozenset", |args| args.list(members));
        }
    }

    /// The name of a function or class.
    pub fn global(&mut self, module: &'static str, name: &'static str) {
        if self.protocol >= Protocol::V4 {
            self.str(module);
            self.str(name);
            self.op(op::STACK_GLOBAL);
        } else {
            self.op(op::GLOBAL);
            for text in [module, name] {
                self.raw(text.as_bytes());
                self.op(b'\n');
            }
        }
    }

    /// Writes a call of the function or class with the arguments that `args` writes.
    pub fn call(&mut self, module: &'static str, name: &'static str, args: impl FnOnce(&mut Self)) {
        self.global(module, name);
        self.tuple(args);
        self.op(op::REDUCE);
    }

    /// An instance of a class, made without its `__init__`.
    pub fn instance(
        &mut self,
        module: &'static str,
        name: &'static str,
        args: impl FnOnce(&mut Self),
    ) {
        self.global(module, name);
        self.tuple(args);
        self.op(op::NEWOBJ);
    }

    /// Gives the object that was just written the state that `state` writes.
    pub fn state(&mut self, state: impl FnOnce(&mut Self)) {
        state(self);
        self.op(op::BUILD);
    }

    /// Appends what `items` writes to the object that was just written.
    pub fn append(&mut self, items: impl FnOnce(&mut Self)) {
        self.op(op::MARK);
        items(self);
        self.op(op::APPENDS);
    }

    /// Sets the pairs that `pairs` writes in the object that was just written.
    pub fn set_items(&mut self, pairs: impl FnOnce(&mut Self)) {
        self.op(op::MARK);
        pairs(self);
        self.op(op::SETITEMS);
    }

    /// Writes a reference to an object beside the pickle, by the id that `id` writes.
    pub fn persistent(&mut self, id: impl FnOnce(&mut Self)) {
        id(self);
        self.op(op::BINPERSID);
    }
}
