//! Reading of archives, which may come from strangers.

use std::collections::BTreeMap;
use std::io::Read;

use bytes::Bytes;
use flate2::Crc;
use flate2::read::DeflateDecoder;

use crate::malformed;
use wrapyfi_data::codec::Fields;
use wrapyfi_data::plugin::{PluginError, Unpacking};

const LOCAL: &[u8; 4] = b"PK\x03\x04";
const DIRECTORY: &[u8; 4] = b"PK\x01\x02";
const END: &[u8; 4] = b"PK\x05\x06";
/// Length of an end record without its comment.
const END_LENGTH: usize = 22;
/// Length of a directory entry without name, extra field and comment.
const ENTRY_LENGTH: usize = 46;
/// Length of a local header without name and extra field.
const LOCAL_LENGTH: usize = 30;

/// Packing, checksum, sizes and place of a member, as the directory states them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Member {
    method: u16,
    crc: u32,
    packed: usize,
    /// Length of the member's content in bytes.
    pub(crate) size: usize,
    header: usize,
}

/// An archive whose directory was checked. Its members may still be anything.
#[derive(Debug)]
pub(crate) struct Archive {
    file: Bytes,
    members: BTreeMap<String, Member>,
}

/// Largest number of members in an archive.
const MAX_MEMBERS: usize = 4096;
/// Longest comment, whose length is a number of two bytes.
const LONGEST_COMMENT: usize = u16::MAX as usize;

/// Methods of packing.
const STORED: u16 = 0;
const DEFLATED: u16 = 8;
/// Flag of an encrypted member.
const ENCRYPTED: u16 = 1;

impl Archive {
    /// Reads the directory.
    ///
    /// # Errors
    /// When there is no directory, it does not lie in the file, or it has names that a file system
    /// would take for another place.
    pub(crate) fn open(file: &Bytes) -> Result<Self, String> {
        let end = find_end(file)?;
        let record = fields(file.get(end..).unwrap_or_default());
        if record.u16(4)? != 0 || record.u16(6)? != 0 {
            return Err("the zip archive has several parts".into());
        }
        let (count, size, offset) = (record.u16(10)?, record.u32(12)?, record.u32(16)?);
        if count == u16::MAX || size == u32::MAX || offset == u32::MAX {
            return Err("the zip archive is larger than 4 GiB or claims to be".into());
        }
        let count = usize::from(count);
        if count > MAX_MEMBERS {
            return Err(format!("the zip archive has {count} members, the limit is {MAX_MEMBERS}"));
        }
        let directory = (offset as usize)
            .checked_add(size as usize)
            .filter(|&directory_end| directory_end <= end)
            .and_then(|directory_end| file.get(offset as usize..directory_end))
            .ok_or_else(|| {
                format!(
                    "the zip directory should lie at {offset}, {size} bytes long, before byte {end}"
                )
            })?;
        let mut members = BTreeMap::new();
        let mut rest = directory;
        for index in 0..count {
            let (name, member, after) =
                entry(rest).map_err(|why| format!("zip member {index}: {why}"))?;
            if members.insert(name.to_owned(), member).is_some() {
                return Err(format!("the zip archive has two members {name:?}"));
            }
            rest = after;
        }
        Ok(Self { file: file.clone(), members })
    }

