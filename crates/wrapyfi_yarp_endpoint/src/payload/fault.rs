//! Faults of YARP's codecs in the words of ours, and the sizes that hold for both.

use wrapyfi_yarp::bottle::{BottleError, TextError};
use wrapyfi_yarp::sig::{ImageError, SoundError};

use wrapyfi_data::Limits;
use wrapyfi_endpoint::codec::{DecodeError, EncodeError};

/// The limits of a topic, for YARP's codecs.
pub(super) fn limits(limits: &Limits) -> wrapyfi_yarp::Limits {
    wrapyfi_yarp::Limits {
        max_message_bytes: limits.message_bytes,
        max_depth: limits.depth,
        ..wrapyfi_yarp::Limits::default()
    }
}

/// Checks a message that came.
pub(super) fn check_received(bytes: usize, limit: usize) -> Result<(), DecodeError> {
    if bytes > limit {
        return Err(too_large(bytes, limit));
    }
    Ok(())
}

/// Checks a message to send.
pub(super) fn check_size(bytes: usize, limit: usize) -> Result<(), EncodeError> {
    if bytes > limit {
        return Err(EncodeError::TooLarge { actual: bytes as u64, limit: limit as u64 });
    }
    Ok(())
}

fn too_large(actual: usize, limit: usize) -> DecodeError {
    DecodeError::TooLarge {
        what: "message",
        path: "$".to_owned(),
        actual: actual as u64,
        limit: limit as u64,
    }
}

/// Bytes that break the format.
pub(super) fn malformed(format: &'static str, reason: &impl ToString) -> DecodeError {
    DecodeError::Malformed { format, path: "$".to_owned(), reason: reason.to_string() }
}

/// Something else than the endpoint carries.
pub(super) fn mismatch(expected: impl Into<String>, actual: impl Into<String>) -> DecodeError {
    DecodeError::Mismatch { expected: expected.into(), actual: actual.into() }
}

/// Something that a bottle, an image, … cannot hold.
pub(super) fn unwritable(
    format: &'static str,
    what: impl Into<String>,
    path: impl Into<String>,
    remedy: impl Into<String>,
) -> EncodeError {
    EncodeError::Unrepresentable {
        format,
        what: what.into(),
        path: path.into(),
        remedy: remedy.into(),
    }
}

/// A bottle that cannot be read.
pub(super) fn bottle(error: &BottleError) -> DecodeError {
    match *error {
        BottleError::TooLong { length, limit } => too_large(length, limit),
        _ => malformed("bottle", error),
    }
}

/// A text that is no bottle.
pub(super) fn text(error: &TextError) -> EncodeError {
    unwritable("bottle", "this text", "$", error.to_string())
}

/// A bottle that cannot be written.
pub(super) fn encode(error: &wrapyfi_yarp::bottle::EncodeError) -> EncodeError {
    unwritable("bottle", "this value", "$", error.to_string())
}

/// An image that cannot be read.
pub(super) fn image(error: &ImageError) -> DecodeError {
    match *error {
        ImageError::TooLong { length, limit } => too_large(length, limit),
        ImageError::NotAnImage { .. } => mismatch("an image", error.to_string()),
        _ => malformed("image", error),
    }
}

/// A sound that cannot be read.
pub(super) fn sound(error: &SoundError) -> DecodeError {
    match *error {
        SoundError::TooLong { length, limit } => too_large(length, limit),
        SoundError::NotASound { .. } | SoundError::OtherVersion { .. } | SoundError::Bottle => {
            mismatch("a sound", error.to_string())
        }
        _ => malformed("sound", error),
    }
}
