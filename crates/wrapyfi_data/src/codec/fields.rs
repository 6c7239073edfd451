//! Numbers in a file whose place is known, for headers that are checked before they are believed.

/// Bytes of a file, and the order of the bytes in its numbers.
pub(super) struct Fields<'a> {
    pub(super) file: &'a [u8],
    pub(super) little_endian: bool,
}

impl Fields<'_> {
    fn array<const N: usize>(&self, at: usize) -> Result<[u8; N], String> {
        let bytes = self.file.get(at..).and_then(<[u8]>::first_chunk::<N>);
        bytes.copied().ok_or_else(|| format!("it ends before byte {}", at.saturating_add(N)))
    }

    pub(super) fn u16(&self, at: usize) -> Result<u16, String> {
        let bytes = self.array(at)?;
        Ok(if self.little_endian { u16::from_le_bytes(bytes) } else { u16::from_be_bytes(bytes) })
    }

    pub(super) fn u32(&self, at: usize) -> Result<u32, String> {
        let bytes = self.array(at)?;
        Ok(if self.little_endian { u32::from_le_bytes(bytes) } else { u32::from_be_bytes(bytes) })
    }
}
