//! Sound.
//!
//! ```text
//!   frame 0: [ch 0][ch 1] … │ frame 1: [ch 0][ch 1] … │ …      interleaved, little-endian
//! ```

use bytes::Bytes;
use wrapyfi_interfaces::named;

use super::Stamp;
use super::shape::{ShapeError, check_length};

/// A chunk of sound: `wrapyfi_msgs/msg/AudioChunk` in ROS 2, `(array, rate)` in Wrapyfi.
///
/// `data.len()` is always `frames * channels * format.bytes_per_sample()`.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::types; }
/// use wrapyfi_core::types::{AudioChunk, SampleFormat, Stamp};
/// let stereo = AudioChunk::new(Stamp::now(), 2, 2, 44_100, SampleFormat::S16Le, vec![0; 8])?;
/// assert_eq!(stereo.to_format(SampleFormat::F32Le).data.len(), 16);
/// # Ok::<(), wrapyfi_data::types::ShapeError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AudioChunk {
    /// Time at which the first sample was taken; reception time where the sender does not say.
    pub stamp: Stamp,
    /// Coordinate frame of the microphone; empty from Wrapyfi.
    pub frame_id: String,
    /// Number of samples per channel in this chunk.
    pub frames: u32,
    /// Number of channels.
    pub channels: u8,
    /// Samples per second and channel, in Hz.
    pub sample_rate: u32,
    /// Type of one sample.
    pub format: SampleFormat,
    /// Interleaved samples.
    pub data: Bytes,
    /// True where the samples of one channel are an array `(frames,)` to a Wrapyfi script, as in most of its listings for
    /// mono sound; else they are `(frames, channels)`.
    pub is_flat: bool,
}

impl AudioChunk {
    /// Makes a chunk without a coordinate frame, whose array is `(frames, channels)`.
    ///
    /// # Errors
    /// When `data` is not exactly `frames * channels` samples, or `channels` is 0.
    pub fn new(
        stamp: Stamp,
        frames: u32,
        channels: u8,
        sample_rate: u32,
        format: SampleFormat,
        data: impl Into<Bytes>,
    ) -> Result<Self, ShapeError> {
        let data = data.into();
        if channels == 0 {
            return Err(ShapeError::NoChannels);
        }
        let shape = [frames as usize, usize::from(channels)];
        check_length(&shape, format.bytes_per_sample(), data.len(), || {
            format!("{format} sound of {frames} frames x {channels} channels")
        })?;
        let (frame_id, is_flat) = (String::new(), false);
        Ok(Self { stamp, frame_id, frames, channels, sample_rate, format, data, is_flat })
    }

    /// Shape of the samples as an array: `(frames, channels)`, or `(frames,)` where that is flat.
    pub fn shape(&self) -> Vec<usize> {
        let frames = self.frames as usize;
        match self.channels {
            1 if self.is_flat => vec![frames],
            channels => vec![frames, channels.into()],
        }
    }

    /// Converts the samples to type `format`; shares the bytes when they have it already.
    ///
    /// A 16-bit sample is 32768 times the float: integers survive the way through floats
    /// unchanged, floats beyond full scale are clipped.
    #[must_use]
    pub fn to_format(&self, format: SampleFormat) -> Self {
        let data = match (self.format, format) {
            (SampleFormat::S16Le, SampleFormat::F32Le) => s16_to_f32(&self.data).into(),
            (SampleFormat::F32Le, SampleFormat::S16Le) => f32_to_s16(&self.data).into(),
            _ => self.data.clone(),
        };
        Self { format, data, ..self.clone() }
    }
}

/// Full scale of a 16-bit sample.
const FULL_SCALE: f32 = 32768.0;

fn s16_to_f32(samples: &[u8]) -> Vec<u8> {
    let (samples, _) = samples.as_chunks::<2>();
    samples
        .iter()
        .flat_map(|&sample| (f32::from(i16::from_le_bytes(sample)) / FULL_SCALE).to_le_bytes())
        .collect()
}

// `as` saturates: that is the clipping.
fn f32_to_s16(samples: &[u8]) -> Vec<u8> {
    let (samples, _) = samples.as_chunks::<4>();
    samples
        .iter()
        .flat_map(|&sample| {
            ((f32::from_le_bytes(sample) * FULL_SCALE).round() as i16).to_le_bytes()
        })
        .collect()
}

named! {
    /// Type of one audio sample.
    ///
    /// ```
    /// # mod wrapyfi_core { pub use wrapyfi_data::types; }
    /// use wrapyfi_core::types::SampleFormat;
    /// assert_eq!(SampleFormat::from_name("S16LE"), Some(SampleFormat::S16Le));
    /// assert_eq!(SampleFormat::F32Le.bytes_per_sample(), 4);
    /// ```
    pub enum SampleFormat {
        /// 32-bit float, little-endian, -1.0 to 1.0, as Wrapyfi sends.
        F32Le => "FLOAT32LE",
        /// 16-bit signed integer, little-endian.
        S16Le => "S16LE",
    }
    /// Name in `wrapyfi_msgs/msg/AudioChunk.encoding`: `FLOAT32LE` or `S16LE`.
    pub fn name, from_name;
}

impl SampleFormat {
    /// Size of one sample of one channel in bytes.
    pub fn bytes_per_sample(self) -> usize {
        match self {
            Self::F32Le => 4,
            Self::S16Le => 2,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_must_fit_the_header() {
        let make = |channels, len| {
            AudioChunk::new(
                Stamp::default(),
                3,
                channels,
                44_100,
                SampleFormat::F32Le,
                vec![0; len],
            )
        };
        assert!(make(2, 24).is_ok());
        assert_eq!(make(0, 0).unwrap_err(), ShapeError::NoChannels);
        let error = make(2, 23).unwrap_err().to_string();
        assert_eq!(error, "FLOAT32LE sound of 3 frames x 2 channels needs 24 bytes, 23 are there");
    }

    #[test]
    fn every_integer_sample_survives_floats() {
        let data: Vec<u8> = (i16::MIN..=i16::MAX).flat_map(i16::to_le_bytes).collect();
        let sound =
            AudioChunk::new(Stamp::default(), 65_536, 1, 8000, SampleFormat::S16Le, data).unwrap();
        let floats = sound.to_format(SampleFormat::F32Le);
        assert_eq!(floats.data.get(..4), Some(&(-1.0_f32).to_le_bytes()[..]));
        assert_eq!(floats.to_format(SampleFormat::S16Le), sound);
    }

    #[test]
    fn loud_floats_are_clipped() {
        let data: Vec<u8> =
            [1.0_f32, -3.0, f32::NAN].iter().flat_map(|x| x.to_le_bytes()).collect();
        let sound =
            AudioChunk::new(Stamp::default(), 3, 1, 8000, SampleFormat::F32Le, data).unwrap();
        let clipped = sound.to_format(SampleFormat::S16Le).data;
        assert_eq!(*clipped, [0xFF, 0x7F, 0x00, 0x80, 0, 0]);
    }
}
