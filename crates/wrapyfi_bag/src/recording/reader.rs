//! The reader of recordings: messages in the order of their times.
//!
//! ```text
//!   summary at the end ─▶ topics, chunks ─▶ messages by their times
//!   no summary (the recording was killed) ─▶ messages in the order of the file, as far as it goes, then those of a chunk
//!                                            whose sizes were never written
//! ```

use std::collections::BTreeMap;
use std::io::{self, Read, Seek, SeekFrom};

use mcap::records::{Record, op};
use mcap::sans_io::{
    IndexedReadEvent, IndexedReader, IndexedReaderOptions, LinearReadEvent, LinearReader,
    LinearReaderOptions, SummaryReadEvent, SummaryReader, SummaryReaderOptions,
};
use mcap::{McapError, Summary};
use wrapyfi_endpoint::Qos;

use super::qos;

/// First bytes of an MCAP file.
const MAGIC: &[u8] = b"\x89MCAP0\r\n";
/// Bytes of a record before its data: its kind, and its size.
const RECORD_HEAD: usize = 9;
/// Bytes of a chunk's data before the name of its compression: two times, its size unpacked, a checksum.
const BEFORE_COMPRESSION: u64 = 28;
/// Bytes of the size of a name, and of the size of the chunk packed, which stands behind the name.
const SIZES: u64 = 4 + 8;

/// Error of reading a recording.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecordingError {
    /// The file begins as no MCAP file does.
    #[error("it is no MCAP file: it begins with {begin:?}")]
    Magic {
        /// First bytes of the file, those that are no letters replaced.
        begin: String,
    },
    /// The system refuses to read.
    #[error("it cannot be read: {0}")]
    Io(#[from] io::Error),
    /// The file is broken, or a part of it is larger than the limit.
    #[error("it cannot be read on: {source}; parts of it may be at most {limit} bytes")]
    Mcap {
        /// Fault of the file.
        source: McapError,
        /// Limit of a message, and of a chunk in the file and unpacked, in bytes.
        limit: usize,
    },
}

/// A topic of a recording.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordedTopic {
    /// Name.
    pub name: String,
    /// Type, for instance `sensor_msgs/msg/Image`.
    pub type_name: String,
    /// Encoding of the messages: `cdr` in ROS 2.
    pub encoding: String,
    /// Encoding of the definition: `ros2msg`, or `ros2idl`.
    pub definition_encoding: String,
    /// Definition of the type with all it refers to.
    pub definition: String,
    /// Quality of service that its publishers offered.
    pub qos: Vec<Qos>,
    /// Number of its messages, where the file says so.
    pub messages: Option<u64>,
}

/// A message of a recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Recorded {
    /// Index of its topic in [`Reader::topics`].
    pub topic: usize,
    /// Time at which it was received, in nanoseconds since 1970.
    pub time_ns: u64,
    /// The message, with its encapsulation header.
    pub cdr: Vec<u8>,
}

enum Order {
    /// By times, with the index.
    Indexed(Box<IndexedReader>),
    /// As the file has them.
    Linear(Linear),
}

/// Messages in the order of the file.
struct Linear {
    reader: Box<LinearReader>,
    /// Bytes of the file that are left to it.
    left: u64,
    /// Offset of records that are to be read behind these: those of a chunk that was never ended.
    behind: Option<u64>,
    /// The end of the recording was never written, or is cut off.
    is_cut: bool,
}

impl Linear {
    fn new(source: &mut (impl Read + Seek), size: u64, limit: usize) -> io::Result<Self> {
        let open = open_chunk(source, size)?;
        source.seek(SeekFrom::Start(0))?;
        let options = LinearReaderOptions::default().with_record_length_limit(limit);
        Ok(Self {
            reader: Box::new(LinearReader::new_with_options(options)),
            left: open.as_ref().map_or(size, |open| open.at),
            behind: open.and_then(|open| open.records_at),
            is_cut: false,
        })
    }

    /// Gives the reader what it asks for, as far as there is some.
    fn feed(&mut self, source: &mut impl Read, wanted: usize) -> io::Result<()> {
        let wanted = wanted.min(usize::try_from(self.left).unwrap_or(usize::MAX));
        let count = source.read(self.reader.insert(wanted))?;
        self.left = self.left.saturating_sub(count as u64);
        self.reader.notify_read(count);
        Ok(())
    }

