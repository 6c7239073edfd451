//! Conversations of two Wrapyfi processes over ZeroMQ (`tests/data/zeromq`): every data message
//! decoded, compared with what its sender computed, and written again.

use bytes::Bytes;
use serde_json::{Value as Json, json};
use sha2::{Digest, Sha256};
use wrapyfi_data::types::{
    CompressedFormat, Encoding, Image, MessageType, Payload, Pixels, SampleFormat, Stamp, Value,
};
use wrapyfi_data::{Limits, codec::json};
use wrapyfi_endpoint::TopicSpec;
use wrapyfi_endpoint::codec::convert;
use wrapyfi_zeromq::codec as frames;

const RECEIVED: Stamp = Stamp { sec: 1, nanosec: 2 };

struct Capture {
    messages: Vec<Vec<Bytes>>,
    /// Digests that the sender logged, one for each message.
    sent: Vec<String>,
}

fn capture(name: &str) -> Capture {
    let path = format!("{}/tests/data/pubsub_{name}.json", env!("CARGO_MANIFEST_DIR"));
    let file: Json = serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap();
    let list = |key: &str| file[key].as_array().unwrap().clone();
    let messages: Vec<Vec<Bytes>> = list("frames")
        .iter()
        .zip(list("records"))
        .filter(|(_, record)| record["kind"] == "data")
        .map(|(frames, _)| frames.as_array().unwrap().iter().map(unhex).collect())
        .collect();
    let sent: Vec<String> = list("sender_log")
        .iter()
        .filter_map(|line| line["sha256"].as_str().map(str::to_owned))
        .collect();
    assert_eq!((messages.len(), sent.len()), (3, 3), "{name}");
    Capture { messages, sent }
}

fn unhex(frame: &Json) -> Bytes {
    let digits = frame.as_str().unwrap();
    (0..digits.len())
        .step_by(2)
        .map(|at| u8::from_str_radix(&digits[at..at + 2], 16).unwrap())
        .collect()
}

fn sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Decodes, checks that the topic and what is deterministic are written again as captured, and
/// that the header has the captured time.
fn round_trip(message: &[Bytes], message_type: MessageType) -> Payload {
    let topic = str::from_utf8(&message[0]).unwrap();
    let spec = TopicSpec::new(topic, message_type);
    let payload = frames::decode(message, &spec, RECEIVED).unwrap();
    let written = frames::encode(&payload, &spec).unwrap();
    assert_eq!(written.len(), message.len());
    assert_eq!(written.first().unwrap(), &message[0]);
    assert_eq!(Bytes::from(written.last().unwrap().clone()), message[message.len() - 1]);
    if message.len() == 3 {
        let again: Vec<Bytes> = written.into_iter().map(Bytes::from).collect();
        assert_eq!(frames::decode(&again, &spec, RECEIVED).unwrap(), payload);
        let captured = str::from_utf8(&message[1]).unwrap();
        let captured: f64 =
            captured.trim_start_matches("{timestamp:").trim_end_matches('}').parse().unwrap();
        let stamp = match &payload {
            Payload::Image(image) => image.stamp,
            Payload::AudioChunk(sound) => sound.stamp,
            other => panic!("{other:?}"),
        };
        assert!((stamp.as_secs_f64() - captured).abs() < 1e-6, "{stamp:?} is not {captured}");
    }
    payload
}

/// The picture number `seq` that the senders compute.
fn pixels(seq: usize, height: usize, width: usize, channels: usize) -> Vec<u8> {
    let mut pixels = Vec::new();
    for y in 0..height {
        for x in 0..width {
            for c in 0..channels {
                pixels.push(u8::try_from((7 * y + 3 * x + 11 * c + seq) % 256).unwrap());
            }
        }
    }
    pixels
}

fn raw(payload: &Payload) -> &wrapyfi_data::types::RawPixels {
    match payload {
        Payload::Image(Image { pixels: Pixels::Raw(raw), .. }) => raw,
        other => panic!("{other:?}"),
    }
}

#[test]
fn raw_images() {
    for (name, encoding) in [("image_rgb", Encoding::Bgr8), ("image_mono", Encoding::Mono8)] {
        let capture = capture(name);
        for (seq, message) in capture.messages.iter().enumerate() {
            let payload = round_trip(message, MessageType::Image);
            let raw = raw(&payload);
            assert_eq!((raw.height, raw.width, raw.encoding), (4, 6, encoding));
            assert_eq!(*raw.data, *pixels(seq, 4, 6, encoding.channels()), "{name} {seq}");
            assert_eq!(sha256(&raw.data), capture.sent[seq]);
        }
    }
}

#[test]
fn float_images() {
    let capture = capture("image_fp");
    for (seq, message) in capture.messages.iter().enumerate() {
        let payload = round_trip(message, MessageType::Image);
        let raw = raw(&payload);
        assert_eq!((raw.height, raw.width, raw.encoding), (4, 6, Encoding::F32C3));
        let wanted =
            pixels(seq, 4, 6, 3).into_iter().flat_map(|p| (f32::from(p) / 255.0).to_le_bytes());
        assert_eq!(*raw.data, *wanted.collect::<Vec<u8>>());
        assert_eq!(sha256(&raw.data), capture.sent[seq]);
    }
}