    /// Names and members.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (&str, &Member)> {
        self.members.iter().map(|(name, member)| (name.as_str(), member))
    }

    /// Member of this name.
    pub(crate) fn member(&self, name: &str) -> Option<&Member> {
        self.members.get(name)
    }

    /// Content of a stored member, shared with the file; `None` when it must be inflated. The
    /// checksum is not checked, because torch does not, and can be told to write none.
    ///
    /// # Errors
    /// When the member does not lie in the file.
    pub(super) fn stored(&self, member: &Member) -> Result<Option<Bytes>, String> {
        if member.method != STORED {
            return Ok(None);
        }
        if member.packed != member.size {
            return Err(format!("it is stored, but {} bytes for {}", member.packed, member.size));
        }
        self.packed(member).map(Some)
    }

    /// Content of a member, which an error calls `what`; inflated where it must be, and booked before.
    ///
    /// # Errors
    /// When the archive is damaged there, or the content takes more than `context` allows.
    pub(crate) fn content(
        &self,
        member: &Member,
        what: &str,
        context: &Unpacking<'_>,
    ) -> Result<Bytes, PluginError> {
        let misfit = |reason| malformed(format!("{what}: {reason}"));
        if let Some(content) = self.stored(member).map_err(misfit)? {
            return Ok(content);
        }
        context.unpack(what, member.size as u64)?;
        self.inflate(member).map_err(misfit)
    }

    /// Content of a deflated member. The caller has checked that `member.size` bytes may be
    /// allocated.
    ///
    /// # Errors
    /// When the member does not lie in the file, is packed in another way, or is not as long as it
    /// claims.
    fn inflate(&self, member: &Member) -> Result<Bytes, String> {
        if member.method != DEFLATED {
            return Err(format!(
                "it is packed by method {}, not stored or deflated",
                member.method
            ));
        }
        let packed = self.packed(member)?;
        // The vector grows with the bytes that come, not with the claimed size.
        let mut content = Vec::new();
        let most = (member.size as u64).saturating_add(1);
        DeflateDecoder::new(&*packed)
            .take(most)
            .read_to_end(&mut content)
            .map_err(|error| format!("it cannot be inflated: {error}"))?;
        if content.len() != member.size {
            let more = if content.len() > member.size { "more" } else { "fewer" };
            return Err(format!("it inflates to {more} than the {} bytes it claims", member.size));
        }
        let mut crc = Crc::new();
        crc.update(&content);
        if crc.sum() != member.crc {
            return Err(format!("its checksum is {:08x}, {:08x} is stated", crc.sum(), member.crc));
        }
        Ok(content.into())
    }

    /// Bytes of a member as they lie in the file.
    fn packed(&self, member: &Member) -> Result<Bytes, String> {
        let header = fields(self.file.get(member.header..).unwrap_or_default());
        if !header.file.starts_with(LOCAL) {
            return Err(format!("no member begins at byte {}", member.header));
        }
        let start = member.header + LOCAL_LENGTH;
        let start = start + usize::from(header.u16(26)?) + usize::from(header.u16(28)?);
        let end = start.checked_add(member.packed).filter(|&end| end <= self.file.len());
        let end = end.ok_or_else(|| {
            let left = self.file.len().saturating_sub(start);
            format!("it needs {} bytes from byte {start} on, {left} are there", member.packed)
        })?;
        Ok(self.file.slice(start..end))
    }
}

/// Finds the end record, which is followed only by a comment whose length it states.
fn find_end(file: &[u8]) -> Result<usize, String> {
    let first = file.len().saturating_sub(END_LENGTH + LONGEST_COMMENT);
    let tail = file.get(first..).unwrap_or_default();
    let mut end = tail.len();
    while let Some(at) = memchr::memmem::rfind(tail.get(..end).unwrap_or_default(), END) {
        let record = fields(tail.get(at..).unwrap_or_default());
        if record
            .u16(20)
            .is_ok_and(|comment| record.file.len() == END_LENGTH + usize::from(comment))
        {
            return Ok(first + at);
        }
        end = at + 3;
    }
    Err("no zip archive: there is no end record".into())
}

/// Reads the directory entry at the begin of `rest`: its name, its member, and the bytes behind it.
fn entry(rest: &[u8]) -> Result<(&str, Member, &[u8]), String> {
    let fields = fields(rest);
    if !rest.starts_with(DIRECTORY) {
        return Err("the zip directory ends before it".into());
    }
    if fields.u16(8)? & ENCRYPTED != 0 {
        return Err("it is encrypted".into());
    }
    let member = Member {
        method: fields.u16(10)?,
        crc: fields.u32(16)?,
        packed: fields.u32(20)? as usize,
        size: fields.u32(24)? as usize,
        header: fields.u32(42)? as usize,
    };
    if [member.packed, member.size, member.header].contains(&(u32::MAX as usize)) {
        return Err("it is larger than 4 GiB or claims to be".into());
    }
    let name_end = ENTRY_LENGTH + usize::from(fields.u16(28)?);
    let next = name_end + usize::from(fields.u16(30)?) + usize::from(fields.u16(32)?);
    let name = rest.get(ENTRY_LENGTH..name_end).ok_or("its name is cut off")?;
    let name = str::from_utf8(name).map_err(|error| format!("its name is not UTF-8: {error}"))?;
    check_name(name)?;
    Ok((name, member, rest.get(next..).ok_or("its entry is cut off")?))
}

/// Refuses names that lead out of the archive. No member is written to a disk here, but a program
/// that unpacks the archive elsewhere would write one.
fn check_name(name: &str) -> Result<(), String> {
    let shown = || name.chars().take(64).collect::<String>();
    if name.is_empty() || name.starts_with('/') || name.contains(['\\', '\0', ':']) {
        return Err(format!("the name {:?} is no relative path", shown()));
    }
    if name.split('/').any(|part| part == "..") {
        return Err(format!("the name {:?} leads out of the archive", shown()));
    }
    Ok(())
}

