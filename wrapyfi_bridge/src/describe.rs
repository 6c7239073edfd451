//! A payload as one JSON object: what `wrapyfi echo --json` prints a line of.
//!
//! | payload | `sha256` is of | also |
//! | --- | --- | --- |
//! | native object, properties | the text of `value` | `value` |
//! | ROS message | its CDR bytes | `size`, `value`, its fields |
//! | image, raw | the rows without padding, in the order received | `shape`, `encoding` |
//! | image, compressed | the file | `format`, `size` |
//! | sound | the samples | `shape`, `dtype`, `sample_rate` |

use serde_json::{Value as Json, json};
use sha2::{Digest, Sha256};
use wrapyfi_data::types::{
    AudioChunk, Image, Payload, Pixels, RawPixels, RosMessage, SampleFormat, Stamp, Value,
};
use wrapyfi_interfaces::dynamic::DynamicMessage;

use crate::canonical::canonical;
use crate::words::words;

/// The payload as one JSON object.
pub fn describe(payload: &Payload) -> String {
    let object = match payload {
        Payload::NativeObject(object) => {
            return with_value("NativeObject", object.stamp, &object.value);
        }
        Payload::Properties(properties) => {
            return with_value("Properties", Stamp::default(), &properties.to_value());
        }
        Payload::RosMessage(message) => match message.fields(message.cdr.len()) {
            Ok(fields) => return describe_message(message, &fields),
            Err(error) => json!({"type": message.ros_type.name(), "malformed": error.to_string()}),
        },
        Payload::Image(image) => describe_image(image),
        Payload::AudioChunk(chunk) => describe_audio(chunk),
    };
    object.to_string()
}

