//! Bytes to values.

use bytes::Bytes;

use super::primitive::{ByteOrder, CdrPrimitive};
use super::{CdrError, ENCAPSULATION_SIZE};
use crate::Message;

/// Reads the members of a message in order. Errors carry no path yet: whoever knows the field's
/// name adds it with [`CdrError::in_field`].
#[derive(Debug)]
pub struct CdrReader<'a> {
    cdr: &'a Bytes,
    /// Offset from the first byte of the encapsulation header; never beyond the end.
    position: usize,
    order: ByteOrder,
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
                return Err(CdrError::Encapsulation { found });
            }
        };
        Ok(Self { cdr, position: ENCAPSULATION_SIZE, order })
    }

    /// Bytes that are left.
    #[must_use]
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

    /// Reads a fixed number of primitives.
    ///
    /// # Errors
    /// When the message ends before the last.
    pub fn read_primitive_array<T: CdrPrimitive, const N: usize>(
        &mut self,
    ) -> Result<[T; N], CdrError> {
        self.align(T::SIZE)?;
        let values: Vec<T> = {
            let bytes = self.take(N.saturating_mul(T::SIZE))?;
            T::extract(bytes, self.order).collect()
        };
        into_array(values)
    }

    /// Reads a sequence of primitives in one bulk copy.
    ///
    /// # Errors
    /// When the message has fewer bytes than the sequence claims.
    pub fn read_primitive_sequence<T: CdrPrimitive>(&mut self) -> Result<Vec<T>, CdrError> {
        let count = self.read_count(T::SIZE)?;
        if count == 0 {
            return Ok(Vec::new()); // without elements there is no padding either
        }
        self.read_primitives(count)
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

    /// Reads a sequence of bytes without a copy: the result shares the message's memory.
    ///
    /// # Errors
    /// When the message has fewer bytes than the sequence claims.
    pub fn read_bytes(&mut self) -> Result<Bytes, CdrError> {
        let count = self.read_count(1)?;
        self.read_byte_array(count)
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
    /// middlewares have it.
    ///
    /// # Errors
    /// When it is too long, unterminated or not UTF-8.
    pub fn read_string(&mut self) -> Result<String, CdrError> {
        let text = self.take_text()?;
        std::str::from_utf8(text).map(str::to_owned).map_err(|error| CdrError::NotUtf8 {
            path: String::new(),
            valid_up_to: error.valid_up_to(),
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

    /// Reads a wide string: UTF-16 code units in four bytes each, without a terminator.
    ///
    /// # Errors
    /// When it is too long or not UTF-16.
    pub fn read_wstring(&mut self) -> Result<String, CdrError> {
        let count = self.read_count(size_of::<u32>())?;
        let bytes = self.take(count.saturating_mul(size_of::<u32>()))?;
        // A unit beyond 16 bits becomes a lone surrogate, which is refused like any other.
        let units =
            u32::extract(bytes, self.order).map(|unit| u16::try_from(unit).unwrap_or(0xD800));
        let mut text = String::with_capacity(count);
        let mut index = 0;
        for c in char::decode_utf16(units) {
            let c = c.map_err(|_lone| CdrError::NotUtf16 { path: String::new(), index })?;
            index += c.len_utf16();
            text.push(c);
        }
        Ok(text)
    }

    fn take_text(&mut self) -> Result<&'a [u8], CdrError> {
        let length = self.read_count(1)?;
        let bytes = self.take(length)?;
        match bytes.split_last() {
            None => Ok(bytes),
            // The search is fast; splitting is not, and hardly ever needed.
            Some((0, text)) if !text.contains(&0) => Ok(text),
            Some((0, text)) => Ok(text.split(|byte| *byte == 0).next().unwrap_or_default()),
            Some((last, _)) => {
                Err(CdrError::Unterminated { path: String::new(), length, last: *last })
            }
        }
    }

    /// Reads a sequence of strings.
    ///
    /// # Errors
    /// As [`CdrReader::read_string`], for any of them.
    pub fn read_strings(&mut self) -> Result<Vec<String>, CdrError> {
        let count = self.read_count(size_of::<u32>())?;
        self.read_each(count, Self::read_string)
    }

    /// Reads a fixed number of strings.
    ///
    /// # Errors
    /// As [`CdrReader::read_string`], for any of them.
    pub fn read_string_array<const N: usize>(&mut self) -> Result<[String; N], CdrError> {
        self.room_for(N, size_of::<u32>())?;
        self.read_each(N, Self::read_string).and_then(into_array)
    }

    /// Reads a nested message.
    ///
    /// # Errors
    /// When one of its members cannot be read.
    pub fn read_message<M: Message>(&mut self) -> Result<M, CdrError> {
        M::read(self)
    }

    /// Reads a sequence of messages.
    ///
    /// # Errors
    /// When there is no room for as many as claimed, or one cannot be read.
    pub fn read_messages<M: Message>(&mut self) -> Result<Vec<M>, CdrError> {
        let count = self.read_count(M::MIN_SIZE)?;
        self.read_each(count, M::read)
    }

    /// Reads a fixed number of messages.
    ///
    /// # Errors
    /// When one cannot be read.
    pub fn read_message_array<M: Message, const N: usize>(&mut self) -> Result<[M; N], CdrError> {
        self.room_for(N, M::MIN_SIZE)?;
        self.read_each(N, M::read).and_then(into_array)
    }

    fn read_each<T>(
        &mut self,
        count: usize,
        read: impl Fn(&mut Self) -> Result<T, CdrError>,
    ) -> Result<Vec<T>, CdrError> {
        let mut values = Vec::with_capacity(count);
        for index in 0..count {
            values.push(read(self).map_err(|error| error.in_element(index))?);
        }
        Ok(values)
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

    /// Skips to a multiple of `size`, counted from the body's start.
    fn align(&mut self, size: usize) -> Result<(), CdrError> {
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

fn into_array<T, const N: usize>(values: Vec<T>) -> Result<[T; N], CdrError> {
    <[T; N]>::try_from(values).map_err(|values| truncated(N, values.len()))
}
