//! Writer of pickles that Python loads, part by part, as the machine that reads them works: the parts lie
//! on its stack, and one instruction makes a value of them. Objects that call constructors on objects keep
//! the order of their parts so.
//!
//! ```text
//!   to.global("pandas", "RangeIndex").mark().int(0).int(3).int(1).tuple_since_mark().reduce()
//! ```

use bytes::Bytes;
use num_bigint::BigInt;

use super::opcode as op;
use wrapyfi_data::types::Dtype;

/// Protocol of Python 3.8, which Wrapyfi writes: buffers may travel beside the pickle.
const PROTOCOL: u8 = 5;

/// Protocol since which text has a short form and names are looked up by text.
const SHORT_TEXT: u8 = 4;

/// Code of `bfloat16`, which is a class beside NumPy.
const BFLOAT16: &str = "bfloat16";

/// A pickle in the making.
#[derive(Debug)]
pub(crate) struct Writer {
    protocol: u8,
    out: Vec<u8>,
    buffers: Vec<Bytes>,
    /// Number of objects in the memo.
    memo: u32,
}

#[cfg_attr(not(feature = "tables"), allow(dead_code, reason = "tensors need some of it"))]
impl Writer {
    /// An empty pickle of protocol 5.
    pub(crate) fn new() -> Self {
        Self::of_protocol(PROTOCOL)
    }

    /// An empty pickle for those who read no newer protocol. Bytes have a form since 3, buffers since 5.
    pub(crate) fn of_protocol(protocol: u8) -> Self {
        Self { protocol, out: vec![op::PROTO, protocol], buffers: Vec::new(), memo: 0 }
    }

    /// Ends the pickle after the one object that was written; returns it and the buffers beside it.
    pub(crate) fn finish(mut self) -> (Vec<u8>, Vec<Bytes>) {
        self.op(op::STOP);
        (self.out, self.buffers)
    }

    fn op(&mut self, code: u8) -> &mut Self {
        self.out.push(code);
        self
    }

    fn raw(&mut self, bytes: &[u8]) -> &mut Self {
        self.out.extend_from_slice(bytes);
        self
    }

    /// Bytes behind their length, which takes one byte, four, or eight.
    fn counted(&mut self, [short, long, huge]: [u8; 3], bytes: &[u8]) -> &mut Self {
        match (u8::try_from(bytes.len()), u32::try_from(bytes.len())) {
            (Ok(length), _) => self.raw(&[short, length]),
            (_, Ok(length)) => self.op(long).raw(&length.to_le_bytes()),
            _ => self.op(huge).raw(&(bytes.len() as u64).to_le_bytes()),
        };
        self.raw(bytes)
    }

    pub(crate) fn none(&mut self) -> &mut Self {
        self.op(op::NONE)
    }

    pub(crate) fn bool(&mut self, value: bool) -> &mut Self {
        self.op(if value { op::NEWTRUE } else { op::NEWFALSE })
    }

    pub(crate) fn int(&mut self, value: i64) -> &mut Self {
        if let Ok(value) = u8::try_from(value) {
            self.raw(&[op::BININT1, value])
        } else if let Ok(value) = i32::try_from(value) {
            self.op(op::BININT).raw(&value.to_le_bytes())
        } else {
            self.raw(&[op::LONG1, 8]).raw(&value.to_le_bytes())
        }
    }

    /// Writes a size or an index.
    pub(crate) fn size(&mut self, value: usize) -> &mut Self {
        self.int(i64::try_from(value).unwrap_or(i64::MAX))
    }

    /// Writes an integer of any size; one of four GiB, which has no form, is beyond every limit.
    pub(crate) fn big_int(&mut self, value: &BigInt) -> &mut Self {
        self.counted([op::LONG1, op::LONG4, op::LONG4], &value.to_signed_bytes_le())
    }

    pub(crate) fn float(&mut self, value: f64) -> &mut Self {
        self.op(op::BINFLOAT).raw(&value.to_be_bytes())
    }

    pub(crate) fn str(&mut self, text: &str) -> &mut Self {
        if self.protocol < SHORT_TEXT {
            let length = u32::try_from(text.len()).unwrap_or(u32::MAX);
            return self.op(op::BINUNICODE).raw(&length.to_le_bytes()).raw(text.as_bytes());
        }
        self.counted([op::SHORT_BINUNICODE, op::BINUNICODE, op::BINUNICODE8], text.as_bytes())
    }

    pub(crate) fn bytes(&mut self, bytes: &[u8]) -> &mut Self {
        self.counted([op::SHORT_BINBYTES, op::BINBYTES, op::BINBYTES8], bytes)
    }

    /// Adds a buffer beside the pickle.
    pub(crate) fn buffer(&mut self, content: Bytes) -> &mut Self {
        self.buffers.push(content);
        self.op(op::NEXT_BUFFER)
    }

    /// Writes a function or class by name.
    pub(crate) fn global(&mut self, module: &str, name: &str) -> &mut Self {
        if self.protocol < SHORT_TEXT {
            return self.op(op::GLOBAL).raw(format!("{module}\n{name}\n").as_bytes());
        }
        self.str(module).str(name).op(op::STACK_GLOBAL)
    }

    /// Marks the begin of a tuple, list or dict.
    pub(crate) fn mark(&mut self) -> &mut Self {
        self.op(op::MARK)
    }

    pub(crate) fn tuple_since_mark(&mut self) -> &mut Self {
        self.op(op::TUPLE)
    }

