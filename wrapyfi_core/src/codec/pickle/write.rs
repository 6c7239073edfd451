//! Pickles written: protocol 5, which every Python since 3.8 reads.
//!
//! ```text
//!   writer.global("pandas", "RangeIndex").int(0).int(3).int(1).tuple(3).reduce()
//!       ▼
//!   80 05 … 93 4b 00 4b 03 4b 01 87 52 … 2e        buffers ──▶ beside it, out of band
//! ```
//!
//! A value is written after its parts, as the machine that reads it works: the parts lie on its
//! stack, and one instruction makes the value of them.

use bytes::Bytes;
use num_bigint::BigInt;

use crate::types::{Dtype, Tensor};

/// Writes one pickle. Methods that take parts from the stack say how many.
#[derive(Debug)]
pub struct Writer {
    out: Vec<u8>,
    buffers: Vec<Bytes>,
    memo: u32,
}

impl Default for Writer {
    fn default() -> Self {
        Self::new()
    }
}

impl Writer {
    /// An empty pickle.
    #[must_use]
    pub fn new() -> Self {
        Self { out: vec![0x80, 5], buffers: Vec::new(), memo: 0 }
    }

    /// The pickle, whose value is what lies on the stack, and the buffers beside it.
    #[must_use]
    pub fn finish(mut self) -> (Vec<u8>, Vec<Bytes>) {
        self.out.push(b'.');
        (self.out, self.buffers)
    }

    fn op(&mut self, opcode: u8) -> &mut Self {
        self.out.push(opcode);
        self
    }

    fn sized(&mut self, opcodes: [u8; 2], content: &[u8]) -> &mut Self {
        let [short, long] = opcodes;
        if let Ok(length) = u8::try_from(content.len()) {
            self.out.extend([short, length]);
        } else {
            self.out.push(long);
            self.out.extend((content.len() as u64).to_le_bytes());
        }
        self.out.extend_from_slice(content);
        self
    }

    /// `None`.
    pub fn none(&mut self) -> &mut Self {
        self.op(b'N')
    }

    /// `True` or `False`.
    pub fn bool(&mut self, value: bool) -> &mut Self {
        self.op(if value { 0x88 } else { 0x89 })
    }

    /// An `int`.
    pub fn int(&mut self, value: i64) -> &mut Self {
        if let Ok(value) = u8::try_from(value) {
            self.out.extend([b'K', value]);
        } else if let Ok(value) = i32::try_from(value) {
            self.out.push(b'J');
            self.out.extend(value.to_le_bytes());
        } else {
            self.out.extend([0x8A, 8]);
            self.out.extend(value.to_le_bytes());
        }
        self
    }

    /// An `int` of any size.
    pub fn big_int(&mut self, value: &BigInt) -> &mut Self {
        let bytes = value.to_signed_bytes_le();
        self.out.push(0x8B);
        // Beyond four gigabytes nothing is written: no message is so long.
        self.out.extend(u32::try_from(bytes.len()).unwrap_or_default().to_le_bytes());
        self.out.extend(bytes);
        self
    }

    /// A `float`.
    pub fn float(&mut self, value: f64) -> &mut Self {
        self.out.push(b'G');
        self.out.extend(value.to_be_bytes());
        self
    }

    /// A `str`.
    pub fn str(&mut self, text: &str) -> &mut Self {
        self.sized([0x8C, 0x8D], text.as_bytes())
    }

    /// `bytes` inside the pickle.
    pub fn bytes(&mut self, bytes: &[u8]) -> &mut Self {
        self.sized([b'C', 0x8E], bytes)
    }

    /// A buffer beside the pickle.
    pub fn buffer(&mut self, content: Bytes) -> &mut Self {
        self.buffers.push(content);
        self.op(0x97)
    }

    /// Where a tuple, list or dict of any length begins.
    pub fn mark(&mut self) -> &mut Self {
        self.op(b'(')
    }

    /// A `tuple` of all since the mark.
    pub fn tuple_since_mark(&mut self) -> &mut Self {
        self.op(b't')
    }

    /// A `tuple` of the last `count` parts, 0 to 3.
    pub fn tuple(&mut self, count: u8) -> &mut Self {
        match count {
            0 => self.op(b')'),
            count => self.op(0x84 + count.min(3)),
        }
    }

    /// A `list` of all since the mark.
    pub fn list_since_mark(&mut self) -> &mut Self {
        self.op(b'l')
    }

    /// A `dict` of all since the mark: key, value, key, value, …
    pub fn dict_since_mark(&mut self) -> &mut Self {
        self.op(b'd')
    }

    /// A function or class by name.
    pub fn global(&mut self, module: &str, name: &str) -> &mut Self {
        self.str(module).str(name).op(0x93)
    }

    /// Applies the function below the tuple on top to that tuple.
    pub fn reduce(&mut self) -> &mut Self {
        self.op(b'R')
    }

    /// Hands the part on top to the `__setstate__` of the object below it.
    pub fn build(&mut self) -> &mut Self {
        self.op(b'b')
    }

    /// Drops the part on top.
    pub fn pop(&mut self) -> &mut Self {
        self.op(b'0')
    }

