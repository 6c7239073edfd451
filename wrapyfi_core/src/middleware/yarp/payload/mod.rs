//! Payloads as YARP sends them: bytes of a message to [`Payload`] and back.
//!
//! ```text
//!   NativeObject │ bottle of one JSON string, as Wrapyfi, or any bottle      ◀──▶ Value
//!   Text         │ bottle of one string                                      ◀──▶ Str
//!   Image        │ header and rows; a bottle of base64 of .npy of JPEG       ◀──▶ Image
//!   AudioChunk   │ Sound: planar, 16 bits                                    ◀──▶ AudioChunk
//!   Ros          │ Vector, Matrix, joints, or pairs of field and value       ◀──▶ RosMessage
//!   envelope     │ "42 1700000000.5"                                         ◀──▶ stamp
//! ```
//!
//! The table with examples: `docs/wire/yarp.md`. Nothing here has sockets or a clock. Pixels and the
//! samples of one channel are those of the message, not copies.

mod fault;
mod native;
mod requests;

use bytes::Bytes;
use wrapyfi_yarp::port::{Payload as Bytewise, PayloadKind};
use wrapyfi_yarp::{Dialect, sig};

use super::options::YarpOptions;
use crate::codec::{DecodeError, EncodeError};
use crate::endpoint::TopicSpec;
use crate::types::{DataType, Payload, Stamp};

pub use requests::{decode_reply, decode_request, encode_error, encode_reply, encode_request};

/// A message to write: its bytes, and the time that goes with it.
#[derive(Debug, Clone, PartialEq)]
pub struct Outgoing {
    /// The bytes.
    pub payload: Bytewise,
    /// When it was made, where the payload says so. Its count is 0: whoever writes counts.
    pub stamp: Option<sig::Stamp>,
}

/// Writes `payload` as a message of the topic.
///
/// # Errors
/// When it is not of the topic's type, has no form in YARP, or exceeds the message size.
pub fn encode(
    payload: &Payload,
    spec: &TopicSpec,
    options: &YarpOptions,
    dialect: Dialect,
) -> Result<Outgoing, EncodeError> {
    let wanted = spec.message_type.data_type();
    let (bytes, stamp) = match (wanted, payload) {
        (DataType::NativeObject, Payload::NativeObject(value)) => {
            (native::encode(value, spec, options, dialect)?, None)
        }
        _ => {
            return Err(EncodeError::Mismatch {
                expected: wanted.to_string(),
                actual: payload.data_type().to_string(),
            });
        }
    };
    fault::check_size(bytes.len(), spec.limits.message_bytes)?;
    let stamp = stamp.filter(|stamp| *stamp != Stamp::default());
    let stamp = stamp.map(|stamp: Stamp| sig::Stamp { count: 0, time_s: stamp.as_secs_f64() });
    Ok(Outgoing { payload: Bytewise::object(bytes), stamp })
}

/// Reads a message of the topic. `stamp` is that of its envelope; `now` stands in where there is
/// none.
///
/// # Errors
/// When the bytes are no message of the topic's type, or exceed its limits.
pub fn decode(
    received: &Bytewise,
    stamp: Option<sig::Stamp>,
    spec: &TopicSpec,
    options: &YarpOptions,
    dialect: Dialect,
    now: Stamp,
) -> Result<Payload, DecodeError> {
    let bytes: &Bytes = &received.bytes;
    fault::check_received(bytes.len(), spec.limits.message_bytes)?;
    let _stamp = time(stamp).unwrap_or(now);
    match (spec.message_type.data_type(), received.kind) {
        (DataType::NativeObject, PayloadKind::Bottle) => {
            native::decode(bytes, spec, options, dialect).map(Payload::from)
        }
        (wanted, _) => Err(DecodeError::Mismatch {
            expected: wanted.to_string(),
            actual: format!("a message of {} bytes", bytes.len()),
        }),
    }
}

/// The time of an envelope; none where no clock could have shown it.
fn time(stamp: Option<sig::Stamp>) -> Option<Stamp> {
    let time = Stamp::from_secs_f64(stamp?.time_s);
    (time != Stamp::default()).then_some(time)
}