fn with_value(kind: &str, stamp: Stamp, value: &Value) -> String {
    let text = canonical(value);
    let (stamp, sha256) = (seconds(stamp), digest(text.as_bytes()));
    // Written as text: JSON numbers have no bound, `serde_json`'s do.
    format!(r#"{{"type":"{kind}","stamp":{stamp},"sha256":"{sha256}","value":{text}}}"#)
}

/// A ROS message with these fields as one JSON object.
pub fn describe_message(message: &RosMessage, fields: &DynamicMessage) -> String {
    let (sha256, size, kind) = (digest(&message.cdr), message.cdr.len(), message.ros_type.name());
    let stamp = seconds(stamp(&fields.to_json()));
    // The message itself keeps the order of its fields; a JSON value would sort them.
    let value = serde_json::to_string(fields).unwrap_or_default();
    format!(
        r#"{{"type":"{kind}","stamp":{stamp},"size":{size},"sha256":"{sha256}","value":{value}}}"#
    )
}

/// The fields as JSON, or as a JSON text why they cannot be read.
fn fields(message: &RosMessage) -> Json {
    match message.fields(message.cdr.len()) {
        Ok(fields) => fields.to_json(),
        Err(error) => Json::String(format!("malformed: {error}")),
    }
}

/// The time of a message: that of its header, or its own.
fn stamp(fields: &Json) -> Stamp {
    let time = fields.get("header").unwrap_or(fields).get("stamp");
    let part = |name| time.and_then(|time| time.get(name)).and_then(Json::as_i64);
    let sec = part("sec").and_then(|sec| i32::try_from(sec).ok());
    let nanosec = part("nanosec").and_then(|nanosec| u32::try_from(nanosec).ok());
    sec.zip(nanosec).map_or_else(Stamp::default, |(sec, nanosec)| Stamp { sec, nanosec })
}

fn describe_image(image: &Image) -> Json {
    let stamp = seconds(image.stamp);
    let frame_id = &image.frame_id;
    match &image.pixels {
        Pixels::Raw(raw) => {
            let channels = raw.encoding.channels();
            let shape = if channels == 1 {
                json!([raw.height, raw.width])
            } else {
                json!([raw.height, raw.width, channels])
            };
            json!({
                "type": "Image",
                "stamp": stamp,
                "frame_id": frame_id,
                "encoding": raw.encoding.name(),
                "shape": shape,
                "size": raw.data.len(),
                "sha256": digest_rows(raw),
            })
        }
        Pixels::Compressed { format, data } => json!({
            "type": "CompressedImage",
            "stamp": stamp,
            "frame_id": frame_id,
            "format": format.name(),
            "size": data.len(),
            "sha256": digest(data),
        }),
    }
}

fn describe_audio(chunk: &AudioChunk) -> Json {
    json!({
        "type": "AudioChunk",
        "stamp": seconds(chunk.stamp),
        "frame_id": chunk.frame_id,
        "shape": [chunk.frames, chunk.channels],
        "dtype": match chunk.format { SampleFormat::S16Le => "<i2", _ => "<f4" },
        "sample_rate": chunk.sample_rate,
        "size": chunk.data.len(),
        "sha256": digest(&chunk.data),
    })
}

fn seconds(stamp: Stamp) -> Json {
    if stamp == Stamp::default() { Json::Null } else { json!(stamp.as_secs_f64()) }
}

/// SHA-256 in hexadecimal.
pub(crate) fn digest(bytes: &[u8]) -> String {
    hex(&Sha256::digest(bytes))
}

fn digest_rows(raw: &RawPixels) -> String {
    let row = raw.width as usize * raw.encoding.bytes_per_pixel();
    let mut hasher = Sha256::new();
    if row > 0 {
        for line in raw.data.chunks(raw.step as usize) {
            hasher.update(line.get(..row).unwrap_or(line));
        }
    }
    hex(&hasher.finalize())
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// The payload in a line or two for people.
pub fn summary(payload: &Payload) -> String {
    match payload {
        Payload::NativeObject(value) => words(value),
        Payload::Properties(properties) => words(&properties.to_value()),
        Payload::RosMessage(message) => fields(message).to_string(),
        Payload::Image(image) => match &image.pixels {
            Pixels::Raw(raw) => format!(
                "image {}x{} {} {} bytes at {:.6}",
                raw.width,
                raw.height,
                raw.encoding.name(),
                raw.data.len(),
                image.stamp.as_secs_f64()
            ),
            Pixels::Compressed { format, data } => format!(
                "image {} {} bytes at {:.6}",
                format.name(),
                data.len(),
                image.stamp.as_secs_f64()
            ),
        },
        Payload::AudioChunk(chunk) => format!(
            "sound {} frames, {} channels, {} Hz, {:?} at {:.6}",
            chunk.frames,
            chunk.channels,
            chunk.sample_rate,
            chunk.format,
            chunk.stamp.as_secs_f64()
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wrapyfi_data::types::{Header, Map, MessageType, NativeObject, Value};
    use wrapyfi_interfaces::store::TypeStore;

    #[test]
    fn every_payload_that_has_a_time_shows_it() {
        let then = Stamp { sec: 5, nanosec: 500_000_000 };
        let object = NativeObject { stamp: then, frame_id: String::new(), value: 1.into() };
        let message = |name: &str, fields: Map| {
            let known = MessageType::resolve(name, &mut TypeStore::generated()).unwrap();
            let MessageType::Ros(ros_type) = known else { panic!("{name}") };
            let header = || Header { stamp: then, frame_id: String::new() };
            RosMessage::from_value_with(ros_type, fields.into(), header, 1 << 20).unwrap().into()
        };
        let time = Map::from([("sec", Value::from(5)), ("nanosec", 500_000_000.into())]);
        let shown = |payload: &Payload| {
            let text: Json = serde_json::from_str(&describe(payload)).unwrap();
            text["stamp"].clone()
        };
        assert_eq!(shown(&object.into()), 5.5);
        assert_eq!(shown(&message("sensor_msgs/msg/JointState", Map::new())), 5.5);
        assert_eq!(shown(&message("std_msgs/msg/Header", Map::from([("stamp", time)]))), 5.5);
        assert_eq!(shown(&message("geometry_msgs/msg/Twist", Map::new())), Json::Null);
        assert_eq!(shown(&Value::from(1).into()), Json::Null);
    }
}