    pub(crate) fn list_since_mark(&mut self) -> &mut Self {
        self.op(op::LIST)
    }

    /// A list of what `write` makes of each of `items`.
    pub(crate) fn list<T, E>(
        &mut self,
        items: impl IntoIterator<Item = T>,
        mut write: impl FnMut(&mut Self, T) -> Result<(), E>,
    ) -> Result<&mut Self, E> {
        self.mark();
        items.into_iter().try_for_each(|item| write(self, item))?;
        Ok(self.list_since_mark())
    }

    /// Makes a dict of key, value, key, value, … since the mark.
    pub(crate) fn dict_since_mark(&mut self) -> &mut Self {
        self.op(op::DICT)
    }

    /// Makes a `tuple` of the last `count` parts, 1 to 3.
    pub(crate) fn tuple(&mut self, count: u8) -> &mut Self {
        self.op(op::TUPLE1 - 1 + count.clamp(1, 3))
    }

    /// Applies the function below the tuple on top to that tuple.
    pub(crate) fn reduce(&mut self) -> &mut Self {
        self.op(op::REDUCE)
    }

    /// Drops the part on top.
    pub(crate) fn pop(&mut self) -> &mut Self {
        self.op(op::POP)
    }

    /// Puts the part on top into the memo, where it stays; [`Self::recall`] pushes it again.
    pub(crate) fn remember(&mut self) -> u32 {
        let number = self.memo;
        self.memo += 1;
        self.op(op::MEMOIZE);
        number
    }

    /// Pushes the object with this number in the memo.
    pub(crate) fn recall(&mut self, number: u32) -> &mut Self {
        self.op(op::LONG_BINGET).raw(&number.to_le_bytes())
    }

    /// Writes a `numpy.ndarray` over a buffer beside the pickle. `descr` is NumPy's: `<f8`,
    /// `<M8[ns]`. Names of modules are those of NumPy 1, which NumPy 2 still knows.
    pub(crate) fn array(&mut self, descr: &str, length: usize, data: Bytes) -> &mut Self {
        self.global("numpy.core.numeric", "_frombuffer").mark().buffer(data).dtype(descr);
        self.mark().size(length).tuple_since_mark().str("C").tuple_since_mark().reduce()
    }

    /// Writes a `numpy.ndarray` of the `count` objects that `items` writes.
    pub(crate) fn objects(&mut self, count: usize, items: impl FnOnce(&mut Self)) -> &mut Self {
        self.empty_array().reduce().begin_state(&[count], "|O8").mark();
        items(self);
        self.list_since_mark().tuple_since_mark().build()
    }

    /// Writes the function and the arguments that make an empty `numpy.ndarray`.
    pub(crate) fn empty_array(&mut self) -> &mut Self {
        self.global("numpy.core.multiarray", "_reconstruct").mark().global("numpy", "ndarray");
        self.mark().int(0).tuple_since_mark().bytes(b"b").tuple_since_mark()
    }

    /// Writes the state that fills an empty array with these elements, in the order of their indices.
    pub(crate) fn array_state(
        &mut self,
        dtype: Dtype,
        shape: &[usize],
        elements: &[u8],
    ) -> &mut Self {
        let bfloat16 = format!("<{BFLOAT16}");
        let descr = dtype.npy_descr().unwrap_or(&bfloat16);
        self.begin_state(shape, descr).bytes(elements).tuple_since_mark()
    }

    /// Writes the version, shape, element type and order of the state of an array.
    fn begin_state(&mut self, shape: &[usize], descr: &str) -> &mut Self {
        self.mark().int(1).sizes(shape).dtype(descr).bool(false)
    }

    /// Writes a tuple of sizes.
    pub(crate) fn sizes(&mut self, sizes: &[usize]) -> &mut Self {
        self.mark();
        for size in sizes {
            self.size(*size);
        }
        self.tuple_since_mark()
    }

    /// Gives the object below the part on top that part as its state.
    pub(crate) fn build(&mut self) -> &mut Self {
        self.op(op::BUILD)
    }

    /// Makes what the persistent id on top stands for.
    #[cfg(feature = "torch")]
    pub(crate) fn persistent(&mut self) -> &mut Self {
        self.op(op::BINPERSID)
    }

    /// Writes a `numpy.dtype` by order, code, and unit of a time.
    fn dtype(&mut self, descr: &str) -> &mut Self {
        let (order, code) = descr.split_at_checked(1).unwrap_or_default();
        let (code, unit) = code
            .split_once('[')
            .map_or((code, None), |(code, unit)| (code, unit.strip_suffix(']')));
        self.global("numpy", "dtype").mark();
        match code {
            BFLOAT16 => self.global("ml_dtypes", BFLOAT16),
            code => self.str(code),
        };
        self.bool(false).bool(true).tuple_since_mark().reduce();
        self.mark().int(if unit.is_some() { 4 } else { 3 }).str(order).none().none().none();
        // Size, alignment and flags. What NumPy itself writes: the first two are left to the code.
        match code {
            BFLOAT16 => self.int(2).int(2).int(0x40),
            "O8" => self.int(-1).int(-1).int(63),
            _ => self.int(-1).int(-1).int(0),
        };
        if let Some(unit) = unit {
            self.mark().op(op::EMPTY_DICT).mark().bytes(unit.as_bytes()).int(1).int(1).int(1);
            self.tuple_since_mark().tuple_since_mark();
        }
        self.tuple_since_mark().build()
    }
}
