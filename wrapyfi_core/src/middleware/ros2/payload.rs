//! Payloads as CDR: the one place where this middleware meets the codecs.
//!
//! ```text
//!   Payload ─ encode ─▶ pieces ─▶ CdrWriter          CdrReader ─▶ Bytes ─ decode ─▶ Payload
//! ```

use bytes::Bytes;

use crate::types::{MessageType, Payload};
use crate::{DecodeError, EncodeError, Limits};

/// `payload` as a message of `message_type`, in pieces.
pub(super) fn encode(
    payload: &Payload,
    message_type: MessageType,
) -> Result<Vec<Bytes>, EncodeError> {
    _ = payload;
    Err(EncodeError::Unrepresentable {
        format: "CDR",
        what: format!("messages of type {}", message_type.ros_type()),
        path: "$".into(),
        remedy: "this build has no codec for ROS messages".into(),
    })
}

/// The payload of a message of `message_type`.
pub(super) fn decode(
    cdr: &Bytes,
    message_type: MessageType,
    limits: &Limits,
) -> Result<Payload, DecodeError> {
    _ = (cdr, limits);
    Err(DecodeError::Malformed {
        format: "CDR",
        path: "$".into(),
        reason: format!("this build has no codec for {}", message_type.ros_type()),
    })
}

/// REP-2016 hash of a type, where known.
pub(super) fn type_hash(message_type: MessageType) -> Option<String> {
    _ = message_type;
    None
}
