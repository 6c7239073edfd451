//! Writes archives as torch reads them: stored, content at multiples of 64.

use std::io::{Cursor, Write as _};

use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

/// Contents begin at a multiple of this, so that a reader may use them in place.
const ALIGN: u16 = 64;

/// An archive in the making.
pub(crate) struct Writer {
    zip: ZipWriter<Cursor<Vec<u8>>>,
    /// Bytes of all contents.
    bytes: usize,
}

impl Writer {
    /// An empty archive with room for `capacity` bytes.
    pub(crate) fn with_capacity(capacity: usize) -> Self {
        Self { zip: ZipWriter::new(Cursor::new(Vec::with_capacity(capacity))), bytes: 0 }
    }

    /// Appends a member. `None` when the contents exceed 2 GiB, which some readers stop at.
    pub(crate) fn add(&mut self, name: &str, content: &[u8]) -> Option<()> {
        self.bytes = self.bytes.checked_add(content.len())?;
        i32::try_from(self.bytes).ok()?;
        let stored = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
        self.zip.start_file(name, stored.with_alignment(ALIGN)).ok()?;
        self.zip.write_all(content).ok()
    }

    /// The archive's bytes; `None` where it cannot be an archive.
    pub(crate) fn finish(self) -> Option<Vec<u8>> {
        Some(self.zip.finish().ok()?.into_inner())
    }
}

#[cfg(test)]
mod tests {
    use std::io::Read as _;

    use super::*;
    use crate::archive::Archive;

    #[test]
    fn other_readers_and_our_own_read_it() {
        let members = [
            ("archive/data.pkl", &b"\x80\x02."[..]),
            ("archive/data/0", &[7; 1000]),
            ("archive/version", b"3\n"),
        ];
        let mut writer = Writer::with_capacity(0);
        for (name, content) in members {
            writer.add(name, content).unwrap();
        }
        let file = bytes::Bytes::from(writer.finish().unwrap());
        let archive = Archive::open(&file).unwrap();
        let mut zip = zip::ZipArchive::new(std::io::Cursor::new(&file)).unwrap();
        for (index, (name, content)) in members.into_iter().enumerate() {
            let ours = archive.stored(archive.member(name).unwrap()).unwrap().unwrap();
            assert_eq!(ours, content);
            assert_eq!(
                (ours.as_ptr() as usize - file.as_ptr() as usize) % usize::from(ALIGN),
                0,
                "{name}"
            );
            let mut theirs = Vec::new();
            let mut member = zip.by_index(index).unwrap();
            assert_eq!(member.name().unwrap(), name);
            member.read_to_end(&mut theirs).unwrap();
            assert_eq!(theirs, content);
        }
    }
}
