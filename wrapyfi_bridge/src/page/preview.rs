//! One message as the page shows it: a small picture, a waveform, or a few lines.
//!
//! | message | shown as |
//! | --- | --- |
//! | image, picture, array of pixels | PNG of at most 240 by 180; of depths, from the nearest to the farthest |
//! | sound | lowest and highest sample of each of 160 parts |
//! | anything else | the first 4000 letters of what `wrapyfi echo` prints, or its size where it is large |

use serde::Serialize;
use wrapyfi_data::Limits;
use wrapyfi_data::types::{
    AudioChunk, Encoding, Image, MessageType, NativeObject, Payload, Pixels, RawPixels,
    SampleFormat, Stamp, Value,
};
use wrapyfi_endpoint::codec::convert;

use crate::describe::summary;

/// Largest picture.
const SIZE: [u32; 2] = [240, 180];
/// Smallest side of an array that is taken for a picture.
const SMALLEST: u32 = 16;
/// Largest image file that is decompressed for it.
const MAX_FILE: usize = 8 << 20;
/// Largest message of ROS that is told in words.
const MAX_WORDS: usize = 16 << 10;
/// Most letters.
const MAX_TEXT: usize = 4000;
/// Parts of a waveform.
const PARTS: usize = 160;

/// A message as the page shows it.
#[derive(Debug, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub(super) enum Preview {
    /// A PNG file in base64, and what it was made of.
    Image { what: String, png: String },
    /// Lowest and highest sample of each part, from -1 to 1.
    Sound { what: String, wave: Vec<[f32; 2]> },
    /// Text.
    Value { text: String },
}

/// A message as the page shows it.
pub(super) fn preview(payload: &Payload) -> Preview {
    let shown = match payload {
        Payload::Image(image) => of_image(image),
        Payload::NativeObject(object) => of_object(object),
        Payload::AudioChunk(chunk) => Some(of_sound(chunk)),
        Payload::RosMessage(message) if message.cdr.len() > MAX_WORDS => {
            let text = format!("{} bytes of {}", message.cdr.len(), message.ros_type.name());
            Some(Preview::Value { text })
        }
        Payload::RosMessage(_) | Payload::Properties(_) => None,
    };
    shown.unwrap_or_else(|| Preview::Value { text: first(&summary(payload)) })
}

fn first(text: &str) -> String {
    match text.char_indices().nth(MAX_TEXT) {
        Some((end, _)) => format!("{}…", text.get(..end).unwrap_or_default()),
        None => text.to_owned(),
    }
}

/// The picture in an object, where there is one.
fn of_object(object: &NativeObject) -> Option<Preview> {
    if !matches!(object.value, Value::Tensor(_) | Value::Picture(_)) {
        return None;
    }
    let image = Image::from_value(&object.value, Encoding::Bgr8, Stamp::default()).ok()?;
    match &image.pixels {
        Pixels::Raw(raw) if raw.width.min(raw.height) < SMALLEST => None,
        _ => of_image(&image),
    }
}

fn of_image(image: &Image) -> Option<Preview> {
    let decompressed;
    let (raw, format) = match &image.pixels {
        Pixels::Raw(raw) => (raw, raw.encoding.name()),
        Pixels::Compressed { data, .. } if data.len() > MAX_FILE => return None,
        Pixels::Compressed { format, .. } => {
            let pixels =
                convert(image.clone(), MessageType::Image, Encoding::Rgb8, &Limits::default());
            let Pixels::Raw(raw) = pixels.ok()?.pixels else { return None };
            decompressed = raw;
            (&decompressed, format.name())
        }
    };
    let what = format!("{} x {} {format}", raw.width, raw.height);
    let png = base64_simd::STANDARD.encode_to_string(thumbnail(raw)?);
    Some(Preview::Image { what, png })
}

/// A small PNG file of the picture; `None` where it has no pixels.
fn thumbnail(raw: &RawPixels) -> Option<Vec<u8>> {
    let [width, height] = fitted(raw.width, raw.height)?;
    let bytes = raw.encoding.bytes_per_pixel();
    let at = |small: u32, of: u32, full: u32| {
        ((u64::from(small) * 2 + 1) * u64::from(full) / (u64::from(of) * 2)) as usize
    };
    let pixels = (0..height).flat_map(|y| {
        let row = at(y, height, raw.height) * raw.step as usize;
        (0..width).map(move |x| {
            let begin = row + at(x, width, raw.width) * bytes;
            raw.data.get(begin..begin + bytes).unwrap_or_default()
        })
    });
    let rgb: Vec<u8> = match raw.encoding {
        Encoding::Mono8 => {
            pixels.flat_map(|pixel| [pixel.first().copied().unwrap_or_default(); 3]).collect()
        }
        encoding if bytes / encoding.channels() == 1 => {
            let is_bgr = encoding.color_order() == Some(Encoding::Bgr8);
            let colour = |pixel: &[u8]| match *pixel {
                [b, g, r, ..] if is_bgr => [r, g, b],
                [r, g, b, ..] => [r, g, b],
                _ => [0; 3],
            };
            pixels.flat_map(colour).collect()
        }
        encoding => grey(&pixels.map(|pixel| depth(encoding, pixel)).collect::<Vec<_>>()),
    };
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_compression(png::Compression::Fastest);
    encoder.write_header().and_then(|mut writer| writer.write_image_data(&rgb)).ok()?;
    Some(file)
}

/// Size within [`SIZE`] of the same shape.
fn fitted(width: u32, height: u32) -> Option<[u32; 2]> {
    let [most_x, most_y] = SIZE.map(f64::from);
    let scale = (most_x / f64::from(width)).min(most_y / f64::from(height)).min(1.0);
    let side = |full: u32| ((f64::from(full) * scale).round() as u32).max(1);
    (width > 0 && height > 0).then(|| [side(width), side(height)])
}

