//! JPEG files in a build without feature `jpeg`: none is read, none is written, and the error says so.

use bytes::Bytes;

use super::{DecodeError, DecodeResult, EncodeError};
use crate::Limits;
use crate::types::{Encoding, RawPixels};

/// Refuses any picture.
///
/// # Errors
/// Always: the build has no JPEG.
pub fn encode(pixels: &RawPixels, _quality: u8) -> Result<Bytes, EncodeError> {
    let RawPixels { width, height, encoding, .. } = *pixels;
    Err(EncodeError::unrepresentable(
        "a program built without JPEG",
        format!("a {encoding} image of {width}x{height} as a file"),
        "build it with feature `jpeg`, or use type Image",
    ))
}

/// Refuses any file.
///
/// # Errors
/// Always: the build has no JPEG.
pub fn decode(
    _file: &Bytes,
    _limits: &Limits,
    _color_order: Option<Encoding>,
) -> DecodeResult<RawPixels> {
    Err(DecodeError::mismatch(
        "an image that is no JPEG, or a program built with feature `jpeg`",
        "JPEG",
    ))
}
