//! The writer of recordings.

use std::collections::BTreeMap;
use std::io::{self, Seek, Write};

use mcap::records::MessageHeader;
use wrapyfi_endpoint::Qos;
use wrapyfi_interfaces::store::ResolvedType;

use super::metadata::Metadata;
use super::qos::profiles;
use crate::schema::definition_text;

/// Bytes of messages in a chunk, which is read and unpacked as a whole.
const CHUNK_BYTES: u64 = 4 << 20;

/// Compression of chunks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Compression {
    /// None: as fast as the disk.
    #[default]
    None,
    /// LZ4: fast.
    Lz4,
    /// Zstandard: smallest.
    Zstd,
}

/// Error of writing a recording.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WriteError {
    /// The system refuses, for instance because the disk is full.
    #[error("it cannot be written: {0}")]
    Io(io::Error),
    /// The file cannot be written on.
    #[error("it cannot be written: {0}")]
    Mcap(mcap::McapError),
    /// There are more topics than a file can have.
    #[error(
        "there are over {limit} topics, which is all that a file can have: choose some with --topics"
    )]
    TooManyTopics {
        /// The limit.
        limit: usize,
    },
    /// The topic was not added to this recording.
    #[error("topic {0} was not added")]
    UnknownTopic(usize),
}

impl From<mcap::McapError> for WriteError {
    fn from(error: mcap::McapError) -> Self {
        match error {
            mcap::McapError::Io(error) => Self::Io(error),
            error => Self::Mcap(error),
        }
    }
}

/// A topic of a recording.
#[derive(Debug, Clone, PartialEq)]
pub struct Topic {
    /// Name.
    pub name: String,
    /// Type, for instance `sensor_msgs/msg/Image`.
    pub type_name: String,
    /// REP-2016 hash of the type.
    pub type_hash: String,
    /// Definition of the type with all it refers to.
    pub definition: String,
    /// Quality of service that the publishers offered.
    pub qos: Vec<Qos>,
}

impl Topic {
    /// A topic of a type that is known.
    pub fn of(name: &str, resolved: &ResolvedType, qos: Vec<Qos>) -> Self {
        Self {
            name: name.to_owned(),
            type_name: resolved.name().to_string(),
            type_hash: resolved.type_hash(),
            definition: definition_text(resolved),
            qos,
        }
    }
}

/// Topic of a [`Writer`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TopicId(usize);

#[derive(Debug)]
struct Written {
    topic: Topic,
    channel: u16,
    messages: u64,
}

/// A recording that is being written.
///
/// ```
/// use std::io::Cursor;
/// use wrapyfi_bag::recording::{Compression, Topic, Writer};
/// use wrapyfi_endpoint::Qos;
/// use wrapyfi_interfaces::store::TypeStore;
/// let text = TypeStore::generated().resolve_name("std_msgs/msg/String").unwrap();
/// let mut out = Writer::new(Cursor::new(Vec::new()), Compression::None).unwrap();
/// let topic = out.add_topic(&Topic::of("/chatter", &text, vec![Qos::default()])).unwrap();
/// out.write(topic, 5, 5, b"\0\x01\0\0\x03\0\0\0hi\0").unwrap();
/// let (file, metadata) = out.finish("chatter_0.mcap", "jazzy").unwrap();
/// assert!(file.into_inner().starts_with(b"\x89MCAP0\r\n"));
/// assert!(metadata.to_yaml().contains("message_count: 1"));
/// ```
pub struct Writer<W: Write + Seek> {
    inner: mcap::Writer<W>,
    topics: Vec<Written>,
    /// Times of the first message and of the last, in nanoseconds.
    bounds_ns: Option<(u64, u64)>,
}

impl<W: Write + Seek> std::fmt::Debug for Writer<W> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Writer").field("topics", &self.topics).finish_non_exhaustive()
    }
}

