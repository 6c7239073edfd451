//! Sound, 16 bits a sample.
//!
//! ```text
//!   256 5 │ 1 samples │ 1 channels │ 1 2 │ 1 frequency │ 320 N │ a0 a1 a2 … b0 b1 b2 …   V3
//!   256 6 │ …                                                  │ 256 markers …           V4
//!                                                        planar: channel a, then channel b
//! ```

use bytes::Bytes;

use super::error::{SigError, check, size, written};
use super::fields::{ints, put};
use crate::{Bottle, Dialect, Value, WireLimits};

/// Bytes before the samples.
pub const SOUND_HEADER_BYTES: usize = 48;
/// The only width that YARP transmits, in bytes.
const SAMPLE_BYTES: usize = 2;
/// Object, in errors.
const WHAT: &str = "a sound";
/// Code of a list of int16.
const SAMPLES: i32 = 256 + 64;

/// A sound: whole numbers of 16 bits, one channel after the other.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Sound {
    samples: usize,
    channels: usize,
    frequency_hz: i32,
    data: Bytes,
    markers: Bytes,
}

impl Sound {
    /// A sound of samples in the order of most libraries: all channels of one moment together.
    ///
    /// # Errors
    /// When `samples` are not whole moments of so many channels.
    pub fn from_interleaved(
        samples: &[i16],
        channels: usize,
        frequency_hz: i32,
    ) -> Result<Self, SigError> {
        let per_channel = per_channel(samples.len(), channels)?;
        let mut data = Vec::with_capacity(samples.len() * SAMPLE_BYTES);
        // Without samples there may be any number of channels.
        for channel in 0..channels.min(samples.len()) {
            let of_channel = samples.iter().skip(channel).step_by(channels);
            data.extend(of_channel.flat_map(|sample| sample.to_le_bytes()));
        }
        Ok(Self::planar(per_channel, channels, frequency_hz, data.into()))
    }

    fn planar(samples: usize, channels: usize, frequency_hz: i32, data: Bytes) -> Self {
        Self { samples, channels, frequency_hz, data, markers: Bytes::new() }
    }

    /// Reads a sound; its samples share `bytes`. In [`Dialect::V4`], all that follows the samples is
    /// taken for markers.
    ///
    /// # Errors
    /// When the bytes are no sound of that dialect, or exceed `limits`.
    pub fn decode(bytes: &Bytes, dialect: Dialect, limits: &WireLimits) -> Result<Self, SigError> {
        let given = bytes.len();
        let Some(words) = ints::<12>(bytes, 0) else {
            return Err(SigError::Truncated { what: WHAT, needed: SOUND_HEADER_BYTES, given });
        };
        let [list, elements, t1, samples, t2, channels, t3, width, t4, frequency_hz, t5, count] =
            words;
        check(WHAT, [("list", 0, list, 256)])?;
        check_elements(elements, dialect)?;
        let int = |(at, tag)| ("int32", at, tag, 1);
        check(WHAT, [(8, t1), (16, t2), (24, t3), (32, t4)].map(int))?;
        check(WHAT, [("list of int16", 40, t5, SAMPLES)])?;
        if usize::try_from(width) != Ok(SAMPLE_BYTES) {
            return Err(other_samples(width));
        }
        let count = size(WHAT, "number of samples", count)?;
        let samples = size(WHAT, "length in samples", samples)?;
        let channels = size(WHAT, "number of channels", channels)?;
        if samples.checked_mul(channels) != Some(count) {
            return Err(miscounted(count, samples, channels));
        }
        let length = count.saturating_mul(SAMPLE_BYTES).saturating_add(SOUND_HEADER_BYTES);
        let limit = limits.max_message_bytes;
        if length > limit {
            return Err(SigError::TooLong { what: WHAT, length, limit });
        }
        if length > given {
            return Err(SigError::Truncated { what: WHAT, needed: length, given });
        }
        let data = bytes.slice(SOUND_HEADER_BYTES..length);
        let markers = match dialect {
            Dialect::V3 => Bytes::new(),
            Dialect::V4 => bytes.slice(length..),
        };
        Ok(Self { samples, channels, frequency_hz, data, markers })
    }