    /// Goes on behind the begin of a chunk that was never ended; false where there is none.
    fn go_on(&mut self, source: &mut impl Seek, size: u64, limit: usize) -> io::Result<bool> {
        self.is_cut = true;
        let Some(at) = self.behind.take() else { return Ok(false) };
        source.seek(SeekFrom::Start(at))?;
        let options = LinearReaderOptions::default().with_skip_start_magic(true);
        let options = options.with_record_length_limit(limit);
        *self.reader = LinearReader::new_with_options(options);
        self.left = size.saturating_sub(at);
        Ok(true)
    }
}

/// A chunk whose sizes were never written: a recording that is killed leaves it.
struct OpenChunk {
    at: u64,
    /// Offset of its records; none where they are packed.
    records_at: Option<u64>,
}

/// Looks for a chunk that was never ended.
fn open_chunk(source: &mut (impl Read + Seek), size: u64) -> io::Result<Option<OpenChunk>> {
    let mut at = MAGIC.len() as u64;
    while at.saturating_add(RECORD_HEAD as u64) <= size {
        source.seek(SeekFrom::Start(at))?;
        let mut head = [0; RECORD_HEAD];
        source.read_exact(&mut head)?;
        let [kind, length @ ..] = head;
        let length = u64::from_le_bytes(length);
        let data = at + RECORD_HEAD as u64;
        match (kind, length) {
            (op::CHUNK, u64::MAX) => {
                let name_at = data + BEFORE_COMPRESSION;
                let mut name = [0xFF; 4];
                if name_at + SIZES <= size {
                    source.seek(SeekFrom::Start(name_at))?;
                    source.read_exact(&mut name)?;
                }
                let records_at = (name == [0; 4]).then_some(name_at + SIZES);
                return Ok(Some(OpenChunk { at, records_at }));
            }
            // The file has no chunks.
            (op::MESSAGE, _) => return Ok(None),
            _ => at = data.saturating_add(length),
        }
    }
    Ok(None)
}

/// Name, encoding and definition of a type, by the number of its schema.
type Schemas = BTreeMap<u16, (String, String, String)>;

/// A recording that is open.
///
/// ```no_run
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use wrapyfi_bag::recording::Reader;
/// let mut recording = Reader::open(std::fs::File::open("robot.mcap")?, 256 << 20)?;
/// while let Some(message) = recording.next_message()? {
///     println!("{} at {} ns", recording.topics()[message.topic].name, message.time_ns);
/// }
/// # Ok(())
/// # }
/// ```
pub struct Reader<R> {
    source: R,
    size: u64,
    limit: usize,
    order: Order,
    topics: Vec<RecordedTopic>,
    schemas: Schemas,
    channels: BTreeMap<u16, usize>,
    /// Memory of packed chunks, used again and again.
    chunk: Vec<u8>,
}

impl<R> std::fmt::Debug for Reader<R> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { size, topics, .. } = self;
        f.debug_struct("Reader").field("size", size).field("topics", topics).finish_non_exhaustive()
    }
}

impl<R: Read + Seek> Reader<R> {
    /// Opens a recording. Messages and chunks are at most `limit` bytes large.
    ///
    /// # Errors
    /// When it is no MCAP file, is broken at its begin, or cannot be read.
    pub fn open(mut source: R, limit: usize) -> Result<Self, RecordingError> {
        let size = source.seek(SeekFrom::End(0))?;
        source.seek(SeekFrom::Start(0))?;
        let mut begin = Vec::new();
        source.by_ref().take(MAGIC.len() as u64).read_to_end(&mut begin)?;
        if begin != MAGIC {
            return Err(RecordingError::Magic {
                begin: String::from_utf8_lossy(&begin).into_owned(),
            });
        }
        let fault = |source| RecordingError::Mcap { source, limit };
        let summary = match summary(&mut source, size, limit) {
            Ok(summary) => summary,
            Err(RecordingError::Io(error)) => return Err(error.into()),
            // The messages may be whole all the same.
            Err(_) => None,
        };
        // Without chunks there is nothing that an index could lead to.
        let indexed = summary.filter(|summary| !summary.chunk_indexes.is_empty());
        let order = match &indexed {
            Some(summary) => {
                let options = IndexedReaderOptions::new().with_record_length_limit(limit);
                let reader = IndexedReader::new_with_options(summary, options).map_err(fault)?;
                Order::Indexed(Box::new(reader))
            }
            None => Order::Linear(Linear::new(&mut source, size, limit)?),
        };
        let mut reader = Self {
            source,
            size,
            limit,
            order,
            topics: Vec::new(),
            schemas: Schemas::new(),
            channels: BTreeMap::new(),
            chunk: Vec::new(),
        };
        if let Some(summary) = indexed {
            reader.take_summary(&summary);
        }
        Ok(reader)
    }

