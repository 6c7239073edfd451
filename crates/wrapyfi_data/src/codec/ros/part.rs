//! Parts that the messages of several types have, and their faults.

use bytes::Bytes;
use wrapyfi_interfaces::builtin_interfaces::msg::Time;
use wrapyfi_interfaces::cdr::CdrError;
use wrapyfi_interfaces::std_msgs::msg::Header;

pub(super) use crate::codec::path::quote;
use crate::codec::{DecodeError, EncodeError, EncodeResult};
use crate::types::{Pixels, ShapeError, Stamp, swap_byte_order};

/// Name of the format in errors.
pub(super) const FORMAT: &str = "CDR";

/// Converts a fault in the bytes of a message to an error of codecs.
pub fn fault(error: &CdrError) -> DecodeError {
    match *error {
        CdrError::TooLarge { actual, limit } => DecodeError::too_large(actual, limit),
        _ => malformed(error.path(), error.to_string()),
    }
}

/// A fault at `path` of the message, empty for the whole of it.
pub(super) fn malformed(path: &str, reason: String) -> DecodeError {
    let path = if path.is_empty() { "$".to_owned() } else { format!("$.{path}") };
    DecodeError::Malformed { format: FORMAT, path, reason }
}

/// The bytes of a message do not fit the fields that describe them.
pub(super) fn misfit(error: &ShapeError) -> DecodeError {
    malformed("data", error.to_string())
}

pub(super) fn header(stamp: Stamp, frame_id: &str) -> Header {
    Header { stamp: Time { sec: stamp.sec, nanosec: stamp.nanosec }, frame_id: frame_id.to_owned() }
}

pub(super) fn stamp(header: &Header) -> Stamp {
    Stamp { sec: header.stamp.sec, nanosec: header.stamp.nanosec }
}

/// The error of encoding fields that contradict each other; they are public.
pub(super) fn contradictory(what: &str, error: &ShapeError, maker: &str) -> EncodeError {
    EncodeError::Unrepresentable {
        format: FORMAT,
        what: format!("a contradictory {what} ({error})"),
        path: "$.data".to_owned(),
        remedy: format!("make it with {maker}"),
    }
}

/// Checks that CDR can count a field of `size` bytes.
pub(in crate::codec) fn countable(field: &str, size: usize) -> EncodeResult<()> {
    if u32::try_from(size).is_ok() {
        return Ok(());
    }
    Err(EncodeError::Unrepresentable {
        format: FORMAT,
        what: format!("{size} bytes in one field"),
        path: format!("$.{field}"),
        remedy: format!("send at most {} bytes at once", u32::MAX),
    })
}

pub(super) fn describe_pixels(pixels: &Pixels) -> String {
    match pixels {
        Pixels::Raw(raw) => format!("a raw {} image", raw.encoding),
        Pixels::Compressed { format, .. } => format!("a {format} image"),
    }
}

/// A little-endian copy of big-endian values of `width` bytes in rows of `step` bytes. Padding at
/// the end of a row has no meaning and may change.
pub(super) fn little_endian(data: &[u8], width: usize, step: usize) -> Bytes {
    let mut data = data.to_vec();
    data.chunks_mut(step.max(1)).for_each(|row| swap_byte_order(row, width));
    Bytes::from(data)
}
