//! `PILImage`: a Pillow image, as pixels or as a file.
//!
//! ```text
//!   ["PILImage", base64 of pixels, [width, height], "RGB"]   image made in memory ─▶ Raw
//!   ["PILImage", "\u0089PNG\r\n…"]                           image from a file ─▶ JPEG, PNG: the file
//!                                                                               others: Raw
//!   Picture ─▶ the second form: Wrapyfi's own reader takes the base64 text of the first for the
//!              pixels
//! ```

use bytes::Bytes;

use super::{Body, Part, Plugin, PluginError, Unpacking};
use crate::malformed;
use wrapyfi_data::codec::image_file::{self, unpack_bits};
use wrapyfi_data::codec::picture::INKS;
use wrapyfi_data::codec::{DecodeError, EncodeError};
use wrapyfi_data::types::{
    CompressedFormat, Encoding, Image, Picture, Pixels, RawPixels, Stamp, Value, swap_byte_order,
};

/// Pillow's `Image`.
pub(super) struct Pillow;

/// Pillow's modes that are read, and the encoding of each. The first mode of an encoding is its
/// own; the others are kept beside the picture. Bits become bytes.
const MODES: [(&str, Encoding); 11] = [
    ("RGB", Encoding::Rgb8),
    ("RGBA", Encoding::Rgba8),
    ("L", Encoding::Mono8),
    (BITS, Encoding::Mono8),
    ("I;16", Encoding::Mono16),
    ("I;16L", Encoding::Mono16),
    ("I;16B", Encoding::Mono16),
    ("I", Encoding::I32C1),
    ("F", Encoding::F32C1),
    // Wrapyfi sends indices into a palette that it does not send; they are read as greys.
    ("P", Encoding::Mono8),
    (INKS, Encoding::Rgba8),
];

/// Mode with one bit for each pixel.
const BITS: &str = "1";

impl Plugin for Pillow {
    fn key(&self) -> &str {
        "PILImage"
    }

    fn decode(&self, body: &Body<'_>, context: &Unpacking<'_>) -> Result<Value, PluginError> {
        // Wrapyfi decides by the number of parts, too.
        let (pixels, mode) =
            if body.len() == 3 { from_pixels(body, context)? } else { from_file(body, context)? };
        Ok(Picture { image: Image::new(Stamp::default(), pixels), mode }.into())
    }

    fn encode(&self, value: &Value) -> Result<Vec<Part>, PluginError> {
        let picture = value.as_picture().ok_or_else(|| PluginError::not_mine("picture", value))?;
        let file = match &picture.image.pixels {
            Pixels::Compressed { data, .. } => data.clone(),
            Pixels::Raw(raw) if raw.width == 0 || raw.height == 0 => return empty(raw),
            Pixels::Raw(raw) => {
                image_file::encode(raw, picture.mode.as_deref()).map_err(unwritable)?
            }
        };
        Ok(vec![Part::Latin1(file)])
    }
}

/// Writes an image without pixels, which no file can hold, in the first form, in which an empty
/// image cannot be misread.
fn empty(raw: &RawPixels) -> Result<Vec<Part>, PluginError> {
    let rgb = match raw.encoding {
        Encoding::Bgr8 | Encoding::Bgra8 => raw.encoding.swapped(),
        other => other,
    };
    let (mode, _) = MODES.iter().find(|(_, encoding)| *encoding == rgb).ok_or_else(|| {
        PluginError::unsupported(format!("a {} image", raw.encoding), "send it as an array")
    })?;
    let size: Value = [raw.width, raw.height].into_iter().collect();
    Ok(vec![Part::base64(Bytes::new()), Part::Value(size), Part::Text((*mode).to_owned())])
}

fn unwritable(error: EncodeError) -> PluginError {
    match error {
        EncodeError::Unrepresentable { what, remedy, .. } => PluginError::unsupported(what, remedy),
        other => PluginError::unsupported("this picture", other.to_string()),
    }
}

/// Reads the pixels of an image made in memory, and its mode where the encoding does not tell it.
fn from_pixels(
    body: &Body<'_>,
    context: &Unpacking<'_>,
) -> Result<(Pixels, Option<String>), PluginError> {
    let mode = body.text(2)?;
    let Some((_, encoding)) = MODES.iter().find(|(known, _)| *known == mode) else {
        return Err(PluginError::unsupported(
            format!("an image of mode {mode:?}"),
            format!("convert it to one of {}", MODES.map(|(mode, _)| mode).join(", ")),
        ));
    };
    let extent = |size: &Value| u32::try_from(size.as_i64()?).ok();
    let (width, height) = match body.value(1)?.as_items() {
        Some([width, height]) => extent(width).zip(extent(height)),
        _ => None,
    }
    .ok_or_else(|| body.expected(1, "[width, height], each from 0 to 4294967295,"))?;
    let mut data = body.base64(0)?;
    if mode == BITS {
        let row = width.div_ceil(8);
        let wanted = u64::from(row) * u64::from(height);
        if data.len() as u64 != wanted {
            let reason = format!(
                "{width}x{height} bits need {wanted} bytes in rows of {row}, {} are there",
                data.len()
            );
            return Err(malformed(reason));
        }
        context.unpack("the image", u64::from(width) * u64::from(height))?;
        data = unpack_bits(&data, width as usize).into();
    } else if mode == "I;16B" {
        let mut swapped = data.to_vec();
        swap_byte_order(&mut swapped, 2);
        data = swapped.into();
    }
    let raw = RawPixels::dense(width, height, *encoding, data).map_err(malformed)?;
    Ok((raw.into(), matches!(&*mode, BITS | "P" | INKS).then_some(mode)))
}

fn from_file(
    body: &Body<'_>,
    context: &Unpacking<'_>,
) -> Result<(Pixels, Option<String>), PluginError> {
    let file: Bytes = body.latin1(0)?;
    if let Some(format) = CompressedFormat::sniff(&file) {
        return Ok((Pixels::Compressed { format, data: file }, None));
    }
    let pixels = match image_file::decode_inks(&file, &context.left()) {
        Ok(Some(raw)) => Ok((raw, Some(INKS.to_owned()))),
        Ok(None) => {
            image_file::decode(&file, &context.left(), Some(Encoding::Rgb8)).map(|raw| (raw, None))
        }
        Err(error) => Err(error),
    };
    let (raw, mode) = pixels.map_err(|error| match error {
        DecodeError::TooLarge { path, actual, limit, .. } => {
            PluginError::TooLarge { what: path, actual, limit }
        }
        DecodeError::Mismatch { actual, .. } => PluginError::unsupported(
            actual,
            "send a JPEG, PNG, BMP, GIF, TIFF or WebP file, or the pixels",
        ),
        other => PluginError::malformed(0, other.to_string()),
    })?;
    context.unpack("the image", raw.data.len() as u64)?;
    Ok((raw.into(), mode))
}
