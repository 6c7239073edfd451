//! The reader: records in the order of the file, and what it does where one is broken.
//!
//! ```text
//!   next ─▶ record of the chunk, else of the file ─▶ message: given      connection: kept
//!             │ broken                               chunk: entered      index: passed over
//!             ▼
//!           noted ─▶ end of the chunk, where a record stands there, else the next bytes that look like a chunk
//! ```

use std::collections::BTreeMap;
use std::io::{self, Read, Seek};

use super::ahead::{Ahead, Packed};
use super::chunk::{Chunk, Compression, Unpacked};
use super::connection::Connection;
use super::error::{Damage, Fault, OpenError, ReadError};
use super::input::{Input, Stop, check_magic};
use super::record::{Header, op};

/// Largest header of a record: that of a connection has the name of a topic.
const MAX_HEADER: u32 = 64 * 1024;
/// Largest data of a connection: its definition, and the names around it.
const MAX_CONNECTION: u32 = 4 << 20;
/// Most connections of a bag.
const MAX_CONNECTIONS: usize = 65_536;
/// The field `op` of a chunk's header, with its size.
const CHUNK_OP: &[u8] = b"\x04\0\0\0op=\x05";
/// Largest distance of that field from the begin of the header that has it: `compression=none` and `size` before it.
const MOST_BEFORE_OP: usize = 96;
/// Largest name of a compression that is told.
const MAX_NAME: usize = 32;
/// Bytes that are searched at once.
const SEARCHED: usize = 1 << 20;

/// Limits of what a bag may have memory be taken for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Largest message in bytes. A larger one is passed over.
    pub message_bytes: usize,
    /// Largest size in bytes that a packed chunk may claim to unpack to. One that claims more is passed over.
    pub chunk_bytes: u64,
}

impl Default for Limits {
    /// 256 MiB for a message, 1 GiB for a packed chunk.
    fn default() -> Self {
        Self { message_bytes: 256 << 20, chunk_bytes: 1 << 30 }
    }
}

/// A message of a bag.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Message<'b> {
    /// Number of the connection.
    pub connection: u32,
    /// Time at which it was received, in nanoseconds since 1970.
    pub time_ns: u64,
    /// The message, as ROS 1 serialises it.
    pub data: &'b [u8],
}

/// A bag that is open.
///
/// ```
/// use std::io::Cursor;
/// use wrapyfi_bag::ros1::{BagReader, Limits};
/// // A bag whose recording ended before anything came.
/// let header = b"\x04\0\0\0op=\x03\x12\0\0\0index_pos=\0\0\0\0\0\0\0\0";
/// let mut bag = b"#ROSBAG V2.0\n".to_vec();
/// bag.extend((header.len() as u32).to_le_bytes());
/// bag.extend(header);
/// bag.extend([0; 4]);
/// let mut reader = BagReader::open(Cursor::new(bag), Limits::default()).unwrap();
/// assert!(!reader.is_indexed());
/// assert_eq!(reader.next_message().unwrap(), None);
/// assert!(reader.damage().is_none());
/// ```
#[derive(Debug)]
pub struct BagReader<R> {
    input: Input<R>,
    limits: Limits,
    chunk: Option<Chunk>,
    connections: BTreeMap<u32, Connection>,
    damage: Damage,
    /// Messages that the index knows; none without an index.
    indexed_messages: Option<u64>,
    /// Packed chunks that reading has not come to yet.
    ahead: Ahead,
    /// Memory of headers and of messages, used again and again.
    header: Vec<u8>,
    body: Vec<u8>,
    /// Bytes of `body` that are the last message.
    message_size: usize,
}

/// Outcome of one record.
enum Step {
    Message { connection: u32, time_ns: u64, size: usize },
    Other,
    End,
}