    /// Topics that are known: all where the recording has its index, else those that were met.
    pub fn topics(&self) -> &[RecordedTopic] {
        &self.topics
    }

    /// True where reading has come to a place behind which the recording was not ended: it was killed, or the file is cut.
    pub fn is_cut(&self) -> bool {
        matches!(&self.order, Order::Linear(linear) if linear.is_cut)
    }

    /// The next message: by its time where the recording has its index, else in the order of the file; none at the end, also
    /// where a recording without an index was cut.
    ///
    /// # Errors
    /// When the file is broken there, or cannot be read.
    pub fn next_message(&mut self) -> Result<Option<Recorded>, RecordingError> {
        let limit = self.limit;
        let fault = |source| RecordingError::Mcap { source, limit };
        loop {
            let next = match &mut self.order {
                Order::Indexed(reader) => match reader.next_event() {
                    None => return Ok(None),
                    Some(Err(error)) => return Err(fault(error)),
                    Some(Ok(IndexedReadEvent::ReadChunkRequest { offset, length })) => {
                        let end = offset.saturating_add(length as u64);
                        if end > self.size {
                            return Err(fault(McapError::UnexpectedEof));
                        }
                        self.source.seek(SeekFrom::Start(offset))?;
                        self.chunk.resize(length, 0);
                        self.source.read_exact(&mut self.chunk)?;
                        reader.insert_chunk_record_data(offset, &self.chunk).map_err(fault)?;
                        continue;
                    }
                    Some(Ok(IndexedReadEvent::Message { header, data })) => {
                        (header.channel_id, header.log_time, data.to_vec())
                    }
                },
                Order::Linear(linear) => match linear.reader.next_event() {
                    None => return Ok(None),
                    Some(Err(McapError::UnexpectedEof)) => {
                        if linear.go_on(&mut self.source, self.size, limit)? {
                            continue;
                        }
                        return Ok(None);
                    }
                    Some(Err(error)) => return Err(fault(error)),
                    Some(Ok(LinearReadEvent::ReadRequest(wanted))) => {
                        linear.feed(&mut self.source, wanted)?;
                        continue;
                    }
                    Some(Ok(LinearReadEvent::Record { opcode, data })) => {
                        let record = mcap::parse_record(opcode, data).map_err(fault)?;
                        match record {
                            Record::Message { header, data } => {
                                (header.channel_id, header.log_time, data.into_owned())
                            }
                            Record::Schema { header, data } => {
                                let text = String::from_utf8_lossy(&data).into_owned();
                                self.schemas
                                    .insert(header.id, (header.name, header.encoding, text));
                                continue;
                            }
                            Record::Channel(channel) => {
                                let schema = self.schemas.get(&channel.schema_id).cloned();
                                let topic = topic(
                                    channel.topic,
                                    channel.message_encoding,
                                    &channel.metadata,
                                    schema,
                                );
                                add(&mut self.topics, &mut self.channels, channel.id, topic);
                                continue;
                            }
                            _ => continue,
                        }
                    }
                },
            };
            let (channel, time_ns, cdr) = next;
            // A channel that is not defined has messages that nobody can read.
            if let Some(topic) = self.channels.get(&channel) {
                return Ok(Some(Recorded { topic: *topic, time_ns, cdr }));
            }
        }
    }

    fn take_summary(&mut self, summary: &Summary) {
        let counts = summary.stats.as_ref().map(|stats| &stats.channel_message_counts);
        let ordered: BTreeMap<_, _> = summary.channels.iter().collect();
        for (id, channel) in ordered {
            let schema = channel.schema.as_ref().map(|schema| {
                let text = String::from_utf8_lossy(&schema.data).into_owned();
                (schema.name.clone(), schema.encoding.clone(), text)
            });
            let (name, encoding) = (channel.topic.clone(), channel.message_encoding.clone());
            let mut topic = topic(name, encoding, &channel.metadata, schema);
            topic.messages = counts.map(|counts| counts.get(id).copied().unwrap_or(0));
            add(&mut self.topics, &mut self.channels, *id, topic);
        }
    }
}

