//! Faults of YARP's codecs in the words of ours, and the sizes that hold for both.

use wrapyfi_yarp::bottle::BottleError;
use wrapyfi_yarp::sig::SigError;

use wrapyfi_data::Limits;
use wrapyfi_endpoint::codec::{DecodeError, EncodeError};

/// The limits of a topic, for YARP's codecs.
pub(super) fn limits(limits: &Limits) -> wrapyfi_yarp::WireLimits {
    wrapyfi_yarp::WireLimits {
        max_message_bytes: limits.message_bytes,
        max_depth: limits.depth,
        ..wrapyfi_yarp::WireLimits::default()
    }
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
        BottleError::TooLong { length, limit } => DecodeError::too_large(length, limit),
        _ => DecodeError::malformed("bottle", error.to_string()),
    }
}

/// A text that is no bottle.
pub(super) fn text(error: &BottleError) -> EncodeError {
    unwritable("bottle", "this text", "$", error.to_string())
}

/// A bottle that cannot be written.
pub(super) fn encode(error: &wrapyfi_yarp::bottle::EncodeError) -> EncodeError {
    unwritable("bottle", "this value", "$", error.to_string())
}

/// An object that cannot be read: `wanted` is `an image` or `a sound`, `format` its name.
pub(super) fn object(wanted: &'static str, format: &'static str, error: &SigError) -> DecodeError {
    match *error {
        SigError::TooLong { length, limit, .. } => DecodeError::too_large(length, limit),
        _ if error.is_mismatch() => DecodeError::mismatch(wanted, error.to_string()),
        _ => DecodeError::malformed(format, error.to_string()),
    }
}
