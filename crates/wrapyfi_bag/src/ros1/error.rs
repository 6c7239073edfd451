//! Errors of bags, and the damage that reading has passed over.

use std::{fmt, io};

/// Most places of damage that are kept with their reasons; the others are counted.
const MAX_KEPT: usize = 16;

/// Error of opening a bag.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum OpenError {
    /// The file begins as no bag does.
    #[error("it is no bag of ROS 1: it begins with {begin:?}, not with \"#ROSBAG V2.0\"{hint}")]
    Magic {
        /// First bytes of the file, those that are no letters replaced.
        begin: String,
        /// The format that it has instead, where that shows.
        hint: &'static str,
    },
    /// The format is of another version.
    #[error(
        "it is a bag of format {version}, and only 2.0 can be read: run `rosbag fix` on it where ROS 1 is installed"
    )]
    Version {
        /// Version in the first line.
        version: String,
    },
    /// The bag is encrypted.
    #[error("it is encrypted by {encryptor:?}: write it without encryption where its key is")]
    Encrypted {
        /// Name of the plug-in of ROS 1.
        encryptor: String,
    },
    /// The system refuses to read.
    #[error("it cannot be read: {0}")]
    Io(#[from] io::Error),
}

/// Error of reading on in a bag: the system refuses. Damage of the bag is no error: see [`Damage`].
#[derive(Debug, thiserror::Error)]
#[error("it cannot be read at byte {at}: {source}")]
pub struct ReadError {
    /// Offset in the file.
    pub at: u64,
    /// Error of the system.
    pub source: io::Error,
}

/// Reason why a record cannot be read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Fault {
    /// The file, or the chunk, ends inside a record.
    #[error("a record ends {missing} bytes too early")]
    Short {
        /// Bytes that were announced and are not there.
        missing: u64,
    },
    /// The header of a record is larger than any is.
    #[error("a record claims a header of {claimed} bytes, over the limit of {limit}")]
    HeaderSize {
        /// Size in bytes.
        claimed: u64,
        /// Limit in bytes.
        limit: u64,
    },
    /// The header of a record is none.
    #[error("the header of a record is broken: {0}")]
    Header(&'static str),
    /// A message is larger than allowed. It is passed over, and the next is read.
    #[error("a message of {claimed} bytes is over the limit of {limit} bytes")]
    MessageSize {
        /// Size in bytes.
        claimed: u64,
        /// Limit in bytes.
        limit: u64,
    },
    /// A chunk says that it unpacks to more than allowed. It is passed over.
    #[error(
        "a chunk of {packed} bytes claims to unpack to {claimed} bytes, over the limit of {limit} bytes"
    )]
    ChunkSize {
        /// Size in the file, in bytes.
        packed: u64,
        /// Size that it claims, in bytes.
        claimed: u64,
        /// Limit in bytes.
        limit: u64,
    },
    /// A chunk unpacks to more than it says.
    #[error("a chunk unpacks to more than the {claimed} bytes that it claims")]
    ChunkGoesOn {
        /// Size that it claims, in bytes.
        claimed: u64,
    },
    /// A chunk is packed in a way that no reader of bags knows.
    #[error("a chunk is packed by {0:?}; none, bz2 and lz4 can be read")]
    Compression(String),
    /// A packed chunk cannot be unpacked.
    #[error("a chunk cannot be unpacked: {0}")]
    Unpack(String),
    /// A message belongs to a connection that the bag does not define.
    #[error("a message belongs to connection {0}, which the bag does not define")]
    NoConnection(u32),
    /// There are more connections than allowed.
    #[error("there are over {limit} connections")]
    TooManyConnections {
        /// The limit.
        limit: usize,
    },
}

/// Places of a bag that could not be read.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Damage {
    /// The first places: offset in the file, and the reason.
    pub places: Vec<(u64, Fault)>,
    /// Number of all places.
    pub count: u64,
    /// Bytes of the file that were passed over to find the next record.
    pub skipped_bytes: u64,
}

impl Damage {
    /// True where everything was read.
    pub fn is_none(&self) -> bool {
        self.count == 0
    }

    pub(super) fn note(&mut self, at: u64, fault: Fault) {
        self.count = self.count.saturating_add(1);
        if self.places.len() < MAX_KEPT {
            self.places.push((at, fault));
        }
    }
}

/// One line for each place.
impl fmt::Display for Damage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (at, fault) in &self.places {
            writeln!(f, "byte {at}: {fault}")?;
        }
        let more = self.count.saturating_sub(self.places.len() as u64);
        if more > 0 {
            writeln!(f, "… and {more} more places")?;
        }
        Ok(())
    }
}
