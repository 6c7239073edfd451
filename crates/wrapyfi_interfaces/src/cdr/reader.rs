//! Bytes to values.

use bytes::Bytes;

use super::primitive::{ByteOrder, CdrPrimitive};
use super::{CdrError, ENCAPSULATION_SIZE};

/// Reads the members of a message in order. Errors carry no path yet: the caller, which knows the field's
/// name, adds it with [`CdrError::in_field`].
#[derive(Debug)]
pub struct CdrReader<'a> {
    cdr: &'a Bytes,
    /// Offset from the first byte of the encapsulation header; never beyond the end.
    position: usize,
    order: ByteOrder,
    is_ros1: bool,
}

impl<'a> CdrReader<'a> {
    /// Starts behind the encapsulation header of `cdr`. Its options are ignored, as ROS 2 does.
    ///
    /// # Errors
    /// When `cdr` is not plain CDR.
    pub fn new(cdr: &'a Bytes) -> Result<Self, CdrError> {
        let order = match **cdr {
            [0, 0, _, _, ..] => ByteOrder::Big,
            [0, 1, _, _, ..] => ByteOrder::Little,
            _ => {
                let found = cdr.iter().take(ENCAPSULATION_SIZE).copied().collect();
                return Err(CdrError::Encapsulation(found));
            }
        };
        Ok(Self { cdr, position: ENCAPSULATION_SIZE, order, is_ros1: false })
    }

    /// [`CdrReader::new`] for a message of at most `max_bytes` bytes.
    ///
    /// # Errors
    /// When `cdr` is larger, or not plain CDR.
    pub fn within(cdr: &'a Bytes, max_bytes: usize) -> Result<Self, CdrError> {
        match cdr.len() {
            actual if actual > max_bytes => Err(CdrError::TooLarge { actual, limit: max_bytes }),
            _ => Self::new(cdr),
        }
    }

    /// Reads a message as ROS 1 serialises it: members in the same order, behind no header, not aligned, and
    /// text without a terminator.
    pub fn of_ros1(message: &'a Bytes) -> Self {
        Self { cdr: message, position: 0, order: ByteOrder::Little, is_ros1: true }
    }

    /// Bytes that are left.
    pub fn remaining(&self) -> usize {
        self.cdr.len() - self.position
    }

    /// Reads one number or boolean.
    ///
    /// # Errors
    /// When the message ends before it.
    pub fn read_primitive<T: CdrPrimitive>(&mut self) -> Result<T, CdrError> {
        self.align(T::SIZE)?;
        let bytes = self.take(T::SIZE)?;
        T::extract(bytes, self.order).next().ok_or_else(|| truncated(T::SIZE, 0))
    }

    /// Reads a number of primitives that is known beforehand, in one bulk copy.
    ///
    /// # Errors
    /// When the message ends before the last.
    pub fn read_primitives<T: CdrPrimitive>(&mut self, count: usize) -> Result<Vec<T>, CdrError> {
        self.align(T::SIZE)?;
        let bytes = self.take(count.saturating_mul(T::SIZE))?;
        Ok(T::extract(bytes, self.order).collect())
    }

    /// Reads a number of bytes that is known beforehand; the result shares the message's memory.
    ///
    /// # Errors
    /// When the message ends before the last.
    pub fn read_byte_array(&mut self, count: usize) -> Result<Bytes, CdrError> {
        let start = self.position;
        self.take(count)?;
        Ok(self.cdr.slice(start..self.position))
    }

    /// Reads a string. A NUL inside ends it, and a length of 0 is an empty string, as the ROS 2
    /// middlewares have it. Nodes in C++ and Python 2 send other bytes than UTF-8, too: they become U+FFFD.
    ///
    /// # Errors
    /// When it is too long or unterminated.
    pub fn read_string(&mut self) -> Result<String, CdrError> {
        // The check of the whole is the fast one.
        self.take_text().map(|text| match str::from_utf8(text) {
            Ok(text) => text.to_owned(),
            Err(_) => String::from_utf8_lossy(text).into_owned(),
        })
    }