impl<R: Read + Seek> BagReader<R> {
    /// Opens a bag, and looks for its connections in its index.
    ///
    /// # Errors
    /// When it is no bag of format 2.0, is encrypted, or cannot be read. Damage is no error.
    pub fn open(source: R, limits: Limits) -> Result<Self, OpenError> {
        let mut input = Input::new(source)?;
        check_magic(&mut input)?;
        let mut reader = Self {
            input,
            limits,
            chunk: None,
            connections: BTreeMap::new(),
            damage: Damage::default(),
            indexed_messages: None,
            ahead: Ahead::new(),
            header: Vec::new(),
            body: Vec::new(),
            message_size: 0,
        };
        let begin = reader.input.at();
        let bag_header = reader.bag_header();
        let begin = match &bag_header {
            Ok(_) => reader.input.at(),
            // Where that is broken, too, the next chunk is looked for as everywhere.
            Err(_) => begin,
        };
        match bag_header {
            Ok((_, Some(encryptor))) => return Err(OpenError::Encrypted { encryptor }),
            Ok((index_at, None)) if index_at > begin && index_at < reader.input.size() => {
                reader.indexed_messages = match reader.index(index_at) {
                    Ok(messages) => Some(messages),
                    Err(Stop::Fault(_)) => None,
                    Err(Stop::Io(error)) => return Err(error.into()),
                };
            }
            // Where something stands behind it, that fault is met again.
            Err(Stop::Fault(fault)) if begin == reader.input.size() => {
                reader.damage.note(begin, fault);
            }
            Ok(_) | Err(Stop::Fault(_)) => {}
            Err(Stop::Io(error)) => return Err(error.into()),
        }
        reader.input.go_to(begin)?;
        Ok(reader)
    }

    /// Connections that are known: those of the index, and those that were met since.
    pub fn connections(&self) -> &BTreeMap<u32, Connection> {
        &self.connections
    }

    /// True where the bag has an index that can be read.
    pub fn is_indexed(&self) -> bool {
        self.indexed_messages.is_some()
    }

    /// Messages that the bag has by its index; none where it has none that can be read.
    pub fn indexed_messages(&self) -> Option<u64> {
        self.indexed_messages
    }

    /// Places that could not be read so far.
    pub fn damage(&self) -> &Damage {
        &self.damage
    }

    /// Offset in the file that reading has come to, and the size of the file.
    pub fn position(&self) -> (u64, u64) {
        (self.input.at(), self.input.size())
    }

