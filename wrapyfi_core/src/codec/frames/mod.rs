//! Wrapyfi's ZeroMQ messages: topic, header, body.
//!
//! ```text
//!   NativeObject  │ topic │ JSON                   │
//!   Properties    │ topic │ JSON of a dict         │
//!   ROS message   │ topic │ JSON of its fields     │
//!   Image         │ topic │ {timestamp:1795…} │ JSON array, or JPEG file   │
//!   AudioChunk    │ topic │ {timestamp:1795…} │ JSON (chunk, channels, rate, array) │
//! ```
//!
//! Which of them it is, only the topic's settings say. The topic frame itself is checked by
//! whoever subscribed: nothing here looks at it.

mod audio;
mod header;
mod image;

use bytes::Bytes;

use super::convert::{ConvertError, convert_payload, properties};
use super::{DecodeError, EncodeError, json};
use crate::endpoint::TopicSpec;
use crate::types::{DataType, Payload, Stamp};

/// Reads a message whose frame 0 is the topic. `received` stands in for a time stamp that is
/// missing or cannot be read.
///
/// # Errors
/// When the frames are no message of `spec`'s type or exceed its limits.
pub fn decode(frames: &[Bytes], spec: &TopicSpec, received: Stamp) -> Result<Payload, DecodeError> {
    let size: usize = frames.iter().map(Bytes::len).sum();
    if size > spec.limits.message_bytes {
        return Err(DecodeError::TooLarge {
            what: "message",
            path: "$".into(),
            actual: size as u64,
            limit: spec.limits.message_bytes as u64,
        });
    }
    match (spec.message_type.data_type(), frames) {
        (DataType::NativeObject, [_, body]) => {
            json::decode_with(body, &spec.limits, &spec.plugins).map(Payload::from)
        }
        (DataType::Properties, [_, body]) => {
            let value = json::decode_with(body, &spec.limits, &spec.plugins)?;
            Ok(properties(&value)?.into())
        }
        (DataType::RosMessage, [_, body]) => {
            let value = json::decode_with(body, &spec.limits, &spec.plugins)?;
            as_decoded(convert_payload(
                value.into(),
                spec.message_type,
                spec.color_order,
                &spec.limits,
                || received,
            ))
        }
        (DataType::Image, [_, header, body]) => {
            image::decode(body, header::stamp(header).unwrap_or(received), spec).map(Payload::Image)
        }
        (DataType::AudioChunk, [_, header, body]) => {
            audio::decode(body, header::stamp(header).unwrap_or(received), &spec.limits)
                .map(Payload::AudioChunk)
        }
        (data_type, _) => {
            let wanted = match data_type {
                DataType::NativeObject | DataType::Properties | DataType::RosMessage => 2,
                DataType::Image | DataType::AudioChunk => 3,
            };
            Err(DecodeError::Mismatch {
                expected: format!("{data_type} in {wanted} frames"),
                actual: format!("{} frames of {size} bytes together", frames.len()),
            })
        }
    }
}

/// A payload made of what came: an object that is no message of the type is the sender's fault.
fn as_decoded(converted: Result<Payload, ConvertError>) -> Result<Payload, DecodeError> {
    converted.map_err(|error| match error {
        ConvertError::From(error) => error,
        ConvertError::To(error) => {
            DecodeError::Mismatch { expected: "a message".to_owned(), actual: error.to_string() }
        }
    })
}

/// Writes a message as Wrapyfi reads it; frame 0 is the topic. Images are compressed or
/// decompressed to what the type carries, because Wrapyfi's listeners read one form only.
///
/// # Errors
/// When `payload` is not of `spec`'s type, has no form there, or exceeds the message size.
pub fn encode(payload: &Payload, spec: &TopicSpec) -> Result<Vec<Vec<u8>>, EncodeError> {
    let wanted = spec.message_type.data_type();
    let topic = spec.topic.as_bytes().to_vec();
    let frames = match (wanted, payload) {
        (DataType::NativeObject, Payload::NativeObject(value)) => {
            vec![topic, json::encode_with(value, &spec.plugins)?]
        }
        (DataType::Properties, Payload::Properties(properties)) => {
            vec![topic, json::encode_with(&properties.to_value(), &spec.plugins)?]
        }
        (DataType::RosMessage, Payload::RosMessage(message)) => {
            let value = message.to_value(spec.limits.message_bytes);
            let value = value.map_err(|error| EncodeError::Unrepresentable {
                format: "JSON",
                what: format!("a malformed {}: {error}", message.ros_type),
                path: "$".to_owned(),
                remedy: "look at its publisher".to_owned(),
            })?;
            vec![topic, json::encode_with(&value, &spec.plugins)?]
        }
        (DataType::Image, Payload::Image(image)) => {
            vec![topic, header::write(image.stamp), image::encode(image, spec)?]
        }
        (DataType::AudioChunk, Payload::AudioChunk(sound)) => {
            vec![topic, header::write(sound.stamp), audio::encode(sound)?]
        }
        _ => {
            return Err(EncodeError::Mismatch {
                expected: wanted.to_string(),
                actual: payload.data_type().to_string(),
            });
        }
    };
    let size: usize = frames.iter().map(Vec::len).sum();
    if size > spec.limits.message_bytes {
        return Err(EncodeError::TooLarge {
            actual: size as u64,
            limit: spec.limits.message_bytes as u64,
        });
    }
    Ok(frames)
}

#[cfg(test)]
mod tests;
