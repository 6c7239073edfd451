//! Writes archives as `torch.save` does: stored, content at multiples of 64.

use flate2::Crc;

use super::{DIRECTORY, END, LOCAL, LOCAL_LENGTH};

/// Contents begin at a multiple of this, so that a reader may use them in place.
const ALIGN: usize = 64;
/// Header of the extra field that fills up to there, as torch calls it.
const PADDING: &[u8; 2] = b"FB";
/// Version of the format that a reader needs.
const VERSION: u16 = 0;
/// Names are UTF-8.
const FLAGS: u16 = 1 << 11;

/// An archive in the making.
#[derive(Debug, Default)]
pub(crate) struct Writer {
    file: Vec<u8>,
    directory: Vec<u8>,
    members: u16,
}

impl Writer {
    /// An empty archive with room for `capacity` bytes.
    #[cfg(feature = "torch")]
    pub(crate) fn with_capacity(capacity: usize) -> Self {
        Self { file: Vec::with_capacity(capacity), ..Self::default() }
    }

    /// Appends a member. `None` when the archive exceeds 2 GiB, which some readers stop at.
    pub(crate) fn add(&mut self, name: &str, content: &[u8]) -> Option<()> {
        let mut crc = Crc::new();
        crc.update(content);
        let at = u32::try_from(self.file.len()).ok()?;
        let size = i32::try_from(content.len()).ok()?.unsigned_abs();
        i32::try_from(self.file.len().checked_add(content.len())?).ok()?;
        let name_length = u16::try_from(name.len()).ok()?;
        let before = self.file.len() + LOCAL_LENGTH + name.len() + 4;
        let padding = u16::try_from(before.next_multiple_of(ALIGN) - before).ok()?;

        // Version, flags, stored, no time and date, checksum, length twice.
        let mut common = Vec::with_capacity(24);
        for field in [VERSION, FLAGS, 0, 0, 0] {
            common.extend(field.to_le_bytes());
        }
        for field in [crc.sum(), size, size] {
            common.extend(field.to_le_bytes());
        }
        common.extend(name_length.to_le_bytes());

        self.file.extend(LOCAL);
        self.file.extend(&common);
        self.file.extend((padding + 4).to_le_bytes());
        self.file.extend(name.as_bytes());
        self.file.extend(PADDING);
        self.file.extend(padding.to_le_bytes());
        self.file.extend(std::iter::repeat_n(b'Z', usize::from(padding)));
        self.file.extend(content);

        self.directory.extend(DIRECTORY);
        self.directory.extend(VERSION.to_le_bytes());
        self.directory.extend(&common);
        // No extra field, no comment, first part, no attributes.
        self.directory.extend([0; 12]);
        self.directory.extend(at.to_le_bytes());
        self.directory.extend(name.as_bytes());
        self.members = self.members.checked_add(1)?;
        Some(())
    }

    /// The archive's bytes; `None` when it exceeds 2 GiB.
    pub(crate) fn finish(self) -> Option<Vec<u8>> {
        let Self { mut file, directory, members } = self;
        let (at, size) = (u32::try_from(file.len()).ok()?, u32::try_from(directory.len()).ok()?);
        file.extend(directory);
        file.extend(END);
        file.extend([0; 4]);
        file.extend(members.to_le_bytes());
        file.extend(members.to_le_bytes());
        file.extend(size.to_le_bytes());
        file.extend(at.to_le_bytes());
        file.extend([0; 2]);
        Some(file)
    }
}

#[cfg(test)]
mod tests {
    use std::io::Read as _;

    use super::super::Archive;
    use super::*;

    #[test]
    fn other_readers_and_our_own_read_it() {
        let members = [
            ("archive/data.pkl", &b"\x80\x02."[..]),
            ("archive/data/0", &[7; 1000]),
            ("archive/version", b"3\n"),
        ];
        let mut writer = Writer::default();
        for (name, content) in members {
            writer.add(name, content).unwrap();
        }
        let file = bytes::Bytes::from(writer.finish().unwrap());
        let archive = Archive::open(&file).unwrap();
        let mut zip = zip::ZipArchive::new(std::io::Cursor::new(&file)).unwrap();
        for (index, (name, content)) in members.into_iter().enumerate() {
            let ours = archive.stored(archive.member(name).unwrap()).unwrap().unwrap();
            assert_eq!(ours, content);
            assert_eq!((ours.as_ptr() as usize - file.as_ptr() as usize) % ALIGN, 0, "{name}");
            let mut theirs = Vec::new();
            let mut member = zip.by_index(index).unwrap();
            assert_eq!(member.name().unwrap(), name);
            member.read_to_end(&mut theirs).unwrap();
            assert_eq!(theirs, content);
        }
    }
}