    /// The next message in the order of the file; none at its end.
    ///
    /// # Errors
    /// When the system refuses to read. Damage is passed over, and noted.
    pub fn next_message(&mut self) -> Result<Option<Message<'_>>, ReadError> {
        let (connection, time_ns, size) = loop {
            let at = self.chunk.as_ref().filter(|chunk| chunk.unpacked.is_some());
            let at = at.map_or_else(|| self.input.at(), |chunk| chunk.begin);
            let step = self.step();
            let io = |source| ReadError { at, source };
            match step {
                Ok(Step::Message { connection, time_ns, size }) => {
                    break (connection, time_ns, size);
                }
                Ok(Step::Other) => {}
                Ok(Step::End) => return Ok(None),
                Err(Stop::Io(source)) => return Err(io(source)),
                Err(Stop::Fault(fault)) => {
                    self.damage.note(at, fault);
                    self.go_on_behind(at).map_err(io)?;
                }
            }
        };
        self.message_size = size;
        Ok(Some(Message { connection, time_ns, data: self.message() }))
    }

    /// Bytes of the message that was given last.
    pub fn message(&self) -> &[u8] {
        self.body.get(..self.message_size).unwrap_or_default()
    }

    /// Offset of the index, and the name of an encryption.
    fn bag_header(&mut self) -> Result<(u64, Option<String>), Stop> {
        self.read_header()?;
        let header = Header::parse(&self.header)?;
        if header.op != op::BAG_HEADER {
            return Err(Fault::Header("the first record is not that of the bag").into());
        }
        let encryptor = header.encryptor.filter(|name| !name.is_empty());
        let encryptor = encryptor.map(|name| String::from_utf8_lossy(name).into_owned());
        let index_at = header.index_at.unwrap_or_default();
        let size = self.data_size()?;
        self.skip(u64::from(size))?;
        Ok((index_at, encryptor))
    }

    /// Reads connections and counts of the index, which is the rest of the file.
    fn index(&mut self, at: u64) -> Result<u64, Stop> {
        self.input.go_to(at)?;
        let mut messages = 0_u64;
        while self.input.left() > 0 {
            self.read_header()?;
            let header = Header::parse(&self.header)?;
            let (kind, count) = (header.op, header.count);
            match kind {
                op::CONNECTION => self.connection()?,
                op::CHUNK_INFO => {
                    let size = self.data_size()?;
                    // A number and a count for each connection.
                    if count.and_then(|count| count.checked_mul(8)) != Some(size) {
                        return Err(Fault::Header("counts of a chunk are broken").into());
                    }
                    for _ in 0..size / 8 {
                        let mut pair = [0; 8];
                        self.input.fill(&mut pair)?;
                        let (_, counted) = pair.split_at(4);
                        let counted = counted.try_into().map_or(0, u32::from_le_bytes);
                        messages = messages.saturating_add(u64::from(counted));
                    }
                }
                _ => return Err(Fault::Header("a record of another kind is in the index").into()),
            }
        }
        Ok(messages)
    }

    /// Reads one record of the chunk, else of the file.
    fn step(&mut self) -> Result<Step, Stop> {
        match &mut self.chunk {
            Some(chunk) if chunk.left == 0 => {
                let ended = chunk.check_end();
                self.leave_chunk()?;
                ended?;
                return Ok(Step::Other);
            }
            None if self.input.left() == 0 => return Ok(Step::End),
            _ => {}
        }
        self.read_header()?;
        let header = Header::parse(&self.header)?;
        let within = self.chunk.is_some();
        match header.op {
            op::MESSAGE => {
                let (Some(connection), Some(time_ns)) = (header.connection, header.time_ns) else {
                    return Err(Fault::Header("a message has no connection or no time").into());
                };
                self.read_message(connection, time_ns)
            }
            op::CONNECTION => self.connection().map(|()| Step::Other),
            op::CHUNK if !within => self.enter_chunk().map(|()| Step::Other),
            op::INDEX | op::CHUNK_INFO | op::BAG_HEADER if !within => {
                let size = self.data_size()?;
                self.skip(u64::from(size))?;
                Ok(Step::Other)
            }
            _ => Err(Fault::Header("a record is in a place where none of its kind belongs").into()),
        }
    }

    fn read_message(&mut self, connection: u32, time_ns: u64) -> Result<Step, Stop> {
        let claimed = self.data_size()?;
        let size = usize::try_from(claimed).unwrap_or(usize::MAX);
        let claimed = u64::from(claimed);
        self.check_left(claimed)?;
        let known = self.connections.contains_key(&connection);
        if size > self.limits.message_bytes || !known {
            let at = self.chunk.as_ref().map_or_else(|| self.input.at(), |chunk| chunk.begin);
            self.skip(claimed)?;
            let limit = self.limits.message_bytes as u64;
            let fault = match known {
                true => Fault::MessageSize { claimed, limit },
                false => Fault::NoConnection(connection),
            };
            self.damage.note(at, fault);
            return Ok(Step::Other);
        }
        if self.body.len() < size {
            self.body.resize(size, 0);
        }
        let Self { body, chunk, input, .. } = self;
        let into = body.get_mut(..size).unwrap_or_default();
        match chunk {
            Some(chunk) => chunk.fill(input, into)?,
            None => input.fill(into)?,
        }
        Ok(Step::Message { connection, time_ns, size })
    }

    /// Reads the rest of a connection, whose header has been read. The first one of a number counts.
    fn connection(&mut self) -> Result<(), Stop> {
        let header = Header::parse(&self.header)?;
        let (Some(id), Some(topic)) = (header.connection, header.topic) else {
            return Err(Fault::Header("a connection has no number or no topic").into());
        };
        let topic = String::from_utf8_lossy(topic).into_owned();
        let size = self.data_size()?;
        if size > MAX_CONNECTION {
            let (claimed, limit) = (u64::from(size), u64::from(MAX_CONNECTION));
            return Err(Fault::HeaderSize { claimed, limit }.into());
        }
        self.check_left(u64::from(size))?;
        let mut data = vec![0; usize::try_from(size).unwrap_or_default()];
        self.fill(&mut data)?;
        if self.connections.contains_key(&id) {
            return Ok(());
        }
        let read = match self.connections.len() {
            0..MAX_CONNECTIONS => Connection::read(id, topic, &data),
            _ => Err(Fault::TooManyConnections { limit: MAX_CONNECTIONS }),
        };
        match read {
            Ok(connection) => _ = self.connections.insert(id, connection),
            // The record ends where it says: what comes behind it can be read.
            Err(fault) => self.damage.note(self.input.at(), fault),
        }
        Ok(())
    }

    /// Begins the chunk whose header has been read.
    fn enter_chunk(&mut self) -> Result<(), Stop> {
        let header = Header::parse(&self.header)?;
        let (Some(compression), Some(claimed)) = (header.compression, header.size) else {
            return Err(Fault::Header("a chunk does not say how it is packed").into());
        };
        let name = compression.get(..MAX_NAME).unwrap_or(compression).to_vec();
        let claimed = u64::from(claimed);
        let limit = self.limits.chunk_bytes;
        let size = u64::from(self.data_size()?);
        let begin = self.input.at();
        let packed = Compression::named(&name);
        let (size, claimed) = match packed {
            // The recording was killed before it wrote the sizes: its records are in the rest of the file. Those of a chunk
            // that is not packed are read as records of the file.
            Some(_) if (size, claimed) == (0, 0) => (self.input.left().min(limit), limit),
            _ => (size, claimed),
        };
        let end = begin.saturating_add(size);
        let (left, unpacked) = match packed {
            None if name == b"none" => (size, None),
            None => {
                let name = String::from_utf8_lossy(&name).into_owned();
                self.input.go_to(end)?;
                self.damage.note(begin, Fault::Compression(name));
                return Ok(());
            }
            Some(_) if claimed.max(size) > limit => {
                self.input.go_to(end)?;
                self.damage.note(begin, Fault::ChunkSize { packed: size, claimed, limit });
                return Ok(());
            }
            Some(compression) => {
                let chunk = Packed { begin, size, claimed };
                let ahead = match compression {
                    Compression::Bz2 => self.ahead.take(&chunk),
                    Compression::Lz4 => None,
                };
                let unpacked = match ahead {
                    Some(unpacked) => unpacked,
                    // What is missing at the end of the file shows where the unpacked bytes end.
                    None => Unpacked::new(compression, self.packed(size.min(self.input.left()))?),
                };
                self.input.go_to(end)?;
                if compression == Compression::Bz2 {
                    self.look_ahead(end)?;
                }
                (claimed, Some(unpacked))
            }
        };
        self.chunk = Some(Chunk { begin, end, claimed, left, unpacked });
        Ok(())
    }

    /// Has chunks behind `end`, where the file stands, unpacked, if some more are wanted.
    fn look_ahead(&mut self, end: u64) -> io::Result<()> {
        let Some(from) = self.ahead.wants_from(end) else { return Ok(()) };
        // A fault there is met again when reading comes to it.
        if self.give_ahead(from).is_err() {
            self.ahead.stop_at(self.input.at());
        }
        self.input.go_to(end)
    }

    /// Reads the next bytes of the file into memory of a chunk.
    fn packed(&mut self, size: u64) -> Result<Vec<u8>, Stop> {
        let mut packed = self.ahead.memory();
        packed.resize(usize::try_from(size).unwrap_or_default(), 0);
        self.input.fill(&mut packed)?;
        Ok(packed)
    }

    /// Has the chunks from an offset on unpacked, up to the first record that is neither one packed by bz2 nor its index.
    fn give_ahead(&mut self, from: u64) -> Result<(), Stop> {
        self.input.go_to(from)?;
        loop {
            let at = self.input.at();
            self.read_header_of_file()?;
            let header = Header::parse(&self.header)?;
            let is_bz2 = header.compression.and_then(Compression::named) == Some(Compression::Bz2);
            let (op, claimed) = (header.op, header.size.filter(|_| is_bz2));
            let size = u64::from(self.data_size()?);
            self.check_left(size)?;
            let begin = self.input.at();
            match (op, claimed) {
                (op::INDEX, _) => self.skip(size)?,
                (op::CHUNK, Some(claimed)) => {
                    let chunk = Packed { begin, size, claimed: u64::from(claimed) };
                    if !self.ahead.takes(&chunk) || chunk.claimed > self.limits.chunk_bytes {
                        return Ok(());
                    }
                    let packed = self.packed(size)?;
                    if !self.ahead.give(chunk, packed) {
                        return Ok(());
                    }
                }
                _ => {
                    self.ahead.stop_at(at);
                    return Ok(());
                }
            }
        }
    }

    /// Goes behind the chunk. Where no record stands behind a packed one, its size was a lie, and the next chunk may begin within
    /// what it claims to be.
    fn leave_chunk(&mut self) -> Result<(), Stop> {
        let Some(chunk) = self.chunk.take() else { return Ok(()) };
        let Some(unpacked) = chunk.unpacked else { return Ok(self.input.go_to(chunk.end)?) };
        self.ahead.keep(unpacked.into_memory());
        if !self.stands_record_at(chunk.end)? {
            self.damage.note(chunk.end, Fault::Header("no record stands behind a chunk"));
            let found = self.next_chunk(chunk.begin)?;
            self.skipped(chunk.end, found);
            self.input.go_to(found)?;
        }
        Ok(())
    }

    /// Goes on behind a fault in the record at `at`: where the chunk ends, if a record stands there; else where the next
    /// chunk begins.
    fn go_on_behind(&mut self, at: u64) -> io::Result<()> {
        // A fault at the very end of a chunk has left it already.
        if self.chunk.is_none() && self.input.at() > at && self.stands_record_at(self.input.at())? {
            return Ok(());
        }
        let mut from = at.saturating_add(1);
        if let Some(chunk) = self.chunk.take() {
            from = at.max(chunk.begin);
            if let Some(unpacked) = chunk.unpacked {
                self.ahead.keep(unpacked.into_memory());
            }
            if chunk.end <= self.input.size() && self.stands_record_at(chunk.end)? {
                self.skipped(at, chunk.end);
                return self.input.go_to(chunk.end);
            }
        }
        let found = self.next_chunk(from)?;
        self.skipped(at, found);
        self.input.go_to(found)
    }

    /// Counts the bytes between two offsets.
    fn skipped(&mut self, from: u64, to: u64) {
        let skipped = to.saturating_sub(from);
        self.damage.skipped_bytes = self.damage.skipped_bytes.saturating_add(skipped);
    }

    /// True where the header of a record, or the end of the file, stands at an offset. The position moves.
    fn stands_record_at(&mut self, at: u64) -> io::Result<bool> {
        self.input.go_to(at)?;
        if self.input.left() == 0 {
            return Ok(at == self.input.size());
        }
        let read = self.read_header_of_file();
        let parsed = read.and_then(|()| Ok(Header::parse(&self.header)?)).map(drop);
        self.input.go_to(at)?;
        match parsed {
            Ok(()) => Ok(true),
            Err(Stop::Fault(_)) => Ok(false),
            Err(Stop::Io(error)) => Err(error),
        }
    }

    /// Offset from `from` on at which a chunk begins, or the end of the file.
    fn next_chunk(&mut self, from: u64) -> io::Result<u64> {
        let mut window = vec![0; SEARCHED];
        let mut begin = from;
        loop {
            self.input.go_to(begin)?;
            let count = self.input.read_some(&mut window)?;
            let found = window.get(..count).unwrap_or_default();
            let places = found.windows(CHUNK_OP.len()).enumerate();
            for place in places.filter(|(_, it)| *it == CHUNK_OP).map(|(place, _)| place) {
                let heads = (4..=MOST_BEFORE_OP).filter_map(|before| place.checked_sub(before));
                let is_head =
                    |head: &usize| is_chunk_header(found.get(*head..).unwrap_or_default());
                if let Some(head) = heads.into_iter().find(is_head) {
                    return Ok(begin.saturating_add(head as u64));
                }
            }
            if count < SEARCHED {
                return Ok(self.input.size());
            }
            // A header may stand across the end of what was searched.
            begin = begin.saturating_add((SEARCHED - 2 * MOST_BEFORE_OP) as u64);
        }
    }

    /// Reads the next header into memory, from the chunk, else from the file.
    fn read_header(&mut self) -> Result<(), Stop> {
        if self.chunk.is_none() {
            return self.read_header_of_file();
        }
        let mut size = [0; 4];
        self.fill(&mut size)?;
        let size = checked_header_size(size)?;
        self.check_left(size as u64)?;
        let mut header = std::mem::take(&mut self.header);
        header.resize(size, 0);
        let filled = self.fill(&mut header);
        self.header = header;
        filled
    }

    fn read_header_of_file(&mut self) -> Result<(), Stop> {
        let mut size = [0; 4];
        self.input.fill(&mut size)?;
        let size = checked_header_size(size)?;
        self.header.resize(size, 0);
        self.input.fill(&mut self.header)
    }

    /// Reads the size of the data behind a header.
    fn data_size(&mut self) -> Result<u32, Stop> {
        let mut size = [0; 4];
        self.fill(&mut size)?;
        Ok(u32::from_le_bytes(size))
    }

    fn fill(&mut self, into: &mut [u8]) -> Result<(), Stop> {
        match &mut self.chunk {
            Some(chunk) => chunk.fill(&mut self.input, into),
            None => self.input.fill(into),
        }
    }

    fn skip(&mut self, count: u64) -> Result<(), Stop> {
        if let Some(chunk) = &mut self.chunk {
            return chunk.skip(&mut self.input, count);
        }
        self.check_left(count)?;
        Ok(self.input.go_to(self.input.at().saturating_add(count))?)
    }

    /// Refuses a size that the chunk, or the file, has not.
    fn check_left(&self, size: u64) -> Result<(), Fault> {
        let in_file = self.input.left();
        let left = match &self.chunk {
            None => in_file,
            Some(chunk) if chunk.unpacked.is_some() => chunk.left,
            Some(chunk) => chunk.left.min(in_file),
        };
        match size.checked_sub(left) {
            Some(missing @ 1..) => Err(Fault::Short { missing }),
            _ => Ok(()),
        }
    }
}

fn checked_header_size(size: [u8; 4]) -> Result<usize, Fault> {
    let size = u32::from_le_bytes(size);
    if size > MAX_HEADER {
        let (claimed, limit) = (u64::from(size), u64::from(MAX_HEADER));
        return Err(Fault::HeaderSize { claimed, limit });
    }
    Ok(usize::try_from(size).unwrap_or_default())
}

/// True where the bytes begin with the header of a chunk.
fn is_chunk_header(bytes: &[u8]) -> bool {
    let Some((size, rest)) = bytes.split_first_chunk() else { return false };
    let size = usize::try_from(u32::from_le_bytes(*size)).unwrap_or(usize::MAX);
    let header = rest.get(..size).filter(|header| header.len() <= MOST_BEFORE_OP);
    let header = header.and_then(|header| Header::parse(header).ok());
    header.is_some_and(|it| it.op == op::CHUNK && it.compression.is_some() && it.size.is_some())
}
