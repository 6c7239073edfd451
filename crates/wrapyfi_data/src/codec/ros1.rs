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

use bytes::{BufMut as _, Bytes};
use wrapyfi_interfaces::builtin_interfaces::msg::Time;
use wrapyfi_interfaces::sensor_msgs::msg::{CompressedImage, Image};
use wrapyfi_interfaces::std_msgs::msg::Header;
use wrapyfi_interfaces::wrapyfi_ros2_interfaces::msg::ROS2AudioMessage;

use super::ros::{audio, describe, image};
use super::{DecodeError, DecodeResult, EncodeError, EncodeResult, json};
use crate::Limits;
use crate::plugin::Plugins;
use crate::types::{MessageType, Payload, Value};

/// Name of the format in errors.
const FORMAT: &str = "ROS 1";

/// A type as ROS 1 nodes name it.
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
    #[must_use]
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

    /// True where somebody who wants `md5` can use it.
    #[must_use]
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
    let mut fields = Vec::with_capacity(128);
    let data = match (payload, message_type) {
        (Payload::NativeObject(value), MessageType::NativeObject | MessageType::StringJson) => {
            Bytes::from(json::encode_with(value, plugins)?)
        }
        (Payload::NativeObject(value), MessageType::Text) => match value.as_str() {
            Some(text) => Bytes::copy_from_slice(text.as_bytes()),
            None => {
                let (expected, actual) = ("a text".to_owned(), format!("a {}", value.kind()));
                return Err(EncodeError::mismatch(expected, actual));
            }
        },
        (Payload::Image(picture), MessageType::Image) => {
            let message = image::raw_message(picture)?;
            write_header(&mut fields, sequence, &message.header)?;
            fields.put_u32_le(message.height);
            fields.put_u32_le(message.width);
            write_text(&mut fields, "encoding", &message.encoding)?;
            fields.put_u8(message.is_bigendian);
            fields.put_u32_le(message.step);
            message.data
        }
        (Payload::Image(picture), MessageType::CompressedImage) => {
            let message = image::file_message(picture)?;
            write_header(&mut fields, sequence, &message.header)?;
            write_text(&mut fields, "format", &message.format)?;
            message.data
        }
        (Payload::AudioChunk(sound), MessageType::AudioChunk | MessageType::UpstreamAudio) => {
            let message = audio::upstream_message(sound)?;
            write_header(&mut fields, sequence, &message.header)?;
            fields.put_u32_le(message.chunk_size);
            fields.put_u8(message.channels);
            fields.put_u32_le(message.sample_rate);
            write_text(&mut fields, "encoding", &message.encoding)?;
            fields.put_u8(message.is_bigendian);
            fields.put_u32_le(message.bitrate);
            write_text(&mut fields, "coding_format", &message.coding_format)?;
            fields.put_u32_le(message.step);
            message.data
        }
        _ => {
            let known = Ros1Type::of(message_type).map(|known| known.name);
            let expected = known.unwrap_or_else(|| message_type.to_string());
            return Err(EncodeError::mismatch(expected, describe(payload)));
        }
    };
    fields.put_u32_le(countable("data", data.len())?);
    let size = fields.len().saturating_add(data.len());
    EncodeError::check_size(size, limits.message_bytes)?;
    Ok(vec![Bytes::from(fields), data])
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
    let mut fields = Fields { message, at: 0 };
    let payload = match message_type {
        MessageType::NativeObject | MessageType::StringJson => {
            let text = fields.bytes("data")?;
            fields.end()?;
            return json::decode_or_text(&text, limits, plugins).map(Payload::from);
        }
        MessageType::Text => Value::from(fields.text("data")?).into(),
        MessageType::Image => {
            let read = Image {
                header: fields.header()?,
                height: fields.u32("height")?,
                width: fields.u32("width")?,
                encoding: fields.text("encoding")?,
                is_bigendian: fields.u8("is_bigendian")?,
                step: fields.u32("step")?,
                data: fields.bytes("data")?,
            };
            image::decode_raw(read)?.into()
        }
        MessageType::CompressedImage => {
            let read = CompressedImage {
                header: fields.header()?,
                format: fields.text("format")?,
                data: fields.bytes("data")?,
            };
            image::decode_file(read)?.into()
        }
        MessageType::AudioChunk | MessageType::UpstreamAudio => {
            let read = ROS2AudioMessage {
                header: fields.header()?,
                chunk_size: fields.u32("chunk_size")?,
                channels: fields.u8("channels")?,
                sample_rate: fields.u32("sample_rate")?,
                encoding: fields.text("encoding")?,
                is_bigendian: fields.u8("is_bigendian")?,
                bitrate: fields.u32("bitrate")?,
                coding_format: fields.text("coding_format")?,
                step: fields.u32("step")?,
                data: fields.bytes("data")?,
            };
            audio::decode_upstream(read)?.into()
        }
        other @ (MessageType::Properties | MessageType::Ros(_)) => {
            return Err(DecodeError::mismatch(
                other.to_string(),
                format!("a message of {} bytes", message.len()),
            ));
        }
    };
    fields.end()?;
    Ok(payload)
}

