//! Code that the example programs share: a log on standard error, pauses of polling loops, and data
//! that shows whether it arrived unchanged.
//!
//! The programs are in `src/bin`, one for each scheme; README.md says how to run them. Their work with
//! sensors and robots, beside communicating, is in modules:
//!
//! | module | one idea |
//! | --- | --- |
//! | [`picture`] | PNG files, pixels, sketches for a terminal |
//! | [`camera`] | frames of files, of a device, or drawn |
//! | [`audio`] | microphones and loudspeakers: WAV files and ALSA |
//! | [`face`] | a stand-in for a recogniser of facial expressions |
//! | [`head`] | stand-ins for sensors of a head's orientation, a robot's neck |

pub mod audio;
pub mod camera;
pub mod face;
pub mod head;
pub mod picture;
#[cfg(feature = "v4l2")]
mod v4l2;

use std::time::Duration;

use serde_json::{Value as Json, json};
use sha2::{Digest as _, Sha256};
use wrapyfi_core::types::{
    AudioChunk, Dtype, Encoding, Image, Pixels, RawPixels, SampleFormat, Stamp, Tensor,
};

/// Writes the library's log lines to standard error; `RUST_LOG` chooses which.
pub fn log_to_stderr() {
    let filter = tracing_subscriber::EnvFilter::try_from_default_env()
        .unwrap_or_else(|_unset| tracing_subscriber::EnvFilter::new("info"));
    tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr).init();
}

/// Pause of a loop after a call that returned nothing.
pub fn pause() {
    std::thread::sleep(Duration::from_millis(5));
}

/// A frame whose bytes depend on `call`; `None` where it would not fit the memory.
#[must_use]
pub fn image(call: u8, width: u32, height: u32) -> Option<Image> {
    let length = usize::try_from(width).ok()?.checked_mul(height.try_into().ok()?)?;
    let data: Vec<u8> = (0..length.checked_mul(3)?)
        .map(|place| u8::try_from(place % 251).unwrap_or_default().wrapping_add(call))
        .collect();
    let pixels = RawPixels::dense(width, height, Encoding::Bgr8, data).ok()?;
    Some(Image::new(Stamp::now(), pixels))
}

/// A chunk of sound whose samples depend on `call`; `None` where it has no channels.
#[must_use]
pub fn sound(call: u8, rate: u32, frames: u32, channels: u8) -> Option<AudioChunk> {
    let count = frames.checked_mul(channels.into())?;
    let sample = |place: u32| f32::from(u8::try_from(place % 251).unwrap_or_default()) / 256.0;
    let samples = (0..count).map(|place| sample(place.wrapping_add(call.into())) - 0.5);
    let data: Vec<u8> = samples.flat_map(f32::to_le_bytes).collect();
    AudioChunk::new(Stamp::now(), frames, channels, rate, SampleFormat::F32Le, data).ok()
}

/// The pixels of a frame as an array, `(height, width, channels)`, as in Python; `None` for files.
#[must_use]
pub fn pixels(image: &Image) -> Option<Tensor> {
    let Pixels::Raw(raw) = &image.pixels else { return None };
    let shape = [raw.height as usize, raw.width as usize, raw.encoding.channels()];
    Tensor::new(Dtype::U8, shape, raw.to_dense().data).ok()
}

/// The samples of a chunk as an array, `(frames, channels)`, as in Python.
#[must_use]
pub fn samples(sound: &AudioChunk) -> Option<Tensor> {
    let floats = sound.to_format(SampleFormat::F32Le);
    Tensor::new(Dtype::F32, [floats.frames as usize, floats.channels.into()], floats.data).ok()
}

/// Shape and digest of a frame.
#[must_use]
pub fn described_image(image: &Image) -> Json {
    match &image.pixels {
        Pixels::Raw(raw) => json!({
            "shape": [raw.height, raw.width, raw.encoding.channels()],
            "encoding": raw.encoding.name(),
            "sha256": digest(&raw.to_dense().data),
        }),
        Pixels::Compressed { format, data } => {
            json!({ "encoding": format.name(), "sha256": digest(data) })
        }
    }
}

/// Shape and digest of a chunk of sound.
#[must_use]
pub fn described_sound(sound: &AudioChunk) -> Json {
    json!({
        "shape": [sound.frames, u32::from(sound.channels)],
        "rate": sound.sample_rate,
        "sha256": digest(&sound.data),
    })
}

fn digest(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}