impl<W: Write + Seek> Writer<W> {
    /// Begins a recording.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn new(out: W, compression: Compression) -> Result<Self, WriteError> {
        let options = mcap::WriteOptions::new()
            .profile("ros2")
            .library(concat!("wrapyfi ", env!("CARGO_PKG_VERSION")))
            .chunk_size(Some(CHUNK_BYTES))
            // Each chunk has its own checksum: a second one over all of them doubles the work.
            .calculate_data_section_crc(false)
            .compression(match compression {
                Compression::None => None,
                Compression::Lz4 => Some(mcap::Compression::Lz4),
                Compression::Zstd => Some(mcap::Compression::Zstd),
            });
        Ok(Self { inner: options.create(out)?, topics: Vec::new(), bounds_ns: None })
    }

    /// Adds a topic. One of the same name and type is the same topic.
    ///
    /// # Errors
    /// When it cannot be written, or there are too many.
    pub fn add_topic(&mut self, topic: &Topic) -> Result<TopicId, WriteError> {
        let is_same =
            |one: &Written| one.topic.name == topic.name && one.topic.type_hash == topic.type_hash;
        if let Some(known) = self.topics.iter().position(is_same) {
            return Ok(TopicId(known));
        }
        let limit = usize::from(u16::MAX) - 1;
        if self.topics.len() >= limit {
            return Err(WriteError::TooManyTopics { limit });
        }
        let Topic { name, type_name, type_hash, definition, qos } = topic;
        let schema = self.inner.add_schema(type_name, "ros2msg", definition.as_bytes())?;
        let metadata = BTreeMap::from([
            ("offered_qos_profiles".to_owned(), profiles(qos, "").trim_end().to_owned()),
            ("topic_type_hash".to_owned(), type_hash.clone()),
        ]);
        let channel = self.inner.add_channel(schema, name, "cdr", &metadata)?;
        self.topics.push(Written { topic: topic.clone(), channel, messages: 0 });
        Ok(TopicId(self.topics.len() - 1))
    }

    /// Writes a message in CDR, with the times at which it was received and sent.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write(
        &mut self,
        topic: TopicId,
        received_ns: u64,
        sent_ns: u64,
        cdr: &[u8],
    ) -> Result<(), WriteError> {
        let written = self.topics.get_mut(topic.0).ok_or(WriteError::UnknownTopic(topic.0))?;
        let header = MessageHeader {
            channel_id: written.channel,
            // The counter of MCAP begins again behind 2^32 messages.
            sequence: u32::try_from(written.messages & u64::from(u32::MAX)).unwrap_or_default(),
            log_time: received_ns,
            publish_time: sent_ns,
        };
        self.inner.write_to_known_channel(&header, cdr)?;
        written.messages += 1;
        let (first, last) = self.bounds_ns.unwrap_or((received_ns, received_ns));
        self.bounds_ns = Some((first.min(received_ns), last.max(received_ns)));
        Ok(())
    }

    /// Ends the chunk and has the system write all that it holds: a process that is killed then loses nothing of it.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn flush(&mut self) -> Result<(), WriteError> {
        Ok(self.inner.flush()?)
    }

    /// Ends the recording, and returns the file with what is in it. `metadata.yaml` has `file`, its name, and `ros_distro`, the
    /// distribution of ROS 2 that is sourced: `ros2 bag` writes the variable `ROS_DISTRO`, and an empty text without it.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn finish(mut self, file: &str, ros_distro: &str) -> Result<(W, Metadata), WriteError> {
        let (first, last) = self.bounds_ns.unwrap_or_default();
        let metadata = Metadata {
            file: file.to_owned(),
            topics: self.topics.into_iter().map(|one| (one.topic, one.messages)).collect(),
            start_ns: first,
            duration_ns: last - first,
            ros_distro: ros_distro.to_owned(),
        };
        self.inner.write_metadata(&mcap::records::Metadata {
            name: "rosbag2".to_owned(),
            metadata: BTreeMap::from([("serialized_metadata".to_owned(), metadata.inner())]),
        })?;
        self.inner.finish()?;
        Ok((self.inner.into_inner(), metadata))
    }
}
