//! Payloads as YARP sends them: bytes of a message to [`Payload`] and back.
//!
//! ```text
//!   NativeObject │ bottle of one JSON string, as Wrapyfi, or any bottle      ◀──▶ Value
//!   Text         │ bottle of one string                                      ◀──▶ Str
//!   Image        │ header and rows; a bottle of base64 of .npy of JPEG       ◀──▶ Image
//!   AudioChunk   │ Sound: planar, 16 bits                                    ◀──▶ AudioChunk
//!   Ros          │ Vector, Matrix, joints, sensors, bases, pairs of field and value ◀──▶ RosMessage
//!   envelope     │ "42 1700000000.5"                                         ◀──▶ stamp
//! ```
//!
//! The table with examples: `docs/reference/wire/yarp.md`. Nothing here has sockets or a clock. Pixels and the
//! samples of one channel are those of the message, not copies.

mod base;
mod camera;
mod clock;
mod command;
mod element;
mod fault;
mod frames;
mod image;
mod joints;
mod laser;
mod native;
mod numbers;
mod outgoing;
mod positional;
mod requests;
mod ros;
mod rules;
mod sensors;
mod sound;
#[cfg(test)]
mod tests;
mod word;

use bytes::Bytes;
use wrapyfi_yarp::port::{PayloadKind, PortPayload as Bytewise};
use wrapyfi_yarp::{Dialect, sig};

use super::intrinsics::CAMERA_INFO;
use super::options::{BottleFormat, YarpOptions};
use outgoing::envelope;
use rules::Rules;
use wrapyfi_data::Limits;
use wrapyfi_data::types::{DataType, MessageType, NativeObject, Payload, Stamp, Value};
use wrapyfi_endpoint::TopicSpec;
use wrapyfi_endpoint::codec::convert::properties;
use wrapyfi_endpoint::codec::{DecodeError, DecodeResult, EncodeError, EncodeResult, check_form};

pub(super) use command::{COMMAND_PORT, of_some_joints, trajectory};
pub(super) use joints::{EXTENDED_PORT, extended_of, floats, texts};
pub(super) use laser::is_scan;
pub use outgoing::Outgoing;
pub(super) use positional::usage;
pub use requests::{
    decode_reply, decode_request, encode_error, encode_reply, encode_request, is_json,
};
pub(super) use ros::{CLOCK, JOINTS, TRAJECTORY, fields};

/// Writes `payload` as a message of the topic.
///
/// # Errors
/// When it is not of the topic's type, has no form in YARP, or exceeds the message size.
pub fn encode(
    payload: &Payload,
    spec: &TopicSpec,
    options: &YarpOptions,
    dialect: Dialect,
) -> EncodeResult<Outgoing> {
    let format = options.bottle.unwrap_or_default();
    let rules = Rules::new(options, dialect, &spec.limits);
    let writer = rules.writer();
    let wanted = spec.message_type.data_type();
    if let (DataType::Image, Payload::Image(image)) = (wanted, payload)
        && options.sends_files()
    {
        let file = image::encode_jpeg(image, spec)?;
        EncodeError::check_size(file.len(), spec.limits.message_bytes)?;
        return Ok(Outgoing { payload: Bytewise::raw(file), stamp: envelope(Some(image.stamp)) });
    }
    check_form(payload, spec.message_type)?;
    let (bytes, stamp) = match (wanted, payload) {
        (DataType::NativeObject, Payload::NativeObject(object)) => {
            let bytes = if spec.message_type == MessageType::Text {
                native::encode_text(object, format, writer)?
            } else {
                native::encode(object, format, &spec.plugins, writer)?
            };
            (bytes, Some(object.stamp))
        }
        (DataType::Properties, Payload::Properties(properties)) => {
            (native::encode(&properties.to_value(), format, &spec.plugins, writer)?, None)
        }
        (DataType::Image, Payload::Image(image)) => {
            (image::encode(image, spec, rules)?, Some(image.stamp))
        }
        (DataType::AudioChunk, Payload::AudioChunk(sound)) => {
            (sound::encode(sound, dialect)?, Some(sound.stamp))
        }
        (DataType::RosMessage, Payload::RosMessage(message))
            if spec.message_type == MessageType::Ros(message.ros_type) =>
        {
            ros::encode(message, spec, rules)?
        }
        _ => {
            return Err(EncodeError::mismatch(
                spec.message_type.to_string(),
                match payload {
                    Payload::RosMessage(message) => format!("a {}", message.ros_type),
                    other => other.data_type().to_string(),
                },
            ));
        }
    };
    EncodeError::check_size(bytes.len(), spec.limits.message_bytes)?;
    Ok(Outgoing { payload: Bytewise::object(bytes), stamp: envelope(stamp) })
}

