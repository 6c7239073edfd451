//! Sound.

use bytes::Bytes;

use super::Stamp;

/// A chunk of sound: `wrapyfi_msgs/msg/AudioChunk` in ROS 2, `(array, rate)` in Wrapyfi.
///
/// `data.len()` is always `frames * channels * format.bytes_per_sample()`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AudioChunk {
    /// When the first sample was taken; reception time where the sender does not say.
    pub stamp: Stamp,
    /// Coordinate frame of the microphone; empty from Wrapyfi.
    pub frame_id: String,
    /// Samples per channel in this chunk.
    pub frames: u32,
    /// Channels, interleaved.
    pub channels: u8,
    /// Samples per second and channel, in Hz.
    pub sample_rate: u32,
    /// Type of one sample.
    pub format: SampleFormat,
    /// Interleaved samples.
    pub data: Bytes,
}

/// Type of one audio sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum SampleFormat {
    /// 32-bit float, little-endian, -1.0 to 1.0: what Wrapyfi sends.
    F32Le,
    /// 16-bit signed integer, little-endian.
    S16Le,
}
