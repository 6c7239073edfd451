//! Parts of every reader: its result, and bytes off the buffer.

/// Result of a reader on the bytes that it has.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Progress<T> {
    /// Something is complete; its bytes are off the buffer.
    Event(T),
    /// Least number of further bytes that are needed, never 0.
    Need(usize),
}

impl<T> Progress<T> {
    pub(crate) fn map<U>(self, make: impl FnOnce(T) -> U) -> Progress<U> {
        match self {
            Self::Event(event) => Progress::Event(make(event)),
            Self::Need(more) => Progress::Need(more),
        }
    }
}

/// The first `count` bytes, off the buffer; `None` when there are fewer.
pub(super) fn take(buffer: &mut bytes::BytesMut, count: usize) -> Option<bytes::BytesMut> {
    (buffer.len() >= count).then(|| buffer.split_to(count))
}

/// The little-endian number at `at`.
pub(super) fn i32_at(bytes: &[u8], at: usize) -> Option<i32> {
    let four = bytes.get(at..at.checked_add(4)?)?;
    Some(i32::from_le_bytes(four.try_into().ok()?))
}
