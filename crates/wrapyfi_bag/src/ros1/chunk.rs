//! Chunks: records one behind the other, as they are or packed.
//!
//! ```text
//!   none   read from the file as the records are wanted
//!   bz2 ─┐ bytes of the file, bounded by it ─▶ unpacked ahead, else as the records are wanted: at most the size that
//!   lz4 ─┘                                     the chunk claims
//! ```

use std::fmt;
use std::io::{self, Cursor, Read, Seek};

use bzip2::read::BzDecoder;
use lz4_flex::frame::FrameDecoder;

use super::error::Fault;
use super::input::{Input, Stop};

/// Bytes that are thrown away at once.
const SKIP: u64 = 64 * 1024;

/// Compression of a packed chunk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Compression {
    Bz2,
    Lz4,
}

impl Compression {
    /// Compression by the name that a chunk has for it.
    pub(super) fn named(name: &[u8]) -> Option<Self> {
        match name {
            b"bz2" => Some(Self::Bz2),
            b"lz4" => Some(Self::Lz4),
            _ => None,
        }
    }
}

/// Bytes that come out of a packed chunk.
pub(super) enum Unpacked {
    Bz2(Box<BzDecoder<Cursor<Vec<u8>>>>),
    Lz4(Box<FrameDecoder<Cursor<Vec<u8>>>>),
    /// All of them: they were unpacked ahead.
    Records(Cursor<Vec<u8>>),
}

impl Unpacked {
    pub(super) fn new(compression: Compression, packed: Vec<u8>) -> Self {
        match compression {
            Compression::Bz2 => Self::Bz2(Box::new(BzDecoder::new(Cursor::new(packed)))),
            Compression::Lz4 => Self::Lz4(Box::new(FrameDecoder::new(Cursor::new(packed)))),
        }
    }

    /// Memory of the bytes that it was made of, to be used again.
    pub(super) fn into_memory(self) -> Vec<u8> {
        match self {
            Self::Bz2(decoder) => decoder.into_inner().into_inner(),
            Self::Lz4(decoder) => decoder.into_inner().into_inner(),
            Self::Records(records) => records.into_inner(),
        }
    }
}

impl Read for Unpacked {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::Bz2(decoder) => decoder.read(into),
            Self::Lz4(decoder) => decoder.read(into),
            Self::Records(records) => records.read(into),
        }
    }
}

impl fmt::Debug for Unpacked {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Bz2(_) => "Bz2",
            Self::Lz4(_) => "Lz4",
            Self::Records(_) => "Records",
        })
    }
}

/// The chunk that is being read.
#[derive(Debug)]
pub(super) struct Chunk {
    /// Offset of its data in the file.
    pub(super) begin: u64,
    /// Offset behind its data, as it claims.
    pub(super) end: u64,
    /// Size of its records, as it claims.
    pub(super) claimed: u64,
    /// Bytes of its records that are still to be read.
    pub(super) left: u64,
    /// Decoder of a packed chunk.
    pub(super) unpacked: Option<Unpacked>,
}

impl Chunk {
    /// Fills `into` with the next bytes of the records.
    pub(super) fn fill<R: Read + Seek>(
        &mut self,
        input: &mut Input<R>,
        into: &mut [u8],
    ) -> Result<(), Stop> {
        let wanted = into.len() as u64;
        if let Some(missing) = wanted.checked_sub(self.left).filter(|missing| *missing > 0) {
            return Err(Fault::Short { missing }.into());
        }
        match &mut self.unpacked {
            None => input.fill(into)?,
            Some(decoder) => decoder.read_exact(into).map_err(|error| unpack_fault(&error))?,
        }
        self.left -= wanted;
        Ok(())
    }

    /// Passes over the next bytes of the records.
    pub(super) fn skip<R: Read + Seek>(
        &mut self,
        input: &mut Input<R>,
        mut count: u64,
    ) -> Result<(), Stop> {
        if let Some(missing) = count.checked_sub(self.left).filter(|missing| *missing > 0) {
            return Err(Fault::Short { missing }.into());
        }
        if self.unpacked.is_none() {
            if let Some(missing) = count.checked_sub(input.left()).filter(|missing| *missing > 0) {
                return Err(Fault::Short { missing }.into());
            }
            input.go_to(input.at().saturating_add(count))?;
            self.left -= count;
            return Ok(());
        }
        let mut scratch = vec![0; usize::try_from(count.min(SKIP)).unwrap_or_default()];
        while count > 0 {
            let now = count.min(SKIP);
            let part = scratch.get_mut(..usize::try_from(now).unwrap_or_default());
            self.fill(input, part.unwrap_or_default())?;
            count -= now;
        }
        Ok(())
    }

    /// Refuses a chunk that goes on behind the size that it claims.
    pub(super) fn check_end(&mut self) -> Result<(), Fault> {
        let mut one = [0];
        match self.unpacked.as_mut().map(|decoder| decoder.read(&mut one)) {
            Some(Ok(1..)) => Err(Fault::ChunkGoesOn { claimed: self.claimed }),
            Some(Err(error)) => Err(Fault::Unpack(error.to_string())),
            Some(Ok(0)) | None => Ok(()),
        }
    }
}

fn unpack_fault(error: &io::Error) -> Stop {
    Fault::Unpack(match error.kind() {
        io::ErrorKind::UnexpectedEof => "it ends before the size that it claims".to_owned(),
        _ => error.to_string(),
    })
    .into()
}