fn depth(encoding: Encoding, pixel: &[u8]) -> f32 {
    match (encoding, pixel) {
        (Encoding::Mono16, &[a, b]) => f32::from(u16::from_le_bytes([a, b])),
        (Encoding::I32C1, &[a, b, c, d]) => i32::from_le_bytes([a, b, c, d]) as f32,
        (_, &[a, b, c, d, ..]) => f32::from_le_bytes([a, b, c, d]),
        _ => 0.0,
    }
}

/// The lowest value black, the highest white; what is no number, black.
fn grey(values: &[f32]) -> Vec<u8> {
    let real = || values.iter().copied().filter(|value| value.is_finite());
    let (low, high) =
        (real().fold(f32::INFINITY, f32::min), real().fold(f32::NEG_INFINITY, f32::max));
    let range = (high - low).max(f32::MIN_POSITIVE);
    values.iter().flat_map(|value| [((*value - low) / range * 255.0) as u8; 3]).collect()
}

fn of_sound(chunk: &AudioChunk) -> Preview {
    let what = format!("{} Hz, {} channels", chunk.sample_rate, chunk.channels);
    let floats = chunk.to_format(SampleFormat::F32Le);
    let samples = floats.data.as_chunks::<4>().0;
    let part = samples.len().div_ceil(PARTS).max(1);
    let wave = samples.chunks(part).map(|part| {
        let values =
            part.iter().map(|bytes| f32::from_le_bytes(*bytes)).filter(|value| value.is_finite());
        let [low, high] =
            values.fold([1.0_f32, -1.0], |[low, high], value| [low.min(value), high.max(value)]);
        // Three digits are more than a screen shows.
        [low.min(high), high.max(low)].map(|value| (value.clamp(-1.0, 1.0) * 1e3).round() / 1e3)
    });
    Preview::Sound { what, wave: wave.collect() }
}

#[cfg(test)]
mod tests {
    use wrapyfi_data::types::Tensor;

    use super::*;

    /// Width, height and pixels of the picture.
    fn pixels(preview: &Preview) -> (u32, u32, Vec<u8>) {
        let Preview::Image { png, .. } = preview else { panic!("{preview:?}") };
        let file = base64_simd::STANDARD.decode_to_vec(png).unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(file)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        (info.width, info.height, pixels)
    }

    fn raw(width: u32, height: u32, encoding: Encoding, pixel: &[u8]) -> Payload {
        let data = pixel.repeat((width * height) as usize);
        Image::new(Stamp::default(), RawPixels::dense(width, height, encoding, data).unwrap())
            .into()
    }

    #[test]
    fn a_picture_is_small_and_has_its_colours() {
        let (width, height, data) = pixels(&preview(&raw(1920, 1080, Encoding::Bgr8, &[1, 2, 3])));
        assert_eq!((width, height, &data[..3]), (240, 135, &[3, 2, 1][..]));
        let (width, height, data) = pixels(&preview(&raw(8, 4, Encoding::Rgba8, &[1, 2, 3, 9])));
        assert_eq!((width, height, &data[..3]), (8, 4, &[1, 2, 3][..]));
        assert_eq!(pixels(&preview(&raw(5000, 1, Encoding::Mono8, &[7]))).0, 240);
        let empty = preview(&raw(0, 0, Encoding::Rgb8, &[]));
        assert!(matches!(empty, Preview::Value { .. }), "{empty:?}");
    }

    #[test]
    fn depths_go_from_black_to_white() {
        let values: Vec<u8> = [1.0_f32, f32::NAN, 3.0, f32::INFINITY]
            .into_iter()
            .flat_map(f32::to_le_bytes)
            .collect();
        let image = RawPixels::dense(4, 1, Encoding::F32C1, values).unwrap();
        let shown = preview(&Image::new(Stamp::default(), image).into());
        let grey: Vec<u8> = pixels(&shown).2.into_iter().step_by(3).collect();
        assert_eq!(grey, [0, 0, 255, 255]);
    }

    #[test]
    fn an_array_of_pixels_is_a_picture_and_a_vector_is_none() {
        let array = |shape: &[usize]| {
            let tensor = Tensor::from_elements(shape, vec![0_u8; shape.iter().product()]).unwrap();
            preview(&Payload::from(Value::from(tensor)))
        };
        assert!(matches!(array(&[480, 640, 3]), Preview::Image { .. }));
        assert!(matches!(array(&[3, 3]), Preview::Value { .. }));
        assert!(matches!(array(&[5]), Preview::Value { .. }));
    }

    #[test]
    fn a_sound_is_its_waveform_and_a_long_text_is_cut() {
        let samples: Vec<u8> = (0..16_000)
            .map(|at| if at < 8000 { 0_i16 } else { 16_384 })
            .flat_map(i16::to_le_bytes)
            .collect();
        let chunk =
            AudioChunk::new(Stamp::default(), 16_000, 1, 16_000, SampleFormat::S16Le, samples)
                .unwrap();
        let Preview::Sound { wave, .. } = preview(&chunk.into()) else { panic!("it is sound") };
        assert_eq!((wave.len(), wave[0], wave[PARTS - 1]), (PARTS, [0.0, 0.0], [0.5, 0.5]));
        let Preview::Value { text } = preview(&Payload::from(Value::from("ä".repeat(9000))))
        else {
            panic!("text")
        };
        assert_eq!(text.chars().count(), MAX_TEXT + 1);
    }
}