fn write_header(fields: &mut Vec<u8>, sequence: u32, header: &Header) -> EncodeResult<()> {
    fields.put_u32_le(sequence);
    // ROS 1 knows no time before 1970.
    fields.put_u32_le(u32::try_from(header.stamp.sec).unwrap_or(0));
    fields.put_u32_le(header.stamp.nanosec);
    write_text(fields, "header.frame_id", &header.frame_id)
}

fn write_text(fields: &mut Vec<u8>, field: &str, text: &str) -> EncodeResult<()> {
    fields.put_u32_le(countable(field, text.len())?);
    fields.put_slice(text.as_bytes());
    Ok(())
}

fn countable(field: &str, size: usize) -> EncodeResult<u32> {
    u32::try_from(size).map_err(|_e| EncodeError::Unrepresentable {
        format: FORMAT,
        what: format!("{size} bytes in one field"),
        path: format!("$.{field}"),
        remedy: format!("send at most {} bytes at once", u32::MAX),
    })
}

/// The fields of a message, one after the other.
struct Fields<'a> {
    message: &'a Bytes,
    at: usize,
}

impl Fields<'_> {
    fn fault(field: &str, reason: String) -> DecodeError {
        DecodeError::Malformed { format: FORMAT, path: format!("$.{field}"), reason }
    }

    fn take(&mut self, field: &str, size: usize) -> DecodeResult<Bytes> {
        let left = self.message.len() - self.at;
        if size > left {
            let reason = format!("{size} bytes are announced, {left} are left");
            return Err(Self::fault(field, reason));
        }
        let from = self.at;
        self.at += size;
        Ok(self.message.slice(from..self.at))
    }

    fn u8(&mut self, field: &str) -> DecodeResult<u8> {
        Ok(self.take(field, 1)?.first().copied().unwrap_or_default())
    }

    fn u32(&mut self, field: &str) -> DecodeResult<u32> {
        let bytes = self.take(field, 4)?;
        Ok(bytes.first_chunk::<4>().map_or(0, |bytes| u32::from_le_bytes(*bytes)))
    }

    fn bytes(&mut self, field: &str) -> DecodeResult<Bytes> {
        let size = self.u32(field)?;
        self.take(field, usize::try_from(size).unwrap_or(usize::MAX))
    }

    fn text(&mut self, field: &str) -> DecodeResult<String> {
        let bytes = self.bytes(field)?;
        String::from_utf8(bytes.to_vec()).map_err(|error| {
            let at = error.utf8_error().valid_up_to();
            Self::fault(field, format!("the text is no UTF-8 from byte {at} on"))
        })
    }

    fn header(&mut self) -> DecodeResult<Header> {
        let _sequence = self.u32("header.seq")?;
        let sec = self.u32("header.stamp")?;
        let nanosec = self.u32("header.stamp")?;
        let frame_id = self.text("header.frame_id")?;
        // A second that ROS 2 cannot count is as good as none.
        let stamp =
            i32::try_from(sec).map_or_else(|_e| Time::default(), |sec| Time { sec, nanosec });
        Ok(Header { stamp, frame_id })
    }

    fn end(&self) -> DecodeResult<()> {
        let left = self.message.len() - self.at;
        if left > 0 {
            let reason = format!("{left} bytes are left behind the last field");
            return Err(DecodeError::malformed(FORMAT, reason));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