fn add(
    topics: &mut Vec<RecordedTopic>,
    channels: &mut BTreeMap<u16, usize>,
    id: u16,
    topic: RecordedTopic,
) {
    let is_same = |one: &RecordedTopic| {
        (&one.name, &one.type_name, &one.encoding)
            == (&topic.name, &topic.type_name, &topic.encoding)
    };
    let place = topics.iter().position(is_same);
    channels.insert(id, place.unwrap_or(topics.len()));
    match place.and_then(|place| topics.get_mut(place)) {
        // Several channels of one topic: each was a publisher of its own.
        Some(known) => {
            let counts = known.messages.zip(topic.messages);
            known.messages = counts.map(|(one, other)| one.saturating_add(other));
            for qos in topic.qos {
                if !known.qos.contains(&qos) {
                    known.qos.push(qos);
                }
            }
        }
        None => topics.push(topic),
    }
}

fn topic(
    name: String,
    encoding: String,
    metadata: &BTreeMap<String, String>,
    schema: Option<(String, String, String)>,
) -> RecordedTopic {
    let (type_name, definition_encoding, definition) = schema.unwrap_or_default();
    let qos =
        metadata.get("offered_qos_profiles").map(|text| qos::parsed(text)).unwrap_or_default();
    RecordedTopic {
        name,
        type_name,
        encoding,
        definition_encoding,
        definition,
        qos,
        messages: None,
    }
}

/// The summary of a file; none where it has none, as after a recording that was killed.
fn summary<R: Read + Seek>(
    source: &mut R,
    size: u64,
    limit: usize,
) -> Result<Option<Summary>, RecordingError> {
    let options = SummaryReaderOptions::default().with_file_size(size);
    let mut reader = SummaryReader::new_with_options(options.with_record_length_limit(limit));
    while let Some(event) = reader.next_event() {
        match event.map_err(|source| RecordingError::Mcap { source, limit })? {
            SummaryReadEvent::ReadRequest(wanted) => {
                let count = source.read(reader.insert(wanted))?;
                reader.notify_read(count);
            }
            SummaryReadEvent::SeekRequest(to) => reader.notify_seeked(source.seek(to)?),
        }
    }
    Ok(reader.finish())
}

#[cfg(test)]
mod tests {
    use std::io::{Cursor, Write};
    use std::sync::{Arc, Mutex};

    use wrapyfi_interfaces::store::TypeStore;

    use super::super::{Compression, Topic, Writer};
    use super::*;

    /// A file that is there when its writer has gone.
    #[derive(Clone, Default)]
    struct Kept(Arc<Mutex<Cursor<Vec<u8>>>>);

    impl Write for Kept {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.0.lock().unwrap().write(bytes)
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    impl Seek for Kept {
        fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
            self.0.lock().unwrap().seek(to)
        }
    }

    /// A recording of five messages, three of them flushed, whose process was killed.
    fn killed(compression: Compression) -> Vec<u8> {
        let (file, text) = (Kept::default(), TypeStore::generated());
        let text = { text }.resolve_name("std_msgs/msg/String").unwrap();
        let mut out = Writer::new(file.clone(), compression).unwrap();
        let topic = out.add_topic(&Topic::of("/a", &text, vec![Qos::default()])).unwrap();
        for time in 0..5 {
            out.write(topic, time, time, b"\0\x01\0\0\x03\0\0\0hi\0").unwrap();
            if time == 2 {
                out.flush().unwrap();
            }
        }
        std::mem::forget(out);
        file.0.lock().unwrap().get_ref().clone()
    }

    fn times(bytes: Vec<u8>) -> (Vec<u64>, bool) {
        let mut reader = Reader::open(Cursor::new(bytes), 1 << 20).unwrap();
        let mut times = Vec::new();
        while let Some(message) = reader.next_message().unwrap() {
            assert_eq!(reader.topics()[message.topic].name, "/a");
            times.push(message.time_ns);
        }
        (times, reader.is_cut())
    }

    #[test]
    fn a_recording_that_was_killed_has_what_is_whole() {
        assert_eq!(times(killed(Compression::None)), (vec![0, 1, 2, 3, 4], true));
        // What is packed is whole with its chunk.
        for compression in [Compression::Zstd, Compression::Lz4] {
            assert_eq!(times(killed(compression)), (vec![0, 1, 2], true), "{compression:?}");
        }
        for cut in 1..40 {
            let mut bytes = killed(Compression::None);
            bytes.truncate(bytes.len() - cut);
            let (times, is_cut) = times(bytes);
            assert!(times.len() >= 3 && is_cut, "{cut}: {times:?}");
        }
    }
}