    /// Remembers the part on top, which stays there; [`Self::recall`] puts it there again.
    pub fn remember(&mut self) -> u32 {
        let number = self.memo;
        self.memo += 1;
        self.op(0x94);
        number
    }

    /// The part that was remembered, the same object.
    pub fn recall(&mut self, number: u32) -> &mut Self {
        self.out.push(b'j');
        self.out.extend(number.to_le_bytes());
        self
    }

    /// A `numpy.ndarray` over a buffer beside the pickle. `descr` as NumPy spells it: `<f8`,
    /// `<M8[ns]`; `shape` in elements.
    pub fn array(&mut self, descr: &str, shape: &[usize], data: Bytes) -> &mut Self {
        self.global("numpy.core.numeric", "_frombuffer").mark().buffer(data);
        self.dtype(descr).shape(shape).str("C").tuple_since_mark().reduce()
    }

    /// A tensor as a `numpy.ndarray`; `bfloat16`, which NumPy lacks, is written by its bits.
    pub fn tensor(&mut self, tensor: &Tensor) -> &mut Self {
        let descr = tensor.dtype.npy_descr().unwrap_or(match tensor.dtype {
            Dtype::BF16 => "<u2",
            _ => "|V1",
        });
        self.array(descr, &tensor.shape, tensor.data.clone())
    }

    /// A one-dimensional `numpy.ndarray` of the objects that `items` writes, one each.
    pub fn objects(&mut self, count: usize, items: impl FnOnce(&mut Self)) -> &mut Self {
        self.global("numpy.core.multiarray", "_reconstruct").global("numpy", "ndarray");
        self.int(0).tuple(1).bytes(b"b").tuple(3).reduce();
        self.mark().int(1).shape(&[count]).dtype("|O8").bool(false).mark();
        items(self);
        self.list_since_mark().tuple_since_mark().build()
    }

    /// A `numpy.dtype`, by its code as NumPy spells it: `<f8`, `|b1`, `<M8[ns]`, `|O8`.
    pub fn dtype(&mut self, descr: &str) -> &mut Self {
        let (order, code) = descr.split_at_checked(1).unwrap_or(("|", descr));
        let (code, unit) = match code.split_once('[') {
            Some((code, unit)) => (code, Some(unit.trim_end_matches(']'))),
            None => (code, None),
        };
        self.global("numpy", "dtype").str(code).bool(false).bool(true).tuple(3).reduce();
        self.mark().int(if unit.is_some() { 4 } else { 3 }).str(order).none().none().none();
        self.int(-1).int(-1).int(if code == "O8" { 63 } else { 0 });
        if let Some(unit) = unit {
            self.mark().dict_since_mark().mark().bytes(unit.as_bytes()).int(1).int(1).int(1);
            self.tuple_since_mark().tuple(2);
        }
        self.tuple_since_mark().build()
    }

    fn shape(&mut self, shape: &[usize]) -> &mut Self {
        self.mark();
        for &extent in shape {
            self.int(i64::try_from(extent).unwrap_or(i64::MAX));
        }
        self.tuple_since_mark()
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Allowed, PickledArray, read};
    use super::*;
    use crate::Limits;

    #[test]
    fn what_is_written_is_read() {
        let mut writer = Writer::new();
        let tensor = Tensor::from_elements(&[2, 2], vec![1.5_f32, -1.0, 0.0, 7.0]).unwrap();
        writer.mark();
        for value in [0, 255, 256, -1, i64::MIN, i64::MAX] {
            writer.int(value);
        }
        writer.list_since_mark();
        let list = writer.remember();
        writer.float(-0.5).bool(true).none().str(&"ä".repeat(200)).bytes(b"raw");
        writer.big_int(&(BigInt::from(1) << 100)).tensor(&tensor).recall(list);
        writer.objects(2, |to| {
            to.str("a").none();
        });
        // All of it lies on the stack; the tuple takes it.
        let (mut pickle, buffers) = writer.finish();
        pickle.insert(2, b'(');
        pickle.insert(pickle.len() - 1, b't');
        let read = read(&pickle.into(), &buffers, &Allowed::NUMPY, &Limits::default()).unwrap();
        let parts = read.root().tuple().unwrap();
        let ints: Vec<i64> =
            parts.get(0).unwrap().list().unwrap().iter().map(|i| i.int().unwrap()).collect();
        assert_eq!(ints, [0, 255, 256, -1, i64::MIN, i64::MAX]);
        assert_eq!(parts.get(1).unwrap().float(), Ok(-0.5));
        assert_eq!(parts.get(4).unwrap().str(), Ok(&*"ä".repeat(200)));
        assert_eq!(parts.get(5).unwrap().bytes().unwrap(), "raw");
        match parts.get(7).unwrap().array().unwrap() {
            PickledArray::Tensor(read) => assert_eq!(read, tensor),
            other => panic!("{other:?}"),
        }
        assert_eq!(parts.get(8).unwrap().id(), parts.get(0).unwrap().id(), "the same object");
        match parts.get(9).unwrap().array().unwrap() {
            PickledArray::Objects { shape, items } => {
                assert_eq!(shape, [2]);
                assert_eq!(items.get(0).unwrap().str(), Ok("a"));
            }
            other => panic!("{other:?}"),
        }
    }
}
