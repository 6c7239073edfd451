//! Payloads as CDR.
//!
//! ```text
//!   Payload ─ convert raw <-> file ─ encode ─▶ pieces ─▶ CdrWriter
//! ```

use wrapyfi_interfaces::cdr::CdrParts;

use wrapyfi_data::plugin::Plugins;
use wrapyfi_data::types::{Encoding, MessageType, Payload};
use wrapyfi_data::{EncodeError, EncodeResult, Limits};
use wrapyfi_endpoint::codec::{self, ros};

/// `payload` as a message of `message_type`, in pieces. An image of the other form is converted:
/// a file for `CompressedImage`, pixels for `Image`.
pub(super) fn encode(
    payload: &Payload,
    message_type: MessageType,
    color_order: Encoding,
    limits: &Limits,
    plugins: &Plugins,
) -> EncodeResult<CdrParts> {
    let payload = codec::fitted(payload, message_type, color_order, limits)?;
    let parts = ros::encode_with(&payload, message_type, plugins)?;
    EncodeError::check_size(parts.len(), limits.message_bytes)?;
    Ok(parts)
}