    /// The sound as bytes. Markers are written in [`Dialect::V4`] only: V3 has none.
    ///
    /// # Errors
    /// When a size exceeds 31 bits.
    pub fn encode(&self, dialect: Dialect) -> Result<Vec<u8>, SigError> {
        let mut out = Vec::with_capacity(SOUND_HEADER_BYTES + self.data.len() + 8);
        let channels = written(WHAT, "number of channels", self.channels)?;
        put(
            &mut out,
            &[256, elements(dialect), 1, written(WHAT, "length in samples", self.samples)?],
        );
        put(&mut out, &[1, channels, 1, 2, 1, self.frequency_hz, SAMPLES]);
        put(&mut out, &[written(WHAT, "number of samples", self.data.len() / SAMPLE_BYTES)?]);
        out.extend_from_slice(&self.data);
        if dialect == Dialect::V4 {
            if self.markers.is_empty() {
                put(&mut out, &[256, 0]);
            } else {
                out.extend_from_slice(&self.markers);
            }
        }
        Ok(out)
    }

    /// Samples of one channel.
    pub const fn samples(&self) -> usize {
        self.samples
    }

    /// Channels.
    pub const fn channels(&self) -> usize {
        self.channels
    }

    /// Samples of one channel in a second.
    pub const fn frequency_hz(&self) -> i32 {
        self.frequency_hz
    }

    /// All samples, little-endian, one channel after the other.
    pub const fn data(&self) -> &Bytes {
        &self.data
    }

    /// All samples, the channels of one moment together.
    pub fn to_interleaved(&self) -> Vec<i16> {
        let samples = self.all();
        let mut interleaved = Vec::with_capacity(samples.len());
        // A sound without channels may announce any number of samples.
        for moment in 0..self.samples.min(samples.len()) {
            let of_moment = samples.iter().skip(moment).step_by(self.samples);
            interleaved.extend(of_moment.map(|sample| i16::from_le_bytes(*sample)));
        }
        interleaved
    }

    fn all(&self) -> &[[u8; SAMPLE_BYTES]] {
        self.data.as_chunks().0
    }

    /// The sound that a bottle is, its samples integers of any width: sounds come so over text
    /// carriers.
    ///
    /// # Errors
    /// When the bottle is something else, or holds a number that 16 bits cannot say.
    pub fn from_bottle(bottle: &Bottle) -> Result<Self, SigError> {
        let [samples, channels, width, frequency, Value::List(list), ..] = bottle.values.as_slice()
        else {
            return Err(SigError::Bottle);
        };
        let small = |value: &Value| value.as_i64().and_then(|number| i32::try_from(number).ok());
        let size = |value: &Value| small(value).and_then(|number| usize::try_from(number).ok());
        let (Some(samples), Some(channels), Some(width), Some(frequency_hz)) =
            (size(samples), size(channels), small(width), small(frequency))
        else {
            return Err(SigError::Bottle);
        };
        if usize::try_from(width) != Ok(SAMPLE_BYTES) {
            return Err(other_samples(width));
        }
        let count = list.len();
        if samples.checked_mul(channels) != Some(count) {
            return Err(miscounted(count, samples, channels));
        }
        let mut data = Vec::with_capacity(count * SAMPLE_BYTES);
        for value in &list.values {
            let sample = value.as_i64().and_then(|number| i16::try_from(number).ok());
            data.extend_from_slice(&sample.ok_or(SigError::Bottle)?.to_le_bytes());
        }
        Ok(Self::planar(samples, channels, frequency_hz, data.into()))
    }
}

fn other_samples(bytes: i32) -> SigError {
    SigError::Unsupported(format!("a sound of {bytes} bytes a sample: YARP transmits 2 only"))
}

fn miscounted(count: usize, samples: usize, channels: usize) -> SigError {
    SigError::Damaged(format!("{count} samples for {channels} channels of {samples}"))
}

fn per_channel(count: usize, channels: usize) -> Result<usize, SigError> {
    let samples = count.checked_div(channels).unwrap_or(0);
    if samples * channels != count {
        return Err(miscounted(count, samples, channels));
    }
    Ok(samples)
}

const fn elements(dialect: Dialect) -> i32 {
    match dialect {
        Dialect::V3 => 5,
        Dialect::V4 => 6,
    }
}

fn check_elements(found: i32, dialect: Dialect) -> Result<(), SigError> {
    let wanted = elements(dialect);
    let meaning = match found {
        _ if found == wanted => return Ok(()),
        2 => "the form of YARP 3.8 and older, which is not read",
        5 => "a sound of dialect v3 (set it for this connection)",
        6 => "a sound of dialect v4 (set it for this connection)",
        _ => return check(WHAT, [("elements", 4, found, wanted)]),
    };
    Err(SigError::OtherVersion(format!(
        "a list of {found} elements is {meaning}; this connection reads {dialect}, where a sound has {wanted}"
    )))
}
