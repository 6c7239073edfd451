//! The body of a sound: JSON of `(chunk, channels, rate, array)`.
//!
//! Wrapyfi sends float32 and reads nothing else. Other element types, which a script may have sent,
//! become the nearer of the two formats that [`AudioChunk`] has:
//!
//! | array | samples |
//! | --- | --- |
//! | float32 | as they are |
//! | float16, float64 | float32 |
//! | int16 | as they are |
//! | int8, uint8, uint16 | 16 bits, full scale kept |
//! | int32 | float32, full scale kept |

use bytes::Bytes;

use crate::Limits;
use crate::codec::{DecodeError, EncodeError, json};
use crate::types::{AudioChunk, Dtype, SampleFormat, Stamp, Tensor, Value};

pub(super) fn decode(
    body: &Bytes,
    stamp: Stamp,
    limits: &Limits,
) -> Result<AudioChunk, DecodeError> {
    let expected = || "sound as (chunk, channels, rate, array)".to_owned();
    let value = json::decode(body, limits)?;
    let items = match &value {
        Value::Tuple(items) | Value::List(items) => items.as_slice(),
        other => {
            let actual = other.kind().to_owned();
            return Err(DecodeError::Mismatch { expected: expected(), actual });
        }
    };
    let [frames, channels, rate, Value::Tensor(array)] = items else {
        let kinds: Vec<_> = items.iter().take(5).map(Value::kind).collect();
        let actual = format!("({})", kinds.join(", "));
        return Err(DecodeError::Mismatch { expected: expected(), actual });
    };
    let frames: u32 = number(frames, 0, 0..=u32::MAX)?;
    let channels: u32 = number(channels, 1, 1..=u32::from(u8::MAX))?;
    let rate = number(rate, 2, 1..=u32::MAX)?;
    let wanted = u64::from(frames) * u64::from(channels);
    if array.element_count() as u64 != wanted {
        let shape = array.shape();
        return Err(malformed(
            "$[3]",
            format!("{frames} frames x {channels} channels are {wanted} samples, not {shape:?}"),
        ));
    }
    let (format, data) = samples(array)?;
    let channels = u8::try_from(channels).unwrap_or(u8::MAX);
    AudioChunk::new(stamp, frames, channels, rate, format, data)
        .map_err(|error| malformed("$", error.to_string()))
}

fn malformed(path: &str, reason: String) -> DecodeError {
    DecodeError::Malformed { format: "sound", path: path.to_owned(), reason }
}

/// A whole number, which Python may have sent as a float.
#[allow(clippy::cast_possible_truncation)] // `as` saturates, and the range is checked after it
fn number(
    value: &Value,
    index: usize,
    range: std::ops::RangeInclusive<u32>,
) -> Result<u32, DecodeError> {
    let whole = match *value {
        Value::Int(value) => Some(value),
        Value::Float(value) if value.fract() == 0.0 => Some(value as i64),
        _ => None,
    };
    let number = whole.and_then(|n| u32::try_from(n).ok()).filter(|n| range.contains(n));
    number.ok_or_else(|| {
        let shown = whole.map_or_else(|| value.kind().to_owned(), |whole| whole.to_string());
        let names = ["chunk", "channels", "rate"];
        let name = names.get(index).copied().unwrap_or_default();
        let (low, high) = range.into_inner();
        malformed(&format!("$[{index}]"), format!("{name} is {shown}, not from {low} to {high}"))
    })
}

/// The samples of an array.
#[allow(clippy::cast_possible_truncation)] // float64 to float32 rounds: sound has no more precision
fn samples(array: &Tensor) -> Result<(SampleFormat, Bytes), DecodeError> {
    let mismatch = || DecodeError::Mismatch {
        expected: "sound as float32 or int16".into(),
        actual: array.dtype().to_string(),
    };
    let floats = |samples: Vec<f32>| {
        let bytes: Vec<u8> = samples.into_iter().flat_map(f32::to_le_bytes).collect();
        (SampleFormat::F32Le, Bytes::from(bytes))
    };
    let integers = |samples: Vec<i16>| {
        let bytes: Vec<u8> = samples.into_iter().flat_map(i16::to_le_bytes).collect();
        (SampleFormat::S16Le, Bytes::from(bytes))
    };
    /// Every element of type `T`, converted.
    fn each<T: crate::types::Element, S>(
        array: &Tensor,
        convert: impl Fn(T) -> S,
    ) -> Option<Vec<S>> {
        Some(array.to_vec::<T>()?.into_iter().map(convert).collect())
    }
    let converted = match array.dtype() {
        Dtype::F32 => return Ok((SampleFormat::F32Le, array.data().clone())),
        Dtype::I16 => return Ok((SampleFormat::S16Le, array.data().clone())),
        Dtype::F64 => each(array, |x: f64| x as f32).map(floats),
        Dtype::F16 => each(array, half::f16::to_f32).map(floats),
        Dtype::I32 => each(array, |x: i32| (f64::from(x) / 2_147_483_648.0) as f32).map(floats),
        Dtype::I8 => each(array, |x: i8| i16::from(x) << 8).map(integers),
        Dtype::U8 => each(array, |x: u8| (i16::from(x) - 128) << 8).map(integers),
        Dtype::U16 => each(array, |x: u16| (x ^ 0x8000).cast_signed()).map(integers),
        _ => None,
    };
    converted.ok_or_else(mismatch)
}

pub(super) fn encode(sound: &AudioChunk) -> Result<Vec<u8>, EncodeError> {
    let sound = sound.to_format(SampleFormat::F32Le);
    let shape = [sound.frames as usize, usize::from(sound.channels)];
    let array = Tensor::new(Dtype::F32, shape, sound.data).map_err(|error| {
        EncodeError::Unrepresentable {
            format: "sound",
            what: error.to_string(),
            path: "$".into(),
            remedy: "make chunks with AudioChunk::new".into(),
        }
    })?;
    json::encode(&Value::Tuple(vec![
        sound.frames.into(),
        sound.channels.into(),
        sound.sample_rate.into(),
        array.into(),
    ]))
}
