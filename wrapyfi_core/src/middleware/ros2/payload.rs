//! Payloads as CDR: the one place where this middleware meets the codecs.
//!
//! ```text
//!   Payload ─ convert raw <-> file ─ encode ─▶ pieces ─▶ CdrWriter
//!   CdrReader ─▶ Bytes ─ decode ─▶ Payload
//! ```

use std::borrow::Cow;

use bytes::Bytes;
use wrapyfi_interfaces::cdr::CdrParts;

use crate::codec::{self, ros};
use crate::plugin::Plugins;
use crate::types::{Encoding, MessageType, Payload, Pixels};
use crate::{DecodeError, EncodeError, Limits};

/// `payload` as a message of `message_type`, in pieces. An image of the other form is converted:
/// a file for `CompressedImage`, pixels for `Image`.
pub(super) fn encode(
    payload: &Payload,
    message_type: MessageType,
    color_order: Encoding,
    limits: &Limits,
    plugins: &Plugins,
) -> Result<CdrParts, EncodeError> {
    let payload = match payload {
        Payload::Image(image)
            if matches!(
                (&image.pixels, message_type),
                (Pixels::Raw(_), MessageType::CompressedImage)
                    | (Pixels::Compressed { .. }, MessageType::Image)
            ) =>
        {
            let image = codec::convert(image.clone(), message_type, color_order, limits)?;
            Cow::Owned(Payload::Image(image))
        }
        fits => Cow::Borrowed(fits),
    };
    let parts = ros::encode_with(&payload, message_type, plugins)?;
    if parts.len() > limits.message_bytes {
        let (actual, limit) = (parts.len() as u64, limits.message_bytes as u64);
        return Err(EncodeError::TooLarge { actual, limit });
    }
    Ok(parts)
}

/// The payload of a message of `message_type`.
pub(super) fn decode(
    cdr: &Bytes,
    message_type: MessageType,
    limits: &Limits,
    plugins: &Plugins,
) -> Result<Payload, DecodeError> {
    ros::decode_with(cdr, message_type, limits, plugins)
}

/// REP-2016 hash of a type.
pub(super) fn type_hash(message_type: MessageType) -> String {
    ros::type_hash(message_type).to_owned()
}
