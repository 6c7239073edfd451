//! Sound: 16 bits a sample, one channel after the other on the wire.
//!
//! ```text
//!   Sound       a0 a1 a2 … b0 b1 b2 …   planar
//!   AudioChunk  a0 b0 a1 b1 a2 b2 …     interleaved; one channel is shared, several are copied
//! ```
//!
//! Wrapyfi makes samples of floats by `int(x * 32767)` and floats of samples by `i / 32767`.
//! Received samples stay integers; floats are written as Wrapyfi does. Its publishers begin with a
//! sound of zeros that tells the rate: it is sound like any other.

use bytes::Bytes;
use wrapyfi_yarp::Dialect;
use wrapyfi_yarp::sig::{SigError, Sound};

use super::rules::Rules;
use super::{fault, native};
use wrapyfi_data::types::{AudioChunk, SampleFormat, Stamp};
use wrapyfi_endpoint::codec::{DecodeError, DecodeResult, EncodeError};

/// Factor by which Wrapyfi multiplies floats to make integers.
const FULL_SCALE: f64 = 32767.0;
/// A float that Wrapyfi made of an integer is so near to it, times [`FULL_SCALE`].
const ROUNDING: f64 = 0.01;

/// Writes a sound.
pub(super) fn encode(sound: &AudioChunk, dialect: Dialect) -> Result<Vec<u8>, EncodeError> {
    let refused = |reason: String| {
        let what = format!("{} frames of {} channels", sound.frames, sound.channels);
        fault::unwritable("sound", what, "$", reason)
    };
    // The fields are public, so they may contradict each other.
    let AudioChunk { stamp, frames, channels, sample_rate, format, ref data, .. } = *sound;
    AudioChunk::new(stamp, frames, channels, sample_rate, format, data.clone())
        .map_err(|error| refused(error.to_string()))?;
    let rate = i32::try_from(sample_rate)
        .map_err(|_large| refused(format!("the rate {sample_rate} has to be below 2^31")))?;
    let samples: Vec<i16> = match format {
        SampleFormat::S16Le => {
            data.as_chunks::<2>().0.iter().map(|bytes| i16::from_le_bytes(*bytes)).collect()
        }
        SampleFormat::F32Le => {
            data.as_chunks::<4>().0.iter().map(|bytes| sample(f32::from_le_bytes(*bytes))).collect()
        }
    };
    let sound = Sound::from_interleaved(&samples, usize::from(channels), rate);
    let sound = sound.map_err(|error| refused(error.to_string()))?;
    sound.encode(dialect).map_err(|error| refused(error.to_string()))
}

/// Wrapyfi's `int(x * 32767)`, clipped; a float that was an integer becomes that integer again.
// `as` saturates: that is the clipping.
fn sample(x: f32) -> i16 {
    let scaled = f64::from(x) * FULL_SCALE;
    (scaled + ROUNDING.copysign(scaled)).trunc() as i16
}

/// Reads a sound.
pub(super) fn decode(bytes: &Bytes, rules: Rules<'_>, stamp: Stamp) -> DecodeResult<AudioChunk> {
    let bounds = fault::limits(rules.limits);
    let unlike = |error: &_| fault::object("a sound", "sound", error);
    let read = match Sound::decode(bytes, rules.dialect, &bounds) {
        // The samples of YARP 4 are followed by no bottle, but the number of elements tells the
        // version.
        Err(SigError::OtherVersion(_)) => Sound::decode(bytes, rules.dialect.other(), &bounds),
        read => read,
    };
    let sound = match read {
        // Over text carriers its samples come as numbers of any width.
        Err(error @ (SigError::Other { .. } | SigError::Truncated { .. })) => {
            let bottle = native::bottle(bytes, rules).map_err(|_none| unlike(&error))?;
            Sound::from_bottle(&bottle)
                .map_err(|_other| DecodeError::mismatch("a sound", native::as_text(&bottle)))
        }
        read => read.map_err(|error| unlike(&error)),
    }?;
    let damaged = |what: &str, value: &dyn std::fmt::Display, limit: u64| {
        DecodeError::malformed("sound", format!("{what} {value}, from 1 to {limit} are read"))
    };
    let channels = u8::try_from(sound.channels())
        .map_err(|_many| damaged("channels:", &sound.channels(), u8::MAX.into()))?;
    let frames = u32::try_from(sound.samples())
        .map_err(|_many| damaged("samples:", &sound.samples(), u32::MAX.into()))?;
    let rate = u32::try_from(sound.frequency_hz()).ok().filter(|rate| *rate > 0);
    let rate = rate.ok_or_else(|| damaged("frequency", &sound.frequency_hz(), i32::MAX as u64))?;
    let data = if channels <= 1 {
        sound.data().clone()
    } else {
        sound.to_interleaved().into_iter().flat_map(i16::to_le_bytes).collect()
    };
    let chunk = AudioChunk::new(stamp, frames, channels, rate, SampleFormat::S16Le, data);
    let chunk = chunk.map_err(|error| DecodeError::malformed("sound", error.to_string()))?;
    Ok(AudioChunk { frame_id: rules.options.frame_id.clone(), ..chunk })
}
