//! Wrapyfi's ZeroMQ messages.

use bytes::Bytes;

use super::{DecodeError, EncodeError};
use crate::endpoint::TopicSpec;
use crate::types::{Payload, Stamp, Value};

/// Reads a message; `frames[0]` is the topic and is not looked at.
pub fn decode(
    _frames: &[Bytes],
    _spec: &TopicSpec,
    _received: Stamp,
) -> Result<Payload, DecodeError> {
    Ok(Value::Null.into())
}

/// Writes a message; frame 0 is the topic.
pub fn encode(_payload: &Payload, _spec: &TopicSpec) -> Result<Vec<Vec<u8>>, EncodeError> {
    Ok(Vec::new())
}