#[test]
fn compressed_images() {
    for (name, encoding) in [("image_jpeg", Encoding::Bgr8), ("image_jpeg_mono", Encoding::Mono8)] {
        let capture = capture(name);
        for (seq, message) in capture.messages.iter().enumerate() {
            let payload = round_trip(message, MessageType::CompressedImage);
            let Payload::Image(image) = payload else { panic!("{payload:?}") };
            let Pixels::Compressed { format: CompressedFormat::Jpeg, data } = &image.pixels else {
                panic!("{image:?}");
            };
            assert_eq!(data, &message[2]);
            let raw =
                convert(image, MessageType::Image, Encoding::Bgr8, &Limits::default()).unwrap();
            let Pixels::Raw(raw) = raw.pixels else { panic!("pixels") };
            assert_eq!((raw.height, raw.width, raw.encoding), (16, 24, encoding));
            // Lossy, and the more so in colour, which is stored at half the resolution.
            let sent = pixels(seq, 16, 24, encoding.channels());
            assert_eq!(sha256(&sent), capture.sent[seq]);
            let tolerance = if encoding == Encoding::Mono8 { 6 } else { 16 };
            let worst = raw.data.iter().zip(&sent).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
            assert!(worst <= tolerance, "{name} {seq}: off by {worst}");
        }
    }
}

#[test]
fn sound() {
    for (name, frames, channels, rate) in
        [("audio_mono", 64, 1, 44_100), ("audio_stereo", 32, 2, 16_000)]
    {
        let capture = capture(name);
        for (seq, message) in capture.messages.iter().enumerate() {
            let payload = round_trip(message, MessageType::AudioChunk);
            let Payload::AudioChunk(chunk) = payload else { panic!("{payload:?}") };
            assert_eq!((chunk.frames, chunk.channels, chunk.sample_rate), (frames, channels, rate));
            assert_eq!(chunk.format, SampleFormat::F32Le);
            let mut wanted = Vec::new();
            for i in 0..usize::try_from(frames).unwrap() {
                for c in 0..usize::from(channels) {
                    let k = u16::try_from((13 * i + 5 * c + seq) % 1000).unwrap();
                    wanted.extend((f32::from(k) / 1000.0 - 0.5).to_le_bytes());
                }
            }
            assert_eq!(*chunk.data, *wanted);
            assert_eq!(sha256(&chunk.data), capture.sent[seq]);
        }
    }
}

#[test]
fn native_objects() {
    for name in ["native_small", "native_rich"] {
        let capture = capture(name);
        for (seq, message) in capture.messages.iter().enumerate() {
            // Wrapyfi does not tag tuples inside tuples, of which there are none here.
            let payload = round_trip(message, MessageType::NativeObject);
            let Payload::NativeObject(value) = payload else { panic!("{payload:?}") };
            assert_eq!(value.get("seq").and_then(Value::as_i64), i64::try_from(seq).ok());
            assert_eq!(sha256(&compact(&description(&value))), capture.sent[seq], "{name} {seq}");
            assert_eq!(
                Bytes::from(json::encode(&value, &wrapyfi_plugins::standard()).unwrap()),
                message[1]
            );
        }
    }
}

/// The description whose digest the senders log.
fn description(value: &Value) -> Json {
    let all = |items: &[Value]| items.iter().map(description).collect::<Vec<_>>();
    match value {
        Value::Null => Json::Null,
        Value::Bool(value) => json!(value),
        Value::Int(value) => json!(value),
        Value::Float(value) => json!(value),
        Value::Str(text) => json!(text),
        Value::List(items) => json!(all(items)),
        Value::Tuple(items) => json!({"@tuple": all(items)}),
        Value::Set(items) => json!({"@set": all(items)}),
        Value::DateTime(when) => json!({"@datetime": when.to_string()}),
        Value::Map(map) => map
            .iter()
            .map(|(key, value)| (key.as_str().unwrap().to_owned(), description(value)))
            .collect(),
        Value::Tensor(tensor) => json!({"@array": {
            "dtype": tensor.dtype().npy_descr(),
            "shape": tensor.shape(),
            "sha256": sha256(tensor.data()),
        }}),
        other => panic!("{other:?}"),
    }
}

/// Sorted, without spaces, in ASCII. serde_json's maps are sorted already.
fn compact(description: &Json) -> Vec<u8> {
    let text = serde_json::to_string(description).unwrap();
    text.chars()
        .map(|c| match c {
            ' '..='~' => c.to_string(),
            _ => c.encode_utf16(&mut [0; 2]).iter().map(|unit| format!("\\u{unit:04x}")).collect(),
        })
        .collect::<String>()
        .into_bytes()
}
