//! Messages of `wrapyfi pub`: JSON from the command line, or a file.
//!
//! | file | becomes |
//! | --- | --- |
//! | `.json` | native object, properties, or the fields of a ROS message |
//! | `.npy` | array: a native object, or the pixels of an image |
//! | `.png` | image, decoded |
//! | `.jpg`, `.jpeg` | image, compressed as it is |
//! | `.wav` | sound, the whole file in one chunk |

use std::io::{BufReader, Read};
use std::path::Path;

use anyhow::{Context as _, anyhow, bail, ensure};
use bytes::Bytes;
use wrapyfi_data::Limits;
use wrapyfi_data::types::{
    AudioChunk, CompressedFormat, DataType, Encoding, Image, MessageType, Payload, Pixels,
    Properties, RawPixels, RosMessage, SampleFormat, Stamp, Value,
};
use wrapyfi_endpoint::TopicSpec;
use wrapyfi_endpoint::codec::{self, npy::NpyArray};
use wrapyfi_endpoint::config::open;

/// The payload that `text`, JSON in Wrapyfi's dialect, describes.
///
/// # Errors
/// When the text is no JSON, or no object of the type.
pub fn from_json(text: &str, spec: &TopicSpec) -> anyhow::Result<Payload> {
    let value = codec::json::decode(
        &Bytes::copy_from_slice(text.as_bytes()),
        &spec.limits,
        &wrapyfi_core::plugin::standard(),
    )
    .context("--value, which is JSON (a text has quotes: '\"hello\"')")?;
    of_value(value, spec)
}

/// The native object, the properties or the ROS message that `value` describes.
fn of_value(value: Value, spec: &TopicSpec) -> anyhow::Result<Payload> {
    match (spec.message_type, spec.message_type.data_type()) {
        (MessageType::Ros(to), _) => {
            let message = RosMessage::from_value(to, &value, spec.limits.message_bytes);
            Ok(message.map_err(|error| anyhow!("the value is no {to}: {error}"))?.into())
        }
        (_, DataType::NativeObject) => Ok(Payload::from(value)),
        (_, DataType::Properties) => Ok(Properties::from_value(&value)?.into()),
        (_, kind) => bail!("--value gives a native object, not {kind}: give --file"),
    }
}

/// The payload that the file at `path` holds.
///
/// # Errors
/// When the file cannot be read, is larger than `max_message_mib`, or holds another type.
pub fn from_file(path: &Path, spec: &TopicSpec) -> anyhow::Result<Payload> {
    let kind = spec.message_type.data_type();
    let extension =
        path.extension().and_then(|ext| ext.to_str()).unwrap_or("").to_ascii_lowercase();
    let wrong = || anyhow!("{} does not hold a message of type {kind}", path.display());
    let payload = match (extension.as_str(), kind) {
        ("json", DataType::NativeObject | DataType::Properties | DataType::RosMessage) => of_value(
            codec::json::decode(
                &read(path, &spec.limits)?,
                &spec.limits,
                &wrapyfi_core::plugin::standard(),
            )?,
            spec,
        )?,
        ("npy", DataType::NativeObject) => Payload::from(array(path, spec)?),
        ("npy", DataType::Image) => {
            // As Wrapyfi would send the array, so that the same shapes are images here and there.
            Image::from_value(&array(path, spec)?, spec.color_order, Stamp::now())?.into()
        }
        ("png", DataType::Image) => image(png(path, &spec.limits)?),
        ("jpg" | "jpeg", DataType::Image) => Payload::Image(Image {
            stamp: Stamp::now(),
            frame_id: String::new(),
            pixels: Pixels::Compressed {
                format: CompressedFormat::Jpeg,
                data: read(path, &spec.limits)?,
            },
        }),
        ("wav", DataType::AudioChunk) => Payload::AudioChunk(wav(path, &spec.limits)?),
        ("json" | "npy" | "png" | "jpg" | "jpeg" | "wav", _) => return Err(wrong()),
        _ => {
            bail!("{}: file type is not known; use .json, .npy, .png, .jpg or .wav", path.display())
        }
    };
    Ok(payload)
}

/// The text of a `.json` file.
///
/// # Errors
/// When the file is of another type, cannot be read, is larger than `max_message_mib`, or is no text.
pub fn json_text(path: &Path, limits: &Limits) -> anyhow::Result<String> {
    let name = path.display();
    let is_json = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json"));
    ensure!(is_json, "{name} is no .json file");
    String::from_utf8(read(path, limits)?.into()).with_context(|| format!("{name} is no text"))
}