    /// Reads a string without a copy, for those who decode it further: the result shares the
    /// message's memory and need not be UTF-8. Otherwise as [`CdrReader::read_string`].
    ///
    /// # Errors
    /// When it is too long or unterminated.
    pub fn read_text(&mut self) -> Result<Bytes, CdrError> {
        self.take_text().map(|text| self.cdr.slice_ref(text))
    }

    /// Reads a wide string: UTF-16 code units in four bytes each, without a terminator. Those that are no UTF-16 become
    /// U+FFFD.
    ///
    /// # Errors
    /// When it is too long.
    pub fn read_wstring(&mut self) -> Result<String, CdrError> {
        let count = self.read_count(size_of::<u32>())?;
        let bytes = self.take(count.saturating_mul(size_of::<u32>()))?;
        // A unit beyond 16 bits becomes a lone surrogate, which is no UTF-16 either.
        let units =
            u32::extract(bytes, self.order).map(|unit| u16::try_from(unit).unwrap_or(0xD800));
        let text = char::decode_utf16(units);
        Ok(text.map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER)).collect())
    }

    fn take_text(&mut self) -> Result<&'a [u8], CdrError> {
        let length = self.read_count(1)?;
        let bytes = self.take(length)?;
        match bytes.split_last() {
            _ if self.is_ros1 => Ok(bytes),
            None => Ok(bytes),
            // The search is fast; splitting is not, and hardly ever needed.
            Some((0, text)) if !text.contains(&0) => Ok(text),
            Some((0, text)) => Ok(text.split(|byte| *byte == 0).next().unwrap_or_default()),
            Some((last, _)) => {
                Err(CdrError::Unterminated { path: String::new(), length, last: *last })
            }
        }
    }

    /// Reads an element count and checks that so many elements of at least `min_size` bytes fit
    /// into what is left, before anyone reserves memory for them.
    pub(crate) fn read_count(&mut self, min_size: usize) -> Result<usize, CdrError> {
        let claimed: u32 = self.read_primitive()?;
        let needed = u64::from(claimed).saturating_mul(min_size as u64);
        let available = self.remaining();
        match usize::try_from(claimed) {
            Ok(count) if needed <= available as u64 => Ok(count),
            _ => Err(CdrError::Length {
                path: String::new(),
                claimed: u64::from(claimed),
                needed,
                available,
            }),
        }
    }

    pub(crate) fn room_for(&self, count: usize, min_size: usize) -> Result<(), CdrError> {
        let needed = count.saturating_mul(min_size);
        let available = self.remaining();
        if needed <= available { Ok(()) } else { Err(truncated(needed, available)) }
    }

    /// Offset of the next byte between two multiples of eight, counted from the body's start.
    pub(crate) fn phase(&self) -> usize {
        (self.position - ENCAPSULATION_SIZE) % 8
    }

    /// Order of the bytes of numbers.
    pub(crate) fn order(&self) -> ByteOrder {
        self.order
    }

    /// Checks that nothing is left behind the last member.
    ///
    /// # Errors
    /// [`CdrError::Trailing`].
    pub fn end(&self) -> Result<(), CdrError> {
        match self.remaining() {
            0 => Ok(()),
            left => Err(CdrError::Trailing(left)),
        }
    }

    /// Skips to a multiple of `size`, counted from the body's start.
    fn align(&mut self, size: usize) -> Result<(), CdrError> {
        if self.is_ros1 {
            return Ok(());
        }
        let past = (self.position - ENCAPSULATION_SIZE) % size;
        if past != 0 {
            self.take(size - past)?;
        }
        Ok(())
    }

    pub(crate) fn take(&mut self, size: usize) -> Result<&'a [u8], CdrError> {
        let end = self.position.saturating_add(size);
        let bytes =
            self.cdr.get(self.position..end).ok_or_else(|| truncated(size, self.remaining()))?;
        self.position = end;
        Ok(bytes)
    }
}

fn truncated(needed: usize, available: usize) -> CdrError {
    CdrError::Truncated { path: String::new(), needed, available }
}
