//! Messages to send: small numbered ones, and one of everything.

use crate::Testbed;
use wrapyfi_data::codec::jpeg;
use wrapyfi_data::types::{
    AudioChunk, CompressedFormat, Dtype, Encoding, Image, Map, MessageType, NumpyArray, Payload,
    Pixels, RawPixels, SampleFormat, Stamp, Tagged, Tensor, Value,
};
use wrapyfi_endpoint::TopicSpec;

/// A time that a double holds exactly: Wrapyfi sends seconds as one.
const WHEN: Stamp = Stamp { sec: 1_795_214_428, nanosec: 500_000_000 };

/// A topic of numbered native objects.
pub(crate) fn text(topic: &str) -> TopicSpec {
    TopicSpec::new(topic, MessageType::StringJson)
}

/// A native object that says which one it is.
pub fn number(n: u64) -> Payload {
    Value::from(Map::from([("n", i64::try_from(n).unwrap())])).into()
}

/// [`number`]s in order.
pub fn numbers(range: std::ops::Range<u64>) -> Vec<Payload> {
    range.map(number).collect()
}

/// Bytes that repeat late, so that a shift or a lost piece shows.
pub fn pattern(bytes: usize) -> Vec<u8> {
    (0..bytes).map(|n| u8::try_from(n % 251).unwrap()).collect()
}

/// A native object with one of everything that Wrapyfi's JSON can write.
pub fn rich() -> Payload {
    let tensors = Dtype::ALL.into_iter().filter(|&dtype| dtype != Dtype::BF16).map(|dtype| {
        // A bool is one byte of 0 or 1.
        let bytes = if dtype == Dtype::Bool { vec![1; 6] } else { pattern(6 * dtype.size()) };
        Value::Tensor(Tensor::new(dtype, [2, 3], bytes).unwrap())
    });
    let structured = NumpyArray::new("[('a', '<i4'), ('b', '<f8')]", 12, [2], pattern(24)).unwrap();
    let json = r#"{"__wrapyfi__": ["ForeignThing", {"kept": [1, 2.50]}]}"#;
    Value::from(Map::from([
        ("none", Value::Null),
        ("bools", Value::List(vec![true.into(), false.into()])),
        ("ints", Value::List(vec![0.into(), i64::MIN.into(), i64::MAX.into()])),
        ("big", Value::BigInt("-123456789012345678901234567890".parse().unwrap())),
        ("floats", Value::List([0.1, -0.0, 1e300, f64::INFINITY].map(Value::from).to_vec())),
        ("text", "h\u{e9}llo \u{1f916} \"quoted\" \\ \n \0".into()),
        ("surrogate", Value::Utf16(vec![0x61, 0xd800, 0x62])),
        ("tuple", Value::Tuple(vec![1.into(), Value::Tuple(vec![]), "x".into()])),
        ("set", Value::Set(vec![1.into(), "two".into()])),
        ("map", Value::from(Map::from([("deep", Map::from([("er", 1)]))]))),
        ("when", Value::DateTime("2024-01-02T03:04:05.678901+05:30".parse().unwrap())),
        ("datetime64", Value::DateTime64("2024-01-02T03:04:05.678".into())),
        ("tensors", tensors.collect::<Vec<_>>().into()),
        ("scalar", Value::Tensor(Tensor::new(Dtype::F64, [], vec![7; 8]).unwrap())),
        ("empty", Value::Tensor(Tensor::new(Dtype::F32, [0, 3], vec![]).unwrap())),
        ("structured", Value::Array(structured)),
        ("foreign", Value::Tagged(Tagged::new("ForeignThing", json))),
    ]))
    .into()
}

/// An uncompressed picture.
pub fn frame(width: u32, height: u32, encoding: Encoding) -> Payload {
    let bytes = width as usize * height as usize * encoding.bytes_per_pixel();
    let raw = RawPixels::dense(width, height, encoding, pattern(bytes)).unwrap();
    Image::new(WHEN, raw).into()
}

/// An image file.
pub fn file(format: CompressedFormat) -> Payload {
    let data = match format {
        CompressedFormat::Jpeg => {
            let raw = RawPixels::dense(64, 48, Encoding::Bgr8, pattern(64 * 48 * 3)).unwrap();
            jpeg::encode(&raw, 95).unwrap()
        }
        // No part of the way looks behind the signature.
        _ => [&b"\x89PNG\r\n\x1a\n"[..], &pattern(1000)].concat().into(),
    };
    Image::new(WHEN, Pixels::Compressed { format, data }).into()
}

/// A chunk of sound.
pub fn sound(frames: u32, channels: u8, format: SampleFormat) -> Payload {
    let samples = frames as usize * usize::from(channels);
    let data: Vec<u8> = match format {
        SampleFormat::S16Le => pattern(samples * 2),
        _ => (0..samples).flat_map(|n| (n as f32 / samples as f32 - 0.5).to_le_bytes()).collect(),
    };
    AudioChunk::new(WHEN, frames, channels, 44_100, format, data).unwrap().into()
}

/// Samples that the middleware keeps.
pub fn samples<R: Testbed>() -> SampleFormat {
    if R::CAPABILITIES.float_sound { SampleFormat::F32Le } else { SampleFormat::S16Le }
}

/// The same payload with a coordinate frame, where it has one.
pub fn in_frame(payload: Payload, frame_id: &str) -> Payload {
    match payload {
        Payload::Image(image) => Image { frame_id: frame_id.into(), ..image }.into(),
        Payload::AudioChunk(sound) => AudioChunk { frame_id: frame_id.into(), ..sound }.into(),
        other => other,
    }
}

/// A small payload of the kind that `message_type` carries, as the middleware keeps it.
pub fn small<R: Testbed>(message_type: MessageType) -> Payload {
    match message_type {
        MessageType::Image => frame(4, 3, Encoding::Bgr8),
        MessageType::CompressedImage => file(CompressedFormat::Jpeg),
        MessageType::AudioChunk | MessageType::UpstreamAudio => sound(8, 2, samples::<R>()),
        MessageType::Text => Value::from("a text").into(),
        _ => number(1),
    }
}
