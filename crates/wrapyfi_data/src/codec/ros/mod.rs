//! Payloads as ROS 2 messages.
//!
//! ```text
//!   Payload::Image        ◀──▶ sensor_msgs/msg/Image, CompressedImage
//!   Payload::AudioChunk   ◀──▶ wrapyfi_msgs/msg/AudioChunk, ROS2AudioMessage     ◀──▶ CDR
//!   Payload::NativeObject ◀──▶ wrapyfi_msgs/msg/NativeObject, std_msgs/msg/String
//!   Payload::RosMessage   ──── its own bytes, checked against the definition
//! ```
//!
//! Properties have no message: they are the parameters of a node, behind its services. Pixels, samples
//! and the elements of arrays are shared with the CDR bytes in both directions.
//! Conversions that cost time, such as JPEG, belong to the caller: here a payload of another
//! form is a mismatch.

pub(super) mod audio;
mod function;
pub(super) mod image;
mod native;
mod part;

use bytes::Bytes;
use wrapyfi_interfaces::Message;
use wrapyfi_interfaces::cdr::CdrParts;
use wrapyfi_interfaces::rcl_interfaces::msg::Parameter;
use wrapyfi_interfaces::sensor_msgs::msg::{CompressedImage, Image};
use wrapyfi_interfaces::std_msgs::msg::String as Text;
use wrapyfi_interfaces::wrapyfi_msgs::msg::{AudioChunk, NativeObject};
use wrapyfi_interfaces::wrapyfi_ros2_interfaces::msg::ROS2AudioMessage;

pub use self::function::{decode_reply, encode_reply};
pub(super) use self::native::plain;
pub(super) use self::part::countable;
use self::part::describe_pixels;
pub use self::part::fault;
use super::{DecodeError, DecodeResult, EncodeError, EncodeResult};
use crate::Limits;
use crate::plugin::Plugins;
use crate::types::{MessageType, Payload, RosMessage, Value};

/// Writes `payload` as a message of type `message_type`.
///
/// # Errors
/// When the payload is not of the kind or the form that the type carries, or has no JSON form.
pub fn encode(
    payload: &Payload,
    message_type: MessageType,
    plugins: &Plugins,
) -> EncodeResult<CdrParts> {
    match (payload, message_type) {
        (Payload::Image(picture), MessageType::Image) => Ok(image::raw_message(picture)?.encode()),
        (Payload::Image(picture), MessageType::CompressedImage) => {
            Ok(image::file_message(picture)?.encode())
        }
        (Payload::AudioChunk(sound), MessageType::AudioChunk) => {
            audio::message(sound).map(|message| message.encode())
        }
        (Payload::AudioChunk(sound), MessageType::UpstreamAudio) => {
            audio::upstream_message(sound).map(|message| message.encode())
        }
        (Payload::NativeObject(object), MessageType::NativeObject) => {
            native::message(object, plugins).map(|message| message.encode())
        }
        (Payload::NativeObject(value), MessageType::StringJson) => {
            native::encode_text(value, plugins)
        }
        (Payload::NativeObject(value), MessageType::Text) => native::encode_plain(value),
        (Payload::RosMessage(message), MessageType::Ros(ros_type))
            if message.ros_type == ros_type =>
        {
            Ok(message.cdr.clone())
        }
        _ => Err(EncodeError::mismatch(message_type.ros_type().to_owned(), describe(payload))),
    }
}

/// Reads a message of type `message_type`.
///
/// # Errors
/// When the bytes are no such message, exceed `limits`, or contradict themselves.
pub fn decode(
    cdr: &Bytes,
    message_type: MessageType,
    limits: &Limits,
    plugins: &Plugins,
) -> DecodeResult<Payload> {
    match message_type {
        MessageType::Image => image::decode_raw(read(cdr, limits)?).map(Payload::Image),
        MessageType::CompressedImage => image::decode_file(read(cdr, limits)?).map(Payload::Image),
        MessageType::AudioChunk | MessageType::UpstreamAudio => {
            audio::decode(read(cdr, limits)?).map(Payload::AudioChunk)
        }
        MessageType::NativeObject => {
            native::decode(read(cdr, limits)?, limits, plugins).map(Payload::from)
        }
        MessageType::StringJson => native::decode_text(cdr, limits, plugins).map(Payload::from),
        MessageType::Text => read::<Text>(cdr, limits).map(|text| Value::from(text.data).into()),
        MessageType::Ros(ros_type) => {
            let message = RosMessage::new(ros_type, cdr.clone());
            // Bytes that are no message of the type must not travel on under its name.
            message.check(limits.message_bytes).map_err(|error| fault(&error))?;
            Ok(message.into())
        }
        // Parameters are behind services of their node, on no topic.
        MessageType::Properties => Err(DecodeError::mismatch(
            "the parameters of a node",
            format!("a message of {} bytes", cdr.len()),
        )),
    }
}

/// REP-2016 hash of the type, `RIHS01_…`.
pub fn type_hash(message_type: MessageType) -> &'static str {
    match message_type {
        MessageType::NativeObject => NativeObject::TYPE_HASH,
        MessageType::StringJson | MessageType::Text => Text::TYPE_HASH,
        MessageType::Image => Image::TYPE_HASH,
        MessageType::CompressedImage => CompressedImage::TYPE_HASH,
        MessageType::AudioChunk => AudioChunk::TYPE_HASH,
        MessageType::UpstreamAudio => ROS2AudioMessage::TYPE_HASH,
        MessageType::Properties => Parameter::TYPE_HASH,
        MessageType::Ros(ros_type) => ros_type.type_hash(),
    }
}

fn read<M: Message>(cdr: &Bytes, limits: &Limits) -> DecodeResult<M> {
    M::decode(cdr, limits.message_bytes).map_err(|error| fault(&error))
}

/// Words for a payload's kind, for mismatches.
pub(super) fn describe(payload: &Payload) -> String {
    match payload {
        Payload::Image(image) => describe_pixels(&image.pixels),
        Payload::AudioChunk(sound) => format!("{} sound", sound.format),
        Payload::NativeObject(_) => "a native object".to_owned(),
        Payload::Properties(properties) => format!("{} properties", properties.len()),
        Payload::RosMessage(message) => format!("a {}", message.ros_type),
    }
}

#[cfg(test)]
mod native_tests;
#[cfg(test)]
mod tests;
