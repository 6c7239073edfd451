//! Sound: `wrapyfi_msgs/msg/AudioChunk` and the message of Python Wrapyfi.
//!
//! Both have the same fields in the same order, so one is read and written as the other. Wrapyfi labels its 32-bit floats `S16LE` and insists on that label,
//! so on reception the size of the data decides what a sample is, whatever the label says.

use wrapyfi_interfaces::wrapyfi_msgs::msg;

use super::part::{
    contradictory, countable, header, little_endian, malformed, misfit, quote, stamp,
};
use crate::codec::{DecodeResult, EncodeResult};
use crate::types::{AudioChunk, SampleFormat};

/// Value of `coding_format` for one channel in an array of one dimension.
const FLAT: &str = "flat";

/// Sound under the label that is true.
pub(super) fn message(sound: &AudioChunk) -> EncodeResult<msg::AudioChunk> {
    check(sound)?;
    let coding_format = if sound.shape().len() == 1 { FLAT } else { "" };
    Ok(msg::AudioChunk { coding_format: coding_format.to_owned(), ..labelled(sound, sound.format) })
}

/// Form that Python Wrapyfi accepts: floats under the label of integers.
pub(in crate::codec) fn upstream_message(sound: &AudioChunk) -> EncodeResult<msg::AudioChunk> {
    check(sound)?;
    let sound = sound.to_format(SampleFormat::F32Le);
    countable("data", sound.data.len())?;
    Ok(labelled(&sound, SampleFormat::S16Le))
}

fn labelled(sound: &AudioChunk, label: SampleFormat) -> msg::AudioChunk {
    msg::AudioChunk {
        header: header(sound.stamp, &sound.frame_id),
        chunk_size: sound.frames,
        channels: sound.channels,
        sample_rate: sound.sample_rate,
        encoding: label.name().to_owned(),
        is_bigendian: 0,
        bitrate: 0,
        coding_format: String::new(),
        step: sound.format.bytes_per_sample() as u32 * u32::from(sound.channels),
        data: sound.data.clone(),
    }
}

/// The fields are public, so they may contradict each other.
fn check(sound: &AudioChunk) -> EncodeResult<()> {
    let AudioChunk { stamp, frames, channels, sample_rate, format, ref data, .. } = *sound;
    AudioChunk::new(stamp, frames, channels, sample_rate, format, data.clone())
        .map_err(|error| contradictory("sound", &error, "AudioChunk::new"))?;
    countable("data", data.len())
}

pub(in crate::codec) fn decode(message: msg::AudioChunk) -> DecodeResult<AudioChunk> {
    let format = sample_format(&message)?;
    let data = if message.is_bigendian == 0 {
        message.data.clone()
    } else {
        little_endian(&message.data, format.bytes_per_sample(), message.data.len())
    };
    let stamp = stamp(&message.header);
    let sound = AudioChunk::new(
        stamp,
        message.chunk_size,
        message.channels,
        message.sample_rate,
        format,
        data,
    )
    .map_err(|error| misfit(&error))?;
    let is_flat = message.channels == 1 && message.coding_format == FLAT;
    Ok(AudioChunk { frame_id: message.header.frame_id, is_flat, ..sound })
}

/// The format whose samples fill the data exactly.
fn sample_format(message: &msg::AudioChunk) -> DecodeResult<SampleFormat> {
    let samples = u64::from(message.chunk_size) * u64::from(message.channels);
    [SampleFormat::F32Le, SampleFormat::S16Le]
        .into_iter()
        .find(|format| samples * format.bytes_per_sample() as u64 == message.data.len() as u64)
        .ok_or_else(|| {
            malformed(
                "data",
                format!(
                    "{} samples of {} channels need {} bytes as float32 or {} as int16, {} are \
                     there (encoding {}, coding_format {})",
                    message.chunk_size,
                    message.channels,
                    samples * 4,
                    samples * 2,
                    message.data.len(),
                    quote(&message.encoding),
                    quote(&message.coding_format),
                ),
            )
        })
}