/// Text form of the bottle that holds a value, as YARP's tools show it; `None` where none does.
pub fn text_form(value: &Value) -> Option<String> {
    let writer = element::Writer { dialect: Dialect::V3, limits: &Limits::default() };
    writer.bottle(value).ok().map(|bottle| bottle.to_text())
}

/// True when messages of this type are calibrations of a camera.
pub(super) fn is_of_camera(message_type: MessageType) -> bool {
    matches!(message_type, MessageType::Ros(ros_type) if ros_type.name() == CAMERA_INFO)
}

/// True when messages of this type are about the joints of a control board.
pub(super) fn is_of_joints(message_type: MessageType) -> bool {
    let MessageType::Ros(ros_type) = message_type else { return false };
    matches!(ros_type.name(), ros::JOINTS | ros::TRAJECTORY)
}

/// Reads a message of the topic. `stamp` is that of its envelope; `now` stands in where there is
/// none. A message that only the other dialect can read is read in that one.
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
) -> DecodeResult<Payload> {
    DecodeError::check_size(received.bytes.len(), spec.limits.message_bytes)?;
    native::in_either(&received.bytes, Rules::new(options, dialect, &spec.limits), |rules| {
        decode_as(received, stamp, spec, rules, now)
    })
}

fn decode_as(
    received: &Bytewise,
    stamp: Option<sig::Stamp>,
    spec: &TopicSpec,
    rules: Rules<'_>,
    now: Stamp,
) -> DecodeResult<Payload> {
    let Rules { options, .. } = rules;
    let bytes: &Bytes = &received.bytes;
    let sent_at = time(stamp);
    let stamp = sent_at.unwrap_or(now);
    let kind = spec.message_type.data_type();
    if kind == DataType::Image {
        let image = image::decode(bytes, received.kind, spec, rules, stamp)?;
        return Ok(image.into());
    }
    if received.kind == PayloadKind::Raw {
        let actual = format!("{} bytes that are no bottle, as carrier mjpeg brings", bytes.len());
        return Err(DecodeError::mismatch(spec.message_type.to_string(), actual));
    }
    match (spec.message_type, kind) {
        (MessageType::Ros(ros_type), _) => {
            ros::decode(bytes, ros_type, spec, rules, stamp).map(Payload::from)
        }
        (_, DataType::AudioChunk) => sound::decode(bytes, rules, stamp).map(Payload::from),
        (message_type, _) => {
            let format = options.bottle.unwrap_or_default();
            let bottle = native::bottle(bytes, rules)?;
            let object = |value| NativeObject {
                stamp: sent_at.unwrap_or_default(),
                frame_id: options.frame_id.clone(),
                value,
            };
            if message_type == MessageType::Text {
                return Ok(object(native::decode_text(&bottle, format)).into());
            }
            let format = if kind == DataType::Properties && format != BottleFormat::Json {
                BottleFormat::Property
            } else {
                format
            };
            let value = native::decode(&bottle, format, &spec.plugins, rules)?;
            match kind {
                DataType::Properties => Ok(properties(&value)?.into()),
                _ => Ok(object(value).into()),
            }
        }
    }
}

/// The time of an envelope; none where no clock could have shown it.
fn time(stamp: Option<sig::Stamp>) -> Option<Stamp> {
    let time = Stamp::from_secs_f64(stamp?.time_s);
    (time != Stamp::default()).then_some(time)
}
