//! Numbers in a file whose place is known, for headers that are checked before they are believed.

/// Bytes of a file in which numbers have known places, and the order of the bytes in its numbers.
#[derive(Debug, Clone, Copy)]
pub struct Fields<'a> {
    /// Bytes of the file.
    pub file: &'a [u8],
    /// True where the lowest byte of a number comes first.
    pub little_endian: bool,
}

impl Fields<'_> {
    fn array<const N: usize>(&self, at: usize) -> Result<[u8; N], String> {
        let bytes = self.file.get(at..).and_then(<[u8]>::first_chunk::<N>);
        bytes.copied().ok_or_else(|| format!("it ends before byte {}", at.saturating_add(N)))
    }

    /// Reads the number of two bytes at `at`.
    ///
    /// # Errors
    /// When the file ends before its end; so for all that follow.
    pub fn u16(&self, at: usize) -> Result<u16, String> {
        let bytes = self.array(at)?;
        Ok(if self.little_endian { u16::from_le_bytes(bytes) } else { u16::from_be_bytes(bytes) })
    }

    /// Reads the number of four bytes at `at`.
    ///
    /// # Errors
    /// As [`Self::u16`].
    pub fn u32(&self, at: usize) -> Result<u32, String> {
        let bytes = self.array(at)?;
        Ok(if self.little_endian { u32::from_le_bytes(bytes) } else { u32::from_be_bytes(bytes) })
    }
}
