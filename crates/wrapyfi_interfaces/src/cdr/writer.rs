//! Values to bytes.

use bytes::Bytes;

use super::{CdrParts, CdrPrimitive, ENCAPSULATION_SIZE};

/// Byte sequences from this size on are shared instead of copied into the owned piece: below it a
/// copy costs less than one more piece in every scatter write.
const SHARED_FROM: usize = 4096;

/// Bytes of text that can be counted together with the terminator.
const LONGEST_STRING: usize = u32::MAX as usize - 1;

/// Bytes that the first piece has room for: most messages without a long sequence grow into it without a move.
const FIRST_ROOM: usize = 512;

/// Plain CDR, little-endian, no options.
const ENCAPSULATION: [u8; ENCAPSULATION_SIZE] = [0, 1, 0, 0];

/// Writes the members of a message in order, little-endian.
///
/// CDR counts with 32 bits: of a sequence or string beyond 4 GiB only what can be counted is
/// written, so that the bytes stay well-formed.
#[derive(Debug)]
pub struct CdrWriter {
    pieces: Vec<Bytes>,
    /// Bytes in `pieces`.
    finished: usize,
    /// The piece being written.
    tail: Vec<u8>,
    is_ros1: bool,
}

impl CdrWriter {
    /// Starts with the encapsulation header.
    pub fn new() -> Self {
        let mut tail = Vec::with_capacity(FIRST_ROOM);
        tail.extend_from_slice(&ENCAPSULATION);
        Self { pieces: Vec::new(), finished: 0, tail, is_ros1: false }
    }

    /// Starts a message as ROS 1 serialises it; see [`CdrReader::of_ros1`](super::CdrReader::of_ros1).
    pub fn of_ros1() -> Self {
        Self { pieces: Vec::new(), finished: 0, tail: Vec::new(), is_ros1: true }
    }

    /// The message, ready to be sent.
    #[must_use]
    pub fn finish(mut self) -> CdrParts {
        if self.pieces.is_empty() {
            return self.tail.into();
        }
        self.close_tail();
        CdrParts::of(self.pieces)
    }

    /// Writes one number or boolean.
    pub fn write_primitive<T: CdrPrimitive>(&mut self, value: T) {
        self.write_primitive_array(&[value]);
    }

    /// Writes a fixed number of primitives.
    pub fn write_primitive_array<T: CdrPrimitive>(&mut self, values: &[T]) {
        if !values.is_empty() {
            self.align(T::SIZE);
            T::append(values, &mut self.tail);
        }
    }

    /// Writes a sequence of primitives in one bulk copy.
    pub fn write_primitive_sequence<T: CdrPrimitive>(&mut self, values: &[T]) {
        let counted = self.write_count(values);
        self.write_primitive_array(counted);
    }

    /// Writes a sequence of bytes; a large one is shared, not copied.
    pub fn write_bytes(&mut self, bytes: &Bytes) {
        let counted = self.write_count(bytes).len();
        self.append(bytes.slice(..counted));
    }

    /// Writes a fixed number of bytes; a large one is shared, not copied.
    pub fn write_byte_array(&mut self, bytes: &Bytes) {
        self.append(bytes.clone());
    }

    /// Writes a wide string: UTF-16 code units in four bytes each, without a terminator.
    pub fn write_wstring(&mut self, text: &str) {
        let units: Vec<u32> = text.encode_utf16().map(u32::from).collect();
        self.write_primitive_sequence(&units);
    }

    /// Writes a string, in CDR with its terminator. A NUL inside ends it, as in the ROS 2 middlewares.
    pub fn write_string(&mut self, text: &str) {
        let text = text.split('\0').next().unwrap_or_default();
        let text = match text.len() {
            0..=LONGEST_STRING => text,
            // A character has at most four bytes, so one of these ends between two.
            _ => (0..4).find_map(|back| text.get(..LONGEST_STRING - back)).unwrap_or_default(),
        };
        let terminator: &[u8] = if self.is_ros1 { &[] } else { &[0] };
        self.write_primitive(u32::try_from(text.len() + terminator.len()).unwrap_or(u32::MAX));
        self.tail.extend_from_slice(text.as_bytes());
        self.tail.extend_from_slice(terminator);
    }

    /// Writes a string that is at hand as bytes: a large one is shared, not copied. `text` must be
    /// UTF-8 without NUL.
    pub fn write_text(&mut self, text: &Bytes) {
        let text = text.slice(..text.len().min(LONGEST_STRING));
        self.write_primitive(u32::try_from(text.len() + 1).unwrap_or(u32::MAX));
        self.append(text);
        self.tail.push(0);
    }

    /// Writes the number of elements and gives those that were counted.
    pub(crate) fn write_count<'v, T>(&mut self, values: &'v [T]) -> &'v [T] {
        let count = u32::try_from(values.len()).unwrap_or(u32::MAX);
        self.write_primitive(count);
        values.get(..count as usize).unwrap_or(values)
    }

    /// Pads with zeros to a multiple of `size`, counted from the body's start.
    fn align(&mut self, size: usize) {
        if self.is_ros1 {
            return;
        }
        let body = self.finished + self.tail.len() - ENCAPSULATION_SIZE;
        let padding = body.next_multiple_of(size) - body;
        self.tail.resize(self.tail.len() + padding, 0);
    }

    fn append(&mut self, bytes: Bytes) {
        if bytes.len() < SHARED_FROM {
            self.tail.extend_from_slice(&bytes);
        } else {
            self.close_tail();
            self.finished += bytes.len();
            self.pieces.push(bytes);
        }
    }

    fn close_tail(&mut self) {
        if !self.tail.is_empty() {
            self.finished += self.tail.len();
            self.pieces.push(Bytes::from(std::mem::take(&mut self.tail)));
        }
    }
}

impl Default for CdrWriter {
    fn default() -> Self {
        Self::new()
    }
}
