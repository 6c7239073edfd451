//! Payloads as ROS 1 messages.
//!
//! ```text
//!   NativeObject ◀─▶ std_msgs/String, JSON or plain text │ fields │ pixels or samples as they are │
//!   Image        ◀─▶ sensor_msgs/Image, CompressedImage       little-endian, not aligned, a u32 in
//!   AudioChunk   ◀─▶ wrapyfi_ros_interfaces/ROSAudioMessage   front of text and of lists
//! ```
//!
//! The messages are those of Python Wrapyfi on ROS 1, so sound is 32-bit floats under the label of
//! integers on which its listeners insist. Received pixels and samples are parts of the message,
//! not copies.

use bytes::Bytes;
use wrapyfi_interfaces::Message;
use wrapyfi_interfaces::builtin_interfaces::msg::Time;
use wrapyfi_interfaces::cdr::{CdrError, CdrParts, CdrReader, CdrValue, CdrWriter};
use wrapyfi_interfaces::sensor_msgs::msg::{CompressedImage, Image};
use wrapyfi_interfaces::std_msgs::msg::Header;
use wrapyfi_interfaces::wrapyfi_msgs::msg::AudioChunk;

use super::ros::{audio, countable, describe, image, plain};
use super::{DecodeError, DecodeResult, EncodeError, EncodeResult, json};
use crate::Limits;
use crate::plugin::Plugins;
use crate::types::{MessageType, Payload, Value};

/// Name of the format in errors.
const FORMAT: &str = "ROS 1";

/// A type as ROS 1 nodes name it.
///
/// ```
/// use wrapyfi_data::codec::ros1::Ros1Type;
/// use wrapyfi_data::types::MessageType;
/// let image = Ros1Type::of(MessageType::Image).unwrap();
/// assert_eq!(image.name, "sensor_msgs/Image");
/// assert!(image.fits("*") && !image.fits("992ce8a1687cec8c8bd883ec73ca41d1"));
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Ros1Type {
    /// Name, for instance `sensor_msgs/Image`.
    pub name: String,
    /// MD5 of the definition, by which two nodes know that they mean the same; `*` for any.
    pub md5: String,
    /// The definition and those of the types in it.
    pub definition: String,
}

impl Ros1Type {
    /// The type that carries `message_type`; `None` for properties, which are on no topic, and for
    /// types that are known while running.
    pub fn of(message_type: MessageType) -> Option<Self> {
        let (name, md5, definition) = match message_type {
            MessageType::NativeObject | MessageType::StringJson | MessageType::Text => TEXT,
            MessageType::Image => IMAGE,
            MessageType::CompressedImage => FILE,
            MessageType::AudioChunk | MessageType::UpstreamAudio => SOUND,
            MessageType::Properties | MessageType::Ros(_) => return None,
        };
        let mut definition = definition.to_owned();
        if definition.starts_with("Header ") || definition.starts_with("std_msgs/Header ") {
            definition.push_str(HEADER);
        }
        Some(Self { name: name.to_owned(), md5: md5.to_owned(), definition })
    }

    /// True where a program that wants `md5` can use it.
    pub fn fits(&self, md5: &str) -> bool {
        md5 == "*" || self.md5 == "*" || self.md5 == md5
    }
}

