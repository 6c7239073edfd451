//! Wrapyfi's functions as ROS 1 services: their types, and the bytes of requests and replies.
//!
//! ```text
//!   request   std_msgs/String or `string request`: u32 │ JSON [args, kwargs]
//!   reply     1 │ u32 size │ std_msgs/String, sensor_msgs/Image or ROSAudioMessage
//!             0 │ u32 size │ why there is none
//! ```
//!
//! Two of the three types exist in no package: Python Wrapyfi makes them by hand, with sums of its own.

use bytes::{BufMut as _, Bytes};

use crate::codec::requests;
use crate::codec::{self, ros1};
use crate::endpoint::{Request, ServiceSpec};
use crate::types::{DataType, MessageType, Payload, Pixels, ServiceKind};
use crate::{DecodeError, EncodeError};

/// Longest text of an error, in bytes.
pub(super) const MAX_ERROR_BYTES: usize = 64 * 1024;

/// A type of service as nodes name it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct ServiceType {
    pub(super) name: String,
    pub(super) md5: String,
    pub(super) request: String,
    pub(super) response: String,
}

impl ServiceType {
    /// The type that carries a function.
    pub(super) fn of(kind: ServiceKind) -> Self {
        let (name, md5, request, response) = match kind.data_type() {
            DataType::Image => (
                "wrapyfi_services/ROSImage",
                "f720f2021b4bbbe86b0f93b08906381c",
                "std_msgs/String",
                "sensor_msgs/Image",
            ),
            DataType::AudioChunk => (
                "wrapyfi_ros_interfaces/ROSAudioService",
                "955caa7702ad2185dceb7a0219b1db2f",
                "wrapyfi_ros_interfaces/ROSAudioServiceRequest",
                "wrapyfi_ros_interfaces/ROSAudioServiceResponse",
            ),
            _ => (
                "wrapyfi_services/ROSNativeObject",
                "46a550fd1ca640b396e26ebf988aed7b",
                "std_msgs/String",
                "std_msgs/String",
            ),
        };
        let [name, md5, request, response] = [name, md5, request, response].map(str::to_owned);
        Self { name, md5, request, response }
    }
}

/// The message in a reply.
fn message_type(kind: ServiceKind) -> MessageType {
    match kind.data_type() {
        DataType::Image => MessageType::Image,
        DataType::AudioChunk => MessageType::UpstreamAudio,
        _ => MessageType::StringJson,
    }
}

/// Writes a request: its size, and its text.
pub(super) fn encode_request(request: &Request, spec: &ServiceSpec) -> Result<Bytes, EncodeError> {
    let text = requests::encode_request(request, spec)?;
    let too_large = |size: usize| EncodeError::TooLarge {
        actual: size as u64,
        limit: u64::from(u32::MAX) - 4,
    };
    let size = text.len();
    let whole = size.checked_add(4).and_then(|whole| u32::try_from(whole).ok());
    let whole = whole.ok_or_else(|| too_large(size))?;
    let mut bytes = Vec::with_capacity(size + 8);
    bytes.put_u32_le(whole);
    bytes.put_u32_le(whole - 4);
    bytes.put_slice(&text);
    Ok(bytes.into())
}

/// Reads a request without its size.
pub(super) fn decode_request(body: &Bytes, spec: &ServiceSpec) -> Result<Request, DecodeError> {
    let malformed = |reason: String| DecodeError::Malformed {
        format: "ROS 1",
        path: "$.data".to_owned(),
        reason,
    };
    let Some((size, text)) = body.split_first_chunk::<4>() else {
        return Err(malformed(format!("{} bytes are no request", body.len())));
    };
    let size = u32::from_le_bytes(*size);
    if u32::try_from(text.len()) != Ok(size) {
        return Err(malformed(format!("{size} bytes are announced, {} are there", text.len())));
    }
    requests::decode_request(&body.slice(4..), spec)
}

/// Writes what a function returned.
pub(super) fn encode_reply(
    payload: &Payload,
    spec: &ServiceSpec,
) -> Result<Vec<Bytes>, EncodeError> {
    if payload.data_type() != spec.kind.data_type() {
        return Err(EncodeError::Mismatch {
            expected: spec.kind.data_type().to_string(),
            actual: payload.data_type().to_string(),
        });
    }
    let kind = message_type(spec.kind);
    let payload = super::publication::formed(payload, kind, spec.color_order, &spec.limits)?;
    ros1::encode(&payload, kind, 0, &spec.limits, &spec.plugins)
}

/// Reads what a function returned.
pub(super) fn decode_reply(body: &Bytes, spec: &ServiceSpec) -> Result<Payload, DecodeError> {
    let payload = ros1::decode(body, message_type(spec.kind), &spec.limits, &spec.plugins)?;
    let wants_file = spec.kind.message_type() == MessageType::CompressedImage;
    match payload {
        Payload::Image(image) if wants_file && matches!(image.pixels, Pixels::Raw(_)) => {
            let to = MessageType::CompressedImage;
            codec::convert(image, to, spec.color_order, &spec.limits).map(Payload::Image).map_err(
                |error| DecodeError::Mismatch {
                    expected: spec.kind.to_string(),
                    actual: format!("a picture that has no such form: {error}"),
                },
            )
        }
        other => Ok(other),
    }
}

/// As much of `text` as an error may have.
pub(super) fn shortened(text: &str) -> &str {
    let ends = (0..=MAX_ERROR_BYTES.min(text.len())).rev();
    ends.take(4).find_map(|end| text.get(..end)).unwrap_or_default()
}