fn fields(file: &[u8]) -> Fields<'_> {
    Fields { file, little_endian: true }
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use zip::write::SimpleFileOptions;
    use zip::{CompressionMethod, ZipWriter};

    use super::*;

    /// An archive that another implementation wrote.
    fn foreign(members: &[(&str, &[u8], CompressionMethod)], comment: &str) -> Bytes {
        let mut zip = ZipWriter::new(std::io::Cursor::new(Vec::new()));
        for (name, content, method) in members {
            let options = SimpleFileOptions::default().compression_method(*method);
            zip.start_file(*name, options).unwrap();
            zip.write_all(content).unwrap();
        }
        zip.set_comment(comment).unwrap();
        zip.finish().unwrap().into_inner().into()
    }

    fn content(archive: &Archive, name: &str) -> Result<Bytes, String> {
        let member = archive.member(name).unwrap();
        archive.stored(member)?.map_or_else(|| archive.inflate(member), Ok)
    }

    #[test]
    fn members_of_other_writers_are_read() {
        let long = vec![7; 100_000];
        let file = foreign(
            &[
                ("a/stored", b"abc", CompressionMethod::Stored),
                ("a/deflated", &long, CompressionMethod::Deflated),
                ("empty", b"", CompressionMethod::Stored),
            ],
            "PK\x05\x06 in a comment",
        );
        let archive = Archive::open(&file).unwrap();
        assert_eq!(
            archive.iter().map(|(name, _)| name).collect::<Vec<_>>(),
            ["a/deflated", "a/stored", "empty"]
        );
        let stored = content(&archive, "a/stored").unwrap();
        assert_eq!(stored, "abc");
        assert!(file.as_ptr_range().contains(&stored.as_ptr()), "not shared");
        assert_eq!(content(&archive, "a/deflated").unwrap(), long);
        assert_eq!(content(&archive, "empty").unwrap(), "");
    }

    #[test]
    fn a_member_never_becomes_longer_than_it_claims() {
        let bomb = vec![0; 1 << 20];
        let file = foreign(&[("bomb", &bomb, CompressionMethod::Deflated)], "");
        let claimed = memchr::memmem::find(&file, DIRECTORY).unwrap() + 24;
        for (claim, word) in [(10_u32, "more"), (1 << 30, "fewer")] {
            let mut lying = file.to_vec();
            lying[claimed..claimed + 4].copy_from_slice(&claim.to_le_bytes());
            let archive = Archive::open(&lying.into()).unwrap();
            let error = content(&archive, "bomb").unwrap_err();
            assert!(error.contains(word), "{error}");
        }
    }

    #[test]
    fn damage_is_found() {
        let file = foreign(&[("a", &[7; 1000], CompressionMethod::Deflated)], "");
        let mut damaged = file.to_vec();
        let checksum = memchr::memmem::find(&file, DIRECTORY).unwrap() + 16;
        damaged[checksum] ^= 1;
        let archive = Archive::open(&damaged.into()).unwrap();
        assert!(content(&archive, "a").unwrap_err().contains("checksum"));
        for end in 0..file.len() {
            assert!(Archive::open(&file.slice(..end)).is_err(), "{end}");
        }
    }

    #[test]
    fn names_that_lead_elsewhere_are_refused() {
        for name in ["../a", "a/../../b", "/a", "a\\b", "C:a"] {
            // The name is set in the bytes, because the writer would repair it.
            let mut file =
                foreign(&[(&"x".repeat(name.len()), b"", CompressionMethod::Stored)], "").to_vec();
            let at = memchr::memmem::find(&file, DIRECTORY).unwrap() + ENTRY_LENGTH;
            file[at..at + name.len()].copy_from_slice(name.as_bytes());
            assert!(Archive::open(&file.into()).is_err(), "{name}");
        }
        let mut file = foreign(
            &[("a", b"1", CompressionMethod::Stored), ("b", b"2", CompressionMethod::Stored)],
            "",
        )
        .to_vec();
        let at = memchr::memmem::rfind(&file, DIRECTORY).unwrap() + ENTRY_LENGTH;
        file[at] = b'a';
        assert!(Archive::open(&file.into()).unwrap_err().contains("two members"));
    }

    #[test]
    fn counts_and_places_are_checked_before_they_are_used() {
        let file = foreign(&[("a", b"1", CompressionMethod::Stored)], "");
        let end = file.len() - END_LENGTH;
        for (at, claim) in [
            (10, &[0xff, 0xff][..]),
            (10, &[0, 0x20]),
            (10, &[2, 0]),
            (12, &[0xff; 4]),
            (16, &[0xff, 0xff, 0xff, 0x7f]),
        ] {
            let mut lying = file.to_vec();
            lying[end + at..end + at + claim.len()].copy_from_slice(claim);
            assert!(Archive::open(&lying.into()).is_err(), "{at}");
        }
    }
}
