//! Wrapyfi's ZeroMQ messages: topic, header, body.
//!
//! ```text
//!   NativeObject  │ topic │ JSON                   │ {timestamp:1795…, frame_id:"eye"}, where known │
//!   Properties    │ topic │ JSON of a dict         │
//!   ROS message   │ topic │ JSON of its fields     │
//!   Image         │ topic │ {timestamp:1795…} │ JSON array, or JPEG file   │
//!   AudioChunk    │ topic │ {timestamp:1795…} │ JSON (chunk, channels, rate, array) │
//! ```
//!
//! The settings of the topic alone say which of them a message is. The topic frame is not looked at
//! here; the subscriber checks it.

mod audio;
mod header;
mod image;
pub mod mark;

use bytes::Bytes;

use header::FrameHeader;
use wrapyfi_data::codec::convert::properties;
use wrapyfi_data::codec::{DecodeError, EncodeError, check_form, json, message_of};
use wrapyfi_data::types::{AudioChunk, DataType, Image, MessageType, NativeObject, Payload, Stamp};
use wrapyfi_endpoint::TopicSpec;

/// Reads a message whose frame 0 is the topic. `received` stands in for a time stamp that is
/// missing or cannot be read.
///
/// # Errors
/// When the frames are no message of `spec`'s type or exceed its limits.
pub fn decode(frames: &[Bytes], spec: &TopicSpec, received: Stamp) -> Result<Payload, DecodeError> {
    let size: usize = frames.iter().map(Bytes::len).sum();
    DecodeError::check_size(size, spec.limits.message_bytes)?;
    if let (MessageType::Ros(ros_type), [_, body]) = (spec.message_type, frames) {
        let value = json::decode(body, &spec.limits, &spec.plugins)?;
        return Ok(message_of(value.into(), ros_type, &spec.limits, received)?.into());
    }
    match (spec.message_type.data_type(), frames) {
        (DataType::NativeObject, [_, body, header @ ..])
            if header.len() <= 1 && header.iter().all(|header| header::is_one(header)) =>
        {
            let value = json::decode(body, &spec.limits, &spec.plugins)?;
            let FrameHeader { stamp, frame_id, .. } =
                header.first().map(|header| FrameHeader::read(header)).unwrap_or_default();
            Ok(NativeObject { stamp: stamp.unwrap_or_default(), frame_id, value }.into())
        }
        (DataType::Properties, [_, body]) => {
            let value = json::decode(body, &spec.limits, &spec.plugins)?;
            Ok(properties(&value)?.into())
        }
        (DataType::Image, [_, header, body]) => {
            let FrameHeader { stamp, color_order, frame_id } = FrameHeader::read(header);
            let order = color_order.unwrap_or(spec.color_order);
            let image = image::decode(body, stamp.unwrap_or(received), order, spec)?;
            Ok(Image { frame_id, ..image }.into())
        }
        (DataType::AudioChunk, [_, header, body]) => {
            let FrameHeader { stamp, frame_id, .. } = FrameHeader::read(header);
            let sound = audio::decode(body, stamp.unwrap_or(received), spec)?;
            Ok(AudioChunk { frame_id, ..sound }.into())
        }
        (data_type, _) => {
            let wanted = match data_type {
                DataType::NativeObject => "2 frames, or 3 with a header at the end",
                DataType::Properties | DataType::RosMessage => "2 frames",
                DataType::Image | DataType::AudioChunk => "3 frames",
            };
            let looks = frames.last().and_then(|last| looks_like(frames.len(), last));
            let looks = looks.map_or_else(String::new, |kind| format!(", which look like {kind}"));
            Err(DecodeError::mismatch(
                format!("{data_type} in {wanted}"),
                format!("{} frames of {size} bytes together{looks}", frames.len()),
            ))
        }
    }
}

/// Writes a message as Wrapyfi reads it; frame 0 is the topic.
///
/// # Errors
/// When `payload` is not of `spec`'s type, has no form there, or exceeds the message size.
pub fn encode(payload: &Payload, spec: &TopicSpec) -> Result<Vec<Vec<u8>>, EncodeError> {
    let wanted = spec.message_type.data_type();
    let topic = spec.topic.as_bytes().to_vec();
    // Wrapyfi's listeners read one form of a picture only.
    check_form(payload, spec.message_type)?;
    let frames = match (wanted, payload) {
        (DataType::NativeObject, Payload::NativeObject(object)) => {
            let NativeObject { stamp, frame_id, value } = object.as_ref();
            let mut frames = vec![topic, json::encode(value, &spec.plugins)?];
            // Wrapyfi's listeners read no third frame; others may count on two.
            if *stamp != Stamp::default() || !frame_id.is_empty() {
                frames.push(header::write(*stamp, None, frame_id));
            }
            frames
        }
        (DataType::Properties, Payload::Properties(properties)) => {
            vec![topic, json::encode(&properties.to_value(), &spec.plugins)?]
        }
        (DataType::RosMessage, Payload::RosMessage(message)) => {
            let value = message.to_value(spec.limits.message_bytes);
            let value = value.map_err(|error| {
                EncodeError::unrepresentable(
                    "JSON",
                    format!("a malformed {}: {error}", message.ros_type),
                    "look at its publisher",
                )
            })?;
            vec![topic, json::encode(&value, &spec.plugins)?]
        }
        (DataType::Image, Payload::Image(image)) => {
            let (body, color_order) = image::encode(image, spec)?;
            vec![topic, header::write(image.stamp, color_order, &image.frame_id), body]
        }
        (DataType::AudioChunk, Payload::AudioChunk(sound)) => {
            vec![
                topic,
                header::write(sound.stamp, None, &sound.frame_id),
                audio::encode(sound, spec)?,
            ]
        }
        _ => {
            return Err(EncodeError::mismatch(wanted.to_string(), payload.data_type().to_string()));
        }
    };
    let size: usize = frames.iter().map(Vec::len).sum();
    EncodeError::check_size(size, spec.limits.message_bytes)?;
    Ok(frames)
}

/// The type that has `frames` frames, the last of which begins with `body`.
pub fn looks_like(frames: usize, body: &[u8]) -> Option<&'static str> {
    const ARRAY: &[u8] = b"{\"__wrapyfi__\": [\"numpy.ndarray\"";
    const TUPLE: &[u8] = b"{\"__wrapyfi__\": [\"tuple\"";
    match frames {
        2 if matches!(
            body.first(),
            Some(b'{' | b'[' | b'"' | b'-' | b'0'..=b'9' | b'n' | b't' | b'f' | b'N' | b'I')
        ) =>
        {
            Some("NativeObject")
        }
        3 if body.starts_with(&[0xFF, 0xD8, 0xFF]) => Some("CompressedImage"),
        3 if body.starts_with(ARRAY) => Some("Image"),
        3 if body.starts_with(TUPLE) => Some("AudioChunk"),
        // The header behind an object.
        3 if header::is_one(body) => Some("NativeObject"),
        _ => None,
    }
}

#[cfg(test)]
mod tests;
