//! Writer of tensors' pickles: opcodes and their arguments, as Python's `pickletools` lists them.

use crate::types::Dtype;

/// A pickle in the making. It has no memo, because no object occurs twice in these pickles.
pub(super) struct PickleText(Vec<u8>);

impl PickleText {
    /// A pickle of this protocol, with room for `content` bytes beside a small frame.
    pub(super) fn with_room(protocol: u8, content: usize) -> Self {
        let mut out = Vec::with_capacity(content.saturating_add(512));
        out.extend([0x80, protocol]);
        Self(out)
    }

    /// Ends the pickle and returns its bytes.
    pub(super) fn finish(mut self) -> Vec<u8> {
        self.raw(b".");
        self.0
    }

    pub(super) fn raw(&mut self, opcodes: &[u8]) {
        self.0.extend_from_slice(opcodes);
    }

    /// Writes a function or class.
    pub(super) fn global(&mut self, module: &str, name: &str) {
        for part in ["c", module, "\n", name, "\n"] {
            self.raw(part.as_bytes());
        }
    }

    /// Writes text; `None` beyond 4 GiB.
    pub(super) fn text(&mut self, text: &str) -> Option<()> {
        self.raw(b"X");
        self.raw(&u32::try_from(text.len()).ok()?.to_le_bytes());
        self.raw(text.as_bytes());
        Some(())
    }

    /// Writes bytes, since protocol 3; `None` beyond 4 GiB.
    pub(super) fn bytes(&mut self, bytes: &[u8]) -> Option<()> {
        self.raw(b"B");
        self.raw(&u32::try_from(bytes.len()).ok()?.to_le_bytes());
        self.raw(bytes);
        Some(())
    }

    /// Writes an integer; `None` beyond 63 bits.
    pub(super) fn int(&mut self, value: usize) -> Option<()> {
        if let Ok(byte) = u8::try_from(value) {
            self.raw(&[b'K', byte]);
        } else if let Ok(int) = i32::try_from(value) {
            self.raw(b"J");
            self.raw(&int.to_le_bytes());
        } else {
            // Eight bytes with sign.
            self.raw(b"\x8a\x08");
            self.raw(&i64::try_from(value).ok()?.to_le_bytes());
        }
        Some(())
    }

    pub(super) fn bool(&mut self, value: bool) {
        self.raw(if value { b"\x88" } else { b"\x89" });
    }

    /// Writes a tuple of integers.
    pub(super) fn tuple(&mut self, items: impl Iterator<Item = usize>) -> Option<()> {
        self.raw(b"(");
        for item in items {
            self.int(item)?;
        }
        self.raw(b"t");
        Some(())
    }

    /// Writes `numpy.core.multiarray._reconstruct` and the arguments `(numpy.ndarray, (0,), b'b')`,
    /// which make an empty array.
    pub(super) fn numpy_reconstruct(&mut self) {
        self.global("numpy.core.multiarray", "_reconstruct");
        self.global("numpy", "ndarray");
        self.raw(b"K\0\x85C\x01b\x87");
    }

    /// Writes the state that fills that array: version, shape, element type, order, elements.
    pub(super) fn numpy_state(&mut self, dtype: Dtype, shape: &[usize], data: &[u8]) -> Option<()> {
        self.raw(b"(K\x01");
        self.tuple(shape.iter().copied())?;
        self.global("numpy", "dtype");
        let named = dtype.npy_descr();
        match named {
            Some(descr) => self.text(descr.get(1..)?)?,
            None => self.global("ml_dtypes", "bfloat16"),
        }
        self.raw(b"\x89\x88\x87R(K\x03");
        self.text(if dtype.size() == 1 { "|" } else { "<" })?;
        // No fields, then size, alignment and flags: -1, -1, 0 of NumPy's own types, stated of others.
        self.raw(b"NNN");
        self.raw(match named {
            Some(_) => b"J\xff\xff\xff\xffJ\xff\xff\xff\xffK\0",
            None => b"K\x02K\x02K\x40",
        });
        self.raw(b"tb\x89");
        self.bytes(data)?;
        self.raw(b"t");
        Some(())
    }
}
