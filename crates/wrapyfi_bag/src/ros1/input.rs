//! The file with its position, which every fault names.

use std::io::{self, BufReader, Read, Seek, SeekFrom};

use super::error::{Fault, OpenError};

/// First line of a bag.
const MAGIC: &[u8] = b"#ROSBAG V2.0\n";
/// First bytes of an MCAP file.
const MCAP_MAGIC: &[u8] = b"\x89MCAP";
/// Bytes that are read ahead.
const BUFFER: usize = 256 * 1024;

/// Failure of reading some bytes.
#[derive(Debug)]
pub(super) enum Stop {
    /// The system refuses.
    Io(io::Error),
    /// The bytes are none of a bag.
    Fault(Fault),
}

impl From<Fault> for Stop {
    fn from(fault: Fault) -> Self {
        Self::Fault(fault)
    }
}

impl From<io::Error> for Stop {
    fn from(error: io::Error) -> Self {
        Self::Io(error)
    }
}

/// A file that is read from front to end, with jumps.
#[derive(Debug)]
pub(super) struct Input<R> {
    inner: BufReader<R>,
    at: u64,
    size: u64,
}

impl<R: Read + Seek> Input<R> {
    pub(super) fn new(mut source: R) -> io::Result<Self> {
        let size = source.seek(SeekFrom::End(0))?;
        source.seek(SeekFrom::Start(0))?;
        Ok(Self { inner: BufReader::with_capacity(BUFFER, source), at: 0, size })
    }

    /// Offset of the next byte.
    pub(super) fn at(&self) -> u64 {
        self.at
    }

    /// Size of the file when it was opened.
    pub(super) fn size(&self) -> u64 {
        self.size
    }

    /// Bytes from here to the end.
    pub(super) fn left(&self) -> u64 {
        self.size.saturating_sub(self.at)
    }

    /// Goes to an offset, at most to the end.
    pub(super) fn go_to(&mut self, at: u64) -> io::Result<()> {
        let at = at.min(self.size);
        let by = i64::try_from(at).ok().zip(i64::try_from(self.at).ok());
        match by {
            Some((to, from)) => self.inner.seek_relative(to.saturating_sub(from))?,
            None => _ = self.inner.seek(SeekFrom::Start(at))?,
        }
        self.at = at;
        Ok(())
    }

    /// Reads up to so many bytes; fewer at the end alone.
    pub(super) fn read_some(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let mut filled = 0;
        while let Some(rest) = into.get_mut(filled..).filter(|rest| !rest.is_empty()) {
            match self.inner.read(rest) {
                Ok(0) => break,
                Ok(count) => {
                    filled += count;
                    self.at += count as u64;
                }
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(filled)
    }

    /// Fills `into`, or says how much is missing.
    pub(super) fn fill(&mut self, into: &mut [u8]) -> Result<(), Stop> {
        let filled = self.read_some(into)?;
        let missing = into.len().saturating_sub(filled) as u64;
        if missing == 0 { Ok(()) } else { Err(Fault::Short { missing }.into()) }
    }
}

/// Reads the first line, and refuses a file that is no bag.
pub(super) fn check_magic<R: Read + Seek>(input: &mut Input<R>) -> Result<(), OpenError> {
    let mut begin = [0; MAGIC.len()];
    let count = input.read_some(&mut begin)?;
    let begin = begin.get(..count).unwrap_or_default();
    if begin == MAGIC {
        return Ok(());
    }
    let text = String::from_utf8_lossy(begin);
    if let Some(version) = text.strip_prefix("#ROSBAG V") {
        return Err(OpenError::Version { version: version.trim_end().to_owned() });
    }
    let hint = match begin {
        [] => ": it is empty",
        _ if begin.starts_with(MCAP_MAGIC) => ": it is an MCAP file already",
        _ if begin.starts_with(b"SQLite") => {
            ": it is a database, as `ros2 bag` writes with sqlite3"
        }
        _ => "",
    };
    Err(OpenError::Magic { begin: text.into_owned(), hint })
}
