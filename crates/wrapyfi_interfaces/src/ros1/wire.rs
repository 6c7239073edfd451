//! The two forms of a message, as they are read and written.
//!
//! ```text
//!   ROS 1   fields one behind the other, little-endian         no padding, no terminators
//!   CDR     00 01 00 00, then each field at a multiple of its size
//! ```

/// Fewer bytes than needed.
#[derive(Debug, Clone, Copy)]
pub(super) struct Short {
    pub(super) needed: usize,
    pub(super) available: usize,
}

/// Bytes to read. `CDR`: fields are aligned.
#[derive(Debug)]
pub(super) struct Source<'a, const CDR: bool> {
    body: &'a [u8],
    pub(super) at: usize,
}

impl<'a, const CDR: bool> Source<'a, CDR> {
    /// Starts at the first byte of `body`, which positions are counted from.
    pub(super) fn new(body: &'a [u8]) -> Self {
        Self { body, at: 0 }
    }

    pub(super) fn remaining(&self) -> usize {
        self.body.len().saturating_sub(self.at)
    }

    /// Skips to a multiple of `size`, a power of two. May end behind the last byte: whatever is
    /// taken next says so.
    #[inline]
    pub(super) fn align(&mut self, size: usize) {
        if CDR {
            self.at = self.at.next_multiple_of(size.max(1));
        }
    }

    #[inline]
    pub(super) fn take(&mut self, size: usize) -> Result<&'a [u8], Short> {
        let end = self.at.saturating_add(size);
        match self.body.get(self.at..end) {
            Some(bytes) => {
                self.at = end;
                Ok(bytes)
            }
            None => Err(Short { needed: size, available: self.remaining() }),
        }
    }

    /// A length or a number of elements.
    #[inline]
    pub(super) fn count(&mut self) -> Result<u32, Short> {
        self.align(4);
        let bytes = self.take(4)?;
        Ok(bytes.first_chunk().map_or(0, |bytes| u32::from_le_bytes(*bytes)))
    }
}

/// Bytes that are written, at the end of the caller's buffer.
#[derive(Debug)]
pub(super) struct Target<'o, const CDR: bool> {
    out: &'o mut Vec<u8>,
    /// Offset of the first field, from which alignment is counted.
    start: usize,
}

impl<'o, const CDR: bool> Target<'o, CDR> {
    /// Starts behind what is in `out`.
    pub(super) fn new(out: &'o mut Vec<u8>) -> Self {
        let start = out.len();
        Self { out, start }
    }

    /// Bytes written.
    pub(super) fn len(&self) -> usize {
        self.out.len().saturating_sub(self.start)
    }

    /// Pads with zeros to a multiple of `size`, a power of two.
    #[inline]
    pub(super) fn align(&mut self, size: usize) {
        if CDR {
            let padding = self.len().wrapping_neg() & size.saturating_sub(1);
            if padding != 0 {
                self.out.resize(self.out.len() + padding, 0);
            }
        }
    }

    #[inline]
    pub(super) fn put(&mut self, bytes: &[u8]) {
        self.out.extend_from_slice(bytes);
    }

    pub(super) fn zeros(&mut self, size: usize) {
        self.out.resize(self.out.len() + size, 0);
    }

    #[inline]
    pub(super) fn count(&mut self, count: u32) {
        self.align(4);
        self.put(&count.to_le_bytes());
    }

    /// The last `size` bytes written.
    pub(super) fn last_mut(&mut self, size: usize) -> &mut [u8] {
        let from = self.out.len().saturating_sub(size);
        self.out.get_mut(from..).unwrap_or_default()
    }
}
