//! A payload as one JSON object: what `wrapyfi echo --json` prints a line of.
//!
//! | payload | `sha256` is of | also |
//! | --- | --- | --- |
//! | native object | the compact JSON of `value`, keys sorted | `value` |
//! | image, raw | the rows without padding, in the order received | `shape`, `encoding` |
//! | image, compressed | the file | `format`, `size` |
//! | sound | the samples | `shape`, `dtype`, `sample_rate` |
//!
//! In `value`, what JSON has no form for is an object with one `@` key: `@tuple`, `@set`,
//! `@datetime`, `@datetime64`, `@array` (dtype, shape, digest of its row-major bytes), `@tagged`.
//! NaN and infinities are the strings Python prints.

use serde_json::{Map, Value as Json, json};
use sha2::{Digest, Sha256};
use wrapyfi_core::types::{
    AudioChunk, Image, Payload, Pixels, RawPixels, SampleFormat, Stamp, Value,
};

/// The payload as one JSON object.
#[must_use]
pub fn describe(payload: &Payload) -> Json {
    match payload {
        Payload::NativeObject(value) => {
            let value = describe_value(value);
            json!({
                "type": "NativeObject",
                "stamp": null,
                "sha256": digest(value.to_string().as_bytes()),
                "value": value,
            })
        }
        Payload::Image(image) => describe_image(image),
        Payload::AudioChunk(chunk) => describe_audio(chunk),
        _ => json!({ "type": "unknown" }),
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

fn describe_value(value: &Value) -> Json {
    let list = |items: &[Value]| Json::Array(items.iter().map(describe_value).collect());
    match value {
        Value::Null => Json::Null,
        Value::Bool(value) => json!(value),
        Value::Int(value) => json!(value),
        // A number that JSON readers would round stays text.
        Value::BigInt(value) => json!({ "@int": value.to_string() }),
        Value::Float(value) if value.is_finite() => json!(value),
        Value::Float(value) if value.is_nan() => json!("NaN"),
        Value::Float(value) => json!(if *value > 0.0 { "Infinity" } else { "-Infinity" }),
        Value::Str(text) => json!(text),
        Value::Utf16(units) => json!({ "@utf16": units }),
        Value::Bytes(bytes) => {
            json!({ "@bytes": { "size": bytes.len(), "sha256": digest(bytes) } })
        }
        Value::List(items) => list(items),
        Value::Tuple(items) => json!({ "@tuple": list(items) }),
        Value::Set(items) => {
            let mut items: Vec<Json> = items.iter().map(describe_value).collect();
            items.sort_by_cached_key(Json::to_string);
            json!({ "@set": items })
        }
        Value::Map(map) => {
            let mut object = Map::new();
            for (key, value) in map.iter() {
                let key = match key {
                    Value::Str(text) => text.clone(),
                    other => describe_value(other).to_string(),
                };
                object.insert(key, describe_value(value));
            }
            Json::Object(object)
        }
        Value::DateTime(at) => json!({ "@datetime": at.to_string() }),
        Value::DateTime64(text) => json!({ "@datetime64": text }),
        Value::Tensor(tensor) => {
            let dtype = tensor.dtype();
            let dtype = dtype.npy_descr().unwrap_or_else(|| dtype.name());
            json!({ "@array": { "dtype": dtype, "shape": tensor.shape(), "sha256": digest(tensor.data()) } })
        }
        Value::Array(array) => json!({
            "@array": { "dtype": array.descr.trim_matches('\''), "shape": array.shape, "sha256": digest(&array.data) }
        }),
        Value::Tagged(tagged) => {
            json!({ "@tagged": { "key": tagged.key, "size": tagged.json.len(), "sha256": digest(&tagged.json) } })
        }
        _ => json!({ "@unknown": null }),
    }
}

fn seconds(stamp: Stamp) -> Json {
    if stamp == Stamp::default() { Json::Null } else { json!(stamp.as_secs_f64()) }
}

fn digest(bytes: &[u8]) -> String {
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
        Payload::NativeObject(value) => describe_value(value).to_string(),
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
