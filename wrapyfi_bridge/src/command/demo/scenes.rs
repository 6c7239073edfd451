//! Pictures, sounds and objects of the demo's sources: message by number.

use wrapyfi_data::types::{
    AudioChunk, CompressedFormat, Encoding, Image, Map, Payload, Pixels, RawPixels, SampleFormat,
    Stamp, Tensor, Value,
};
use wrapyfi_endpoint::codec::jpeg;

/// Key under which the demo's objects carry the time they were sent.
pub(super) const SENT_AT: &str = "sent_at";
/// Size of a script's picture.
const FRAME: (u32, u32) = (640, 480);
/// Size of a picture of the robot's.
const ROBOT_FRAME: (u32, u32) = (320, 240);
const SAMPLE_RATE: u32 = 44_100;
/// A tenth of a second of sound.
const FRAMES: u32 = SAMPLE_RATE / 10;

/// A colour wheel that turns, so that a wrong channel order or a torn frame is seen at once.
fn pixels(
    sequence: u64,
    (width, height): (u32, u32),
    encoding: Encoding,
) -> anyhow::Result<RawPixels> {
    let shift = u32::try_from(sequence % 256)?;
    let byte = |value: u32| u8::try_from(value % 256).unwrap_or_default();
    let mut data = Vec::with_capacity((width * height * 3) as usize);
    for y in 0..height {
        for x in 0..width {
            data.extend([byte(x * 256 / width + shift), byte(y * 256 / height), byte(255 - shift)]);
        }
    }
    Ok(RawPixels::new(width, height, encoding, width * 3, data)?)
}

fn now(pixels: Pixels) -> Payload {
    Payload::Image(Image { stamp: Stamp::now(), frame_id: String::new(), pixels })
}

/// A picture as OpenCV has it.
pub(super) fn frame(sequence: u64) -> anyhow::Result<Payload> {
    Ok(now(Pixels::Raw(pixels(sequence, FRAME, Encoding::Bgr8)?)))
}

/// The same as a file.
pub(super) fn jpeg_frame(sequence: u64) -> anyhow::Result<Payload> {
    let data = jpeg::encode(&pixels(sequence, FRAME, Encoding::Bgr8)?, 95)?;
    Ok(now(Pixels::Compressed { format: CompressedFormat::Jpeg, data }))
}

/// A picture as a robot's port has it: `ImageOf<PixelRgb>`.
pub(super) fn robot_frame(sequence: u64) -> anyhow::Result<Payload> {
    Ok(now(Pixels::Raw(pixels(sequence, ROBOT_FRAME, Encoding::Rgb8)?)))
}

/// A 440 Hz tone, sample by sample.
fn tone(sequence: u64) -> impl Iterator<Item = f32> {
    let first = sequence * u64::from(FRAMES);
    (0..u64::from(FRAMES)).map(move |index| {
        let turns = (first + index) as f64 * 440.0 / f64::from(SAMPLE_RATE);
        (0.5 * (turns * std::f64::consts::TAU).sin()) as f32
    })
}

/// Sound as Wrapyfi's scripts have it: floats.
pub(super) fn sound(sequence: u64) -> anyhow::Result<Payload> {
    let data: Vec<u8> = tone(sequence).flat_map(f32::to_le_bytes).collect();
    let chunk = AudioChunk::new(Stamp::now(), FRAMES, 1, SAMPLE_RATE, SampleFormat::F32Le, data)?;
    Ok(Payload::AudioChunk(chunk))
}

/// Sound as YARP's `Sound` has it: integers, here of two ears.
pub(super) fn robot_sound(sequence: u64) -> anyhow::Result<Payload> {
    let sample = |x: f32| (x * f32::from(i16::MAX)) as i16;
    let data: Vec<u8> = tone(sequence)
        .flat_map(|left| [sample(left), sample(left / 2.0)])
        .flat_map(i16::to_le_bytes)
        .collect();
    let chunk = AudioChunk::new(Stamp::now(), FRAMES, 2, SAMPLE_RATE, SampleFormat::S16Le, data)?;
    Ok(Payload::AudioChunk(chunk))
}

/// Object as a Python script sends it: `{"sequence": ..., "sent_at": time.time(), "joints":
/// np.array(...)}`.
pub(super) fn object(sequence: u64) -> anyhow::Result<Payload> {
    let joints: Vec<f64> = (0..6).map(|joint| f64::from(joint) * 0.1 + sequence as f64).collect();
    let mut map = Map::default();
    map.insert(Value::from("sequence"), Value::Int(i64::try_from(sequence)?));
    map.insert(Value::from(SENT_AT), Value::Float(Stamp::now().as_secs_f64()));
    map.insert(Value::from("label"), Value::from("grüße"));
    map.insert(Value::from("joints"), Value::Tensor(Tensor::from_elements(&[6], joints)?));
    Ok(Payload::from(Value::Map(map)))
}
