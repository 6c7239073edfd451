//! A payload as one JSON object: what `wrapyfi echo --json` prints a line of.
//!
//! | payload | `sha256` is of | also |
//! | --- | --- | --- |
//! | native object, properties | the text of `value` | `value` |
//! | ROS message | its CDR bytes | `value`, its fields |
//! | image, raw | the rows without padding, in the order received | `shape`, `encoding` |
//! | image, compressed | the file | `format`, `size` |
//! | sound | the samples | `shape`, `dtype`, `sample_rate` |

use serde_json::{Value as Json, json};
use sha2::{Digest, Sha256};
use wrapyfi_core::types::{
    AudioChunk, Image, Payload, Pixels, RawPixels, RosMessage, SampleFormat, Stamp, Value,
};

use crate::canonical::canonical;
use crate::words::words;

/// The payload as one JSON object.
#[must_use]
pub fn describe(payload: &Payload) -> String {
    let object = match payload {
        Payload::NativeObject(value) => return with_value("NativeObject", value),
        Payload::Properties(properties) => return with_value("Properties", &properties.to_value()),
        Payload::RosMessage(message) => return describe_message(message),
        Payload::Image(image) => describe_image(image),
        Payload::AudioChunk(chunk) => describe_audio(chunk),
        _ => json!({ "type": "unknown" }),
    };
    object.to_string()
}

fn with_value(kind: &str, value: &Value) -> String {
    let text = canonical(value);
    let sha256 = digest(text.as_bytes());
    // Written as text: JSON numbers have no bound, `serde_json`'s do.
    format!(r#"{{"type":"{kind}","stamp":null,"sha256":"{sha256}","value":{text}}}"#)
}

fn describe_message(message: &RosMessage) -> String {
    let sha256 = digest(&message.cdr);
    let (kind, value) = (message.ros_type.name(), fields(message));
    format!(r#"{{"type":"{kind}","stamp":null,"sha256":"{sha256}","value":{value}}}"#)
}

/// The fields as JSON, or as a JSON text why they cannot be read.
fn fields(message: &RosMessage) -> String {
    match message.fields(message.cdr.len()) {
        Ok(fields) => fields.to_json().to_string(),
        Err(error) => Json::String(format!("malformed: {error}")).to_string(),
    }
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
        _ => json!({ "type": "Image", "stamp": stamp }),
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
#[must_use]
pub fn summary(payload: &Payload) -> String {
    match payload {
        Payload::NativeObject(value) => words(value),
        Payload::Properties(properties) => words(&properties.to_value()),
        Payload::RosMessage(message) => fields(message),
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
            _ => "image".to_owned(),
        },
        Payload::AudioChunk(chunk) => format!(
            "sound {} frames, {} channels, {} Hz, {:?} at {:.6}",
            chunk.frames,
            chunk.channels,
            chunk.sample_rate,
            chunk.format,
            chunk.stamp.as_secs_f64()
        ),
        _ => "unknown".to_owned(),
    }
}