/// The payload as if it were taken now. Native objects have a time `in_ros` only.
pub fn restamp(payload: &mut Payload, in_ros: bool) {
    match payload {
        Payload::Image(image) => image.stamp = Stamp::now(),
        Payload::AudioChunk(chunk) => chunk.stamp = Stamp::now(),
        Payload::NativeObject(object) if in_ros => object.stamp = Stamp::now(),
        _ => (),
    }
}

fn image(raw: RawPixels) -> Payload {
    Payload::Image(Image { stamp: Stamp::now(), frame_id: String::new(), pixels: Pixels::Raw(raw) })
}

fn read(path: &Path, limits: &Limits) -> anyhow::Result<Bytes> {
    let name = path.display();
    let file = open(path).with_context(|| format!("cannot open {name}"))?;
    let limit = limits.message_bytes as u64;
    let mut content = Vec::new();
    file.take(limit + 1)
        .read_to_end(&mut content)
        .with_context(|| format!("cannot read {name}"))?;
    ensure!(
        content.len() as u64 <= limit,
        "{name} is larger than the message limit of {limit} bytes"
    );
    Ok(content.into())
}

fn array(path: &Path, spec: &TopicSpec) -> anyhow::Result<Value> {
    let file = read(path, &spec.limits)?;
    Ok(match codec::npy::read(&file).with_context(|| path.display().to_string())? {
        NpyArray::Tensor(tensor) => Value::Tensor(tensor),
        NpyArray::Array(array) => Value::Array(array),
    })
}

fn png(path: &Path, limits: &Limits) -> anyhow::Result<RawPixels> {
    let name = path.display();
    let file = BufReader::new(open(path).with_context(|| format!("cannot open {name}"))?);
    let mut decoder =
        png::Decoder::new_with_limits(file, png::Limits { bytes: limits.message_bytes });
    decoder.set_transformations(png::Transformations::EXPAND | png::Transformations::STRIP_16);
    let mut reader = decoder.read_info().with_context(|| format!("{name} is no PNG"))?;
    let size = reader.output_buffer_size().with_context(|| format!("{name} is too large"))?;
    ensure!(
        size <= limits.message_bytes,
        "{name} has {size} bytes of pixels, the limit is {}",
        limits.message_bytes
    );
    let mut data = vec![0; size];
    let info = reader.next_frame(&mut data).with_context(|| format!("{name} is damaged"))?;
    data.truncate(info.buffer_size());
    let encoding = match info.color_type {
        png::ColorType::Grayscale => Encoding::Mono8,
        png::ColorType::Rgb => Encoding::Rgb8,
        png::ColorType::Rgba => Encoding::Rgba8,
        other => {
            bail!("{name}: colour type {other:?} is not carried; save it as grey, RGB or RGBA")
        }
    };
    let step = u32::try_from(info.line_size).with_context(|| format!("{name} is too wide"))?;
    Ok(RawPixels::new(info.width, info.height, encoding, step, data)?)
}

fn wav(path: &Path, limits: &Limits) -> anyhow::Result<AudioChunk> {
    let name = path.display();
    let reader = hound::WavReader::open(path).with_context(|| format!("{name} is no WAV file"))?;
    let hound::WavSpec { channels, sample_rate, bits_per_sample, sample_format } = reader.spec();
    let frames = reader.duration();
    let channels = u8::try_from(channels)
        .with_context(|| format!("{name} has {channels} channels, the limit is 255"))?;
    let size = u64::from(reader.len()) * 4;
    ensure!(
        size <= limits.message_bytes as u64,
        "{name} has {size} bytes of samples, the limit is {}",
        limits.message_bytes
    );
    let (format, data) = match (sample_format, bits_per_sample) {
        (hound::SampleFormat::Float, 32) => {
            let samples: Result<Vec<f32>, _> = reader.into_samples().collect();
            (
                SampleFormat::F32Le,
                samples?.iter().flat_map(|sample| sample.to_le_bytes()).collect::<Vec<u8>>(),
            )
        }
        (hound::SampleFormat::Int, 16) => {
            let samples: Result<Vec<i16>, _> = reader.into_samples().collect();
            (SampleFormat::S16Le, samples?.iter().flat_map(|sample| sample.to_le_bytes()).collect())
        }
        (format, bits) => bail!(
            "{name}: {bits}-bit {format:?} samples are not carried; use 16-bit integer or 32-bit float"
        ),
    };
    Ok(AudioChunk::new(Stamp::now(), frames, channels, sample_rate, format, data)?)
}
