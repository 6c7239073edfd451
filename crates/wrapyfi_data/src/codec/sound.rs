//! Sound inside native objects, and the arrays that hold it.
//!
//! ```text
//!   (array, rate)                       what a Wrapyfi script returns
//!   (chunk, channels, rate, array)      what Wrapyfi makes of it on ZeroMQ     ──▶ AudioChunk
//! ```
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

use super::{DecodeError, DecodeResult};
use crate::types::{AudioChunk, Dtype, SampleFormat, Stamp, Tensor, Value, into_bytes};

impl AudioChunk {
    /// The sound in what a Wrapyfi script returns from a method registered as `AudioChunk`: the tuple
    /// or list `(array, rate)`, array of shape `(frames,)` or `(frames, channels)`, rate in Hz; or in
    /// the longer tuple `(chunk, channels, rate, array)` that Wrapyfi puts on ZeroMQ.
    ///
    /// ```
    /// # mod wrapyfi_core { pub use wrapyfi_data::types; }
    /// use wrapyfi_core::types::{AudioChunk, Stamp, Tensor, Value};
    /// let samples = Tensor::from_elements(&[3, 2], vec![0.5_f32; 6])?;
    /// let value = Value::Tuple(vec![samples.into(), 16_000.into()]);
    /// let sound = AudioChunk::from_value(&value, Stamp::now())?;
    /// assert_eq!((sound.frames, sound.channels, sound.sample_rate), (3, 2, 16_000));
    /// assert_eq!(sound.to_value(), value);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// A mismatch when `value` is no such tuple, malformed when its numbers contradict each other.
    pub fn from_value(value: &Value, stamp: Stamp) -> DecodeResult<Self> {
        let (array, rate) = match value {
            Value::Tuple(items) | Value::List(items) => match items.as_slice() {
                [Value::Tensor(array), rate] => (array, rate),
                [_, _, _, Value::Tensor(_)] => return from_message(value, stamp),
                other => return Err(mismatch("(array, rate)", &kinds(other))),
            },
            other => return Err(mismatch("(array, rate)", other.kind())),
        };
        let rate = number(rate, 1, "rate", 1..=u32::MAX)?;
        let shape = array.shape();
        let (frames, channels) = match *shape {
            [frames] => (frames, 1),
            [frames, channels] => (frames, channels),
            _ => {
                return Err(mismatch(
                    "an array (frames,) or (frames, channels)",
                    &format!("{shape:?}"),
                ));
            }
        };
        let (Ok(frames), Ok(channels)) = (u32::try_from(frames), u8::try_from(channels)) else {
            let reason = format!("{shape:?} is more than 4294967295 frames or 255 channels");
            return Err(malformed("$[0]", reason));
        };
        let (format, data) = samples(array)?;
        let sound = Self::new(stamp, frames, channels, rate, format, data)
            .map_err(|error| malformed("$[0]", error.to_string()))?;
        Ok(Self { is_flat: shape.len() == 1, ..sound })
    }

    /// The tuple `(array, rate)`, as [`AudioChunk::from_value`] reads it: array of shape
    /// [`AudioChunk::shape`]. Time stamp and coordinate frame have no place in it.
    pub fn to_value(&self) -> Value {
        let dtype = match self.format {
            SampleFormat::F32Le => Dtype::F32,
            SampleFormat::S16Le => Dtype::I16,
        };
        // The fields are public, so they may contradict each other; then it is as long as its data.
        let array = Tensor::new(dtype, self.shape(), self.data.clone()).unwrap_or_else(|_misfit| {
            let whole = self.data.len() / dtype.size();
            Tensor::unchecked(dtype, vec![whole], self.data.slice(..whole * dtype.size()))
        });
        Value::Tuple(vec![array.into(), self.sample_rate.into()])
    }
}

fn mismatch(expected: &str, actual: &str) -> DecodeError {
    DecodeError::mismatch(format!("sound as {expected}"), actual.to_owned())
}

fn kinds(items: &[Value]) -> String {
    let kinds: Vec<_> = items.iter().take(5).map(Value::kind).collect();
    format!("({})", kinds.join(", "))
}

/// The sound in the tuple that Wrapyfi sends on ZeroMQ.
pub fn from_message(value: &Value, stamp: Stamp) -> DecodeResult<AudioChunk> {
    const EXPECTED: &str = "(chunk, channels, rate, array)";
    let items = match value {
        Value::Tuple(items) | Value::List(items) => items.as_slice(),
        other => return Err(mismatch(EXPECTED, other.kind())),
    };
    let [frames, channels, rate, Value::Tensor(array)] = items else {
        return Err(mismatch(EXPECTED, &kinds(items)));
    };
    let frames: u32 = number(frames, 0, "chunk", 0..=u32::MAX)?;
    let channels: u32 = number(channels, 1, "channels", 1..=u32::from(u8::MAX))?;
    let rate = number(rate, 2, "rate", 1..=u32::MAX)?;
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
    let sound = AudioChunk::new(stamp, frames, channels, rate, format, data)
        .map_err(|error| malformed("$", error.to_string()))?;
    Ok(AudioChunk { is_flat: channels == 1 && array.shape().len() == 1, ..sound })
}

fn malformed(path: &str, reason: String) -> DecodeError {
    DecodeError::Malformed { format: "sound", path: path.to_owned(), reason }
}

/// A whole number, which Python may have sent as a float.
// `as` saturates, and the range is checked after it.
fn number(
    value: &Value,
    index: usize,
    name: &str,
    range: std::ops::RangeInclusive<u32>,
) -> DecodeResult<u32> {
    let whole = match *value {
        Value::Int(value) => Some(value),
        Value::Float(value) if value.fract() == 0.0 => Some(value as i64),
        _ => None,
    };
    let number = whole.and_then(|n| u32::try_from(n).ok()).filter(|n| range.contains(n));
    number.ok_or_else(|| {
        let shown = whole.map_or_else(|| value.kind().to_owned(), |whole| whole.to_string());
        let (low, high) = range.into_inner();
        malformed(&format!("$[{index}]"), format!("{name} is {shown}, not from {low} to {high}"))
    })
}

/// The samples of an array.
// Float64 to float32 rounds: sound has no more precision.
fn samples(array: &Tensor) -> DecodeResult<(SampleFormat, Bytes)> {
    let mismatch = || DecodeError::mismatch("sound as float32 or int16", array.dtype().to_string());
    let floats = |samples: Vec<f32>| (SampleFormat::F32Le, into_bytes(samples));
    let integers = |samples: Vec<i16>| (SampleFormat::S16Le, into_bytes(samples));
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
