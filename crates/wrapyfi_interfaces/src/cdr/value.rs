//! Values that a member of a message may have.

use bytes::Bytes;

use super::{CdrError, CdrPrimitive, CdrReader, CdrWriter};

/// Number, text or message, or an array or sequence of them.
pub trait CdrValue: Sized {
    /// Least number of bytes it takes, without padding.
    const MIN_SIZE: usize;

    /// Writes it behind what was written.
    fn write(&self, writer: &mut CdrWriter);

    /// Reads it.
    ///
    /// # Errors
    /// When it is not there in full, or not valid.
    fn read(reader: &mut CdrReader<'_>) -> Result<Self, CdrError>;

    /// Writes several, one after the other.
    fn write_all(values: &[Self], writer: &mut CdrWriter) {
        values.iter().for_each(|value| value.write(writer));
    }

    /// Reads several, one after the other.
    ///
    /// # Errors
    /// When there is no room for so many, or one cannot be read.
    fn read_all(reader: &mut CdrReader<'_>, count: usize) -> Result<Vec<Self>, CdrError> {
        reader.room_for(count, Self::MIN_SIZE)?;
        let mut values = Vec::with_capacity(count);
        for index in 0..count {
            values.push(Self::read(reader).map_err(|error| error.in_element(index))?);
        }
        Ok(values)
    }
}

/// Several move in one bulk copy.
impl<T: CdrPrimitive> CdrValue for T {
    const MIN_SIZE: usize = T::SIZE;

    fn write(&self, writer: &mut CdrWriter) {
        writer.write_primitive(*self);
    }

    fn read(reader: &mut CdrReader<'_>) -> Result<Self, CdrError> {
        reader.read_primitive()
    }

    fn write_all(values: &[Self], writer: &mut CdrWriter) {
        writer.write_primitive_array(values);
    }

    fn read_all(reader: &mut CdrReader<'_>, count: usize) -> Result<Vec<Self>, CdrError> {
        reader.read_primitives(count)
    }
}

impl CdrValue for String {
    const MIN_SIZE: usize = size_of::<u32>();

    fn write(&self, writer: &mut CdrWriter) {
        writer.write_string(self);
    }

    fn read(reader: &mut CdrReader<'_>) -> Result<Self, CdrError> {
        reader.read_string()
    }
}

/// A `wstring`: text that goes as UTF-16.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct WString(pub String);

impl From<&str> for WString {
    fn from(text: &str) -> Self {
        Self(text.to_owned())
    }
}

impl CdrValue for WString {
    const MIN_SIZE: usize = size_of::<u32>();

    fn write(&self, writer: &mut CdrWriter) {
        writer.write_wstring(&self.0);
    }

    fn read(reader: &mut CdrReader<'_>) -> Result<Self, CdrError> {
        reader.read_wstring().map(Self)
    }
}

/// Sequence of bytes. A large one is shared on the way out, any on the way in.
impl CdrValue for Bytes {
    const MIN_SIZE: usize = size_of::<u32>();

    fn write(&self, writer: &mut CdrWriter) {
        writer.write_bytes(self);
    }

    fn read(reader: &mut CdrReader<'_>) -> Result<Self, CdrError> {
        let count = reader.read_count(1)?;
        reader.read_byte_array(count)
    }
}

/// Sequence.
impl<T: CdrValue> CdrValue for Vec<T> {
    const MIN_SIZE: usize = size_of::<u32>();

    fn write(&self, writer: &mut CdrWriter) {
        let counted = writer.write_count(self);
        T::write_all(counted, writer);
    }

    fn read(reader: &mut CdrReader<'_>) -> Result<Self, CdrError> {
        match reader.read_count(T::MIN_SIZE)? {
            0 => Ok(Self::new()), // without elements there is no padding either
            count => T::read_all(reader, count),
        }
    }
}

impl<T: CdrValue, const N: usize> CdrValue for [T; N] {
    const MIN_SIZE: usize = T::MIN_SIZE.saturating_mul(N);

    fn write(&self, writer: &mut CdrWriter) {
        T::write_all(self, writer);
    }

    fn read(reader: &mut CdrReader<'_>) -> Result<Self, CdrError> {
        Self::try_from(T::read_all(reader, N)?).map_err(|values: Vec<T>| CdrError::Truncated {
            path: String::new(),
            needed: N,
            available: values.len(),
        })
    }
}