type Known = (&'static str, &'static str, &'static str);

const TEXT: Known = ("std_msgs/String", "992ce8a1687cec8c8bd883ec73ca41d1", "string data\n");
const IMAGE: Known = (
    "sensor_msgs/Image",
    "060021388200f6f0f447d0fcd9c64743",
    "Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\nuint8[] data\n",
);
const FILE: Known = (
    "sensor_msgs/CompressedImage",
    "8f7a12909da2c9d3332d540a0977563f",
    "Header header\nstring format\nuint8[] data\n",
);
const SOUND: Known = (
    "wrapyfi_ros_interfaces/ROSAudioMessage",
    "b4f9a59da632adf088673f2154727d2f",
    "std_msgs/Header header\nuint32 chunk_size\nuint8 channels\nuint32 sample_rate\nstring encoding\nuint8 is_bigendian\nuint32 bitrate\nstring coding_format\nuint32 step\nuint8[] data\n",
);
const HEADER: &str = "\n================================================================================\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n";

/// Writes `payload` as a message of the type that carries `message_type`, in pieces: fields, and then
/// the bytes of pixels, samples or text as they are. `sequence` is the number of the message where it
/// has a header.
///
/// # Errors
/// When the payload is not of the kind or the form that the type carries, has no JSON form, or exceeds
/// `limits`.
pub fn encode(
    payload: &Payload,
    message_type: MessageType,
    sequence: u32,
    limits: &Limits,
    plugins: &Plugins,
) -> EncodeResult<Vec<Bytes>> {
    let message = match (payload, message_type) {
        (Payload::NativeObject(value), MessageType::NativeObject | MessageType::StringJson) => {
            text(&json::encode(value, plugins)?.into())?
        }
        (Payload::NativeObject(value), MessageType::Text) => {
            text(&Bytes::copy_from_slice(plain(value)?.as_bytes()))?
        }
        (Payload::Image(picture), MessageType::Image) => {
            headed(sequence, image::raw_message(picture)?, |message| &mut message.header)
        }
        (Payload::Image(picture), MessageType::CompressedImage) => {
            headed(sequence, image::file_message(picture)?, |message| &mut message.header)
        }
        (Payload::AudioChunk(sound), MessageType::AudioChunk | MessageType::UpstreamAudio) => {
            headed(sequence, audio::upstream_message(sound)?, |message| &mut message.header)
        }
        _ => {
            let known = Ros1Type::of(message_type).map(|known| known.name);
            let expected = known.unwrap_or_else(|| message_type.to_string());
            return Err(EncodeError::mismatch(expected, describe(payload)));
        }
    };
    EncodeError::check_size(message.len(), limits.message_bytes)?;
    Ok(message.pieces().to_vec())
}

/// Reads a message of the type that carries `message_type`.
///
/// # Errors
/// When the bytes are no such message, exceed `limits`, or contradict themselves.
pub fn decode(
    message: &Bytes,
    message_type: MessageType,
    limits: &Limits,
    plugins: &Plugins,
) -> DecodeResult<Payload> {
    DecodeError::check_size(message.len(), limits.message_bytes)?;
    Ok(match message_type {
        MessageType::NativeObject | MessageType::StringJson => {
            json::decode_or_text(&read_text(message)?, limits, plugins)?.into()
        }
        MessageType::Text => Value::from(read_text::<String>(message)?).into(),
        MessageType::Image => {
            image::decode_raw(read_headed::<Image>(message, |read| &mut read.header)?)?.into()
        }
        MessageType::CompressedImage => {
            image::decode_file(read_headed::<CompressedImage>(message, |it| &mut it.header)?)?
                .into()
        }
        MessageType::AudioChunk | MessageType::UpstreamAudio => {
            audio::decode(read_headed::<AudioChunk>(message, |read| &mut read.header)?)?.into()
        }
        other @ (MessageType::Properties | MessageType::Ros(_)) => {
            return Err(DecodeError::mismatch(
                other.to_string(),
                format!("a message of {} bytes", message.len()),
            ));
        }
    })
}

/// A `std_msgs/String` of this text.
fn text(text: &Bytes) -> EncodeResult<CdrParts> {
    countable("data", text.len())?;
    let mut writer = CdrWriter::of_ros1();
    text.write(&mut writer);
    Ok(writer.finish())
}

/// The text of a `std_msgs/String`.
fn read_text<T: CdrValue>(message: &Bytes) -> DecodeResult<T> {
    let mut reader = CdrReader::of_ros1(message);
    let text = T::read(&mut reader).map_err(|error| error.in_field("data"));
    text.and_then(|text| reader.end().map(|()| text)).map_err(|error| fault(&error))
}

/// A message whose header has a number in ROS 1, and a time before 1970 in ROS 2 only.
fn headed<M: Message>(
    sequence: u32,
    mut message: M,
    header: fn(&mut M) -> &mut Header,
) -> CdrParts {
    let sec = &mut header(&mut message).stamp.sec;
    *sec = (*sec).max(0);
    let mut writer = CdrWriter::of_ros1();
    writer.write_primitive(sequence);
    message.write(&mut writer);
    writer.finish()
}

/// Reads what [`headed`] writes; a time after 2038, which ROS 2 does not have, is none.
fn read_headed<M: Message>(message: &Bytes, header: fn(&mut M) -> &mut Header) -> DecodeResult<M> {
    let read = || -> Result<M, CdrError> {
        let mut reader = CdrReader::of_ros1(message);
        reader.read_primitive::<u32>().map_err(|error| error.in_field("header.seq"))?;
        let read = M::read(&mut reader)?;
        reader.end()?;
        Ok(read)
    };
    let mut read = read().map_err(|error| fault(&error))?;
    let stamp = &mut header(&mut read).stamp;
    if stamp.sec < 0 {
        *stamp = Time::default();
    }
    Ok(read)
}

fn fault(error: &CdrError) -> DecodeError {
    match super::ros::fault(error) {
        DecodeError::Malformed { path, reason, .. } => {
            DecodeError::Malformed { format: FORMAT, path, reason }
        }
        other => other,
    }
}

#[cfg(test)]
mod tests;
