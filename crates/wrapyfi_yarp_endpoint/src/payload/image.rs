//! Camera frames: YARP's images, and the form in which Wrapyfi sends JPEG files.
//!
//! ```text
//!   header │ rows, padded as the header says   ◀──▶  Raw, rows shared with the message
//!   bottle of one string: base64 of .npy of …  ◀──▶  Compressed
//!   a JPEG file alone (carrier mjpeg)           ──▶  Compressed
//! ```

use bytes::Bytes;
use wrapyfi_yarp::port::PayloadKind;
use wrapyfi_yarp::sig::{self, ImageHeader, PixelCode, Rows};
use wrapyfi_yarp::{Bottle, Dialect, Value as Element};

use super::super::options::YarpOptions;
use super::rules::Rules;
use super::{fault, native};
use wrapyfi_data::types::{
    CompressedFormat, Encoding, Image, MessageType, NumpyArray, Pixels, RawPixels, Stamp,
};
use wrapyfi_endpoint::TopicSpec;
use wrapyfi_endpoint::codec::json::base64;
use wrapyfi_endpoint::codec::npy::{self, NpyArray};
use wrapyfi_endpoint::codec::{DecodeError, DecodeResult, EncodeError, EncodeResult, convert};

/// Pixels of YARP and what ROS calls them.
const PIXELS: [(PixelCode, Encoding); 17] = [
    (PixelCode::Mono, Encoding::Mono8),
    (PixelCode::Mono16, Encoding::Mono16),
    (PixelCode::Rgb, Encoding::Rgb8),
    (PixelCode::Bgr, Encoding::Bgr8),
    (PixelCode::Rgba, Encoding::Rgba8),
    (PixelCode::Bgra, Encoding::Bgra8),
    (PixelCode::Int, Encoding::I32C1),
    (PixelCode::Float, Encoding::F32C1),
    (PixelCode::RgbFloat, Encoding::F32C3),
    (PixelCode::BayerRggb8, Encoding::BayerRggb8),
    (PixelCode::BayerBggr8, Encoding::BayerBggr8),
    (PixelCode::BayerGbrg8, Encoding::BayerGbrg8),
    (PixelCode::BayerGrbg8, Encoding::BayerGrbg8),
    (PixelCode::BayerRggb16, Encoding::BayerRggb16),
    (PixelCode::BayerBggr16, Encoding::BayerBggr16),
    (PixelCode::BayerGbrg16, Encoding::BayerGbrg16),
    (PixelCode::BayerGrbg16, Encoding::BayerGrbg16),
];
/// Rows whose step no header can say are tried at these multiples before they are copied.
const QUANTA: [u16; 3] = [1, sig::DEFAULT_QUANTUM, 4096];

/// First bytes of the header of every image: a list of four.
const IMAGE: [u8; 8] = [0, 1, 0, 0, 4, 0, 0, 0];

/// Writes a picture that has the form of its type as messages of the topic carry it.
pub(super) fn encode(image: &Image, spec: &TopicSpec, rules: Rules<'_>) -> EncodeResult<Vec<u8>> {
    match &image.pixels {
        Pixels::Raw(raw) => encode_raw(raw.clone(), spec, rules.options),
        Pixels::Compressed { data, .. } => encode_file(data, rules.dialect),
    }
}

/// The picture as the JPEG file that carrier mjpeg brings.
pub(super) fn encode_jpeg(image: &Image, spec: &TopicSpec) -> EncodeResult<Bytes> {
    let is_png = |image: &Image| {
        matches!(image.pixels, Pixels::Compressed { format: CompressedFormat::Png, .. })
    };
    let mut image = image.clone();
    if is_png(&image) {
        image = convert(image, MessageType::Image, spec.color_order, &spec.limits)?;
    }
    match convert(image, MessageType::CompressedImage, spec.color_order, &spec.limits)?.pixels {
        Pixels::Compressed { data, .. } => Ok(data),
        Pixels::Raw(raw) => {
            let what = format!("a {} image of {}x{}", raw.encoding, raw.width, raw.height);
            Err(fault::unwritable("jpeg", what, "$", "use another carrier than mjpeg"))
        }
    }
}

fn encode_raw(raw: RawPixels, spec: &TopicSpec, options: &YarpOptions) -> EncodeResult<Vec<u8>> {
    let rows = rows(options);
    let (code, raw) = if options.wrapyfi_images {
        wrapyfi_order(raw, spec.color_order)
    } else {
        let found = PIXELS.into_iter().find(|(_, encoding)| *encoding == raw.encoding);
        (found.map(|(code, _)| code), raw)
    };
    let what = || format!("a {} image of {}x{}", raw.encoding, raw.width, raw.height);
    let refused = |remedy: &str| fault::unwritable("image", what(), "$", remedy);
    let code = code.ok_or_else(|| refused("convert it to one that YARP has"))?;
    // The fields are public, so they may contradict each other.
    let raw = RawPixels::new(raw.width, raw.height, raw.encoding, raw.step, raw.data.clone())
        .map_err(|error| refused(&error.to_string()))?;
    let image = lay_out(code, &raw).map_err(|error| refused(&error.to_string()))?;
    EncodeError::check_size(
        sig::IMAGE_HEADER_BYTES.saturating_add(image.data().len()),
        spec.limits.message_bytes,
    )?;
    image.encode(rows).map_err(|error| refused(&error.to_string()))
}

/// The picture with its rows where they are, if a header can say so.
fn lay_out(code: PixelCode, raw: &RawPixels) -> Result<sig::Image, sig::SigError> {
    let (width, height) = (raw.width as usize, raw.height as usize);
    let step = raw.step as usize;
    let quanta = QUANTA.into_iter().chain(u16::try_from(step));
    for quantum in quanta {
        let header = ImageHeader::new(code, width, height, quantum)?;
        if header.stride == step {
            return sig::Image::from_parts(header, raw.data.clone());
        }
    }
    sig::Image::from_packed(code, width, height, raw.to_dense().data)
}

/// Python Wrapyfi's ports know `rgb` and no other order: what it calls so is what OpenCV has.
fn wrapyfi_order(raw: RawPixels, color_order: Encoding) -> (Option<PixelCode>, RawPixels) {
    match raw.encoding {
        Encoding::Rgb8 | Encoding::Bgr8 => (Some(PixelCode::Rgb), raw.in_color_order(color_order)),
        Encoding::Mono8 => (Some(PixelCode::Mono), raw),
        Encoding::F32C1 => (Some(PixelCode::Float), raw),
        Encoding::F32C3 => (Some(PixelCode::RgbFloat), raw),
        _ => (None, raw),
    }
}

fn rows(options: &YarpOptions) -> Rows {
    if options.packed_rows || options.wrapyfi_images { Rows::Packed } else { Rows::Announced }
}

/// A file as Wrapyfi sends it: base64 of a `.npy` file of one string of bytes.
fn encode_file(file: &Bytes, dialect: Dialect) -> EncodeResult<Vec<u8>> {
    let length = file.len();
    let array = NumpyArray::new(format!("'|S{length}'"), length, vec![], file.clone());
    let array = array.map_err(|error| {
        let what = format!("a file of {length} bytes");
        fault::unwritable("npy", what, "$", format!("compress it again: {error}"))
    })?;
    let mut text = Vec::new();
    base64::append(&npy::write_array(&array), &[], &mut text);
    native::bytes(&native::single(text), dialect)
}

/// Reads a picture of any of the forms: who wants another one converts it.
pub(super) fn decode(
    bytes: &Bytes,
    kind: PayloadKind,
    spec: &TopicSpec,
    rules: Rules<'_>,
    stamp: Stamp,
) -> DecodeResult<Image> {
    let pixels = match kind {
        PayloadKind::Raw => file(bytes.clone())?,
        PayloadKind::Bottle if bytes.starts_with(&IMAGE) => {
            Pixels::Raw(decode_raw(bytes, spec, rules.options)?)
        }
        PayloadKind::Bottle => decode_file(&native::bottle(bytes, rules)?)?,
    };
    Ok(Image { stamp, frame_id: rules.options.frame_id.clone(), pixels })
}

fn decode_raw(bytes: &Bytes, spec: &TopicSpec, options: &YarpOptions) -> DecodeResult<RawPixels> {
    let image = sig::Image::decode(bytes, rows(options), &fault::limits(&spec.limits));
    let image = image.map_err(|error| fault::object("an image", "image", &error))?;
    let header = image.header();
    let code = header.pixel;
    let found = PIXELS.into_iter().find(|(known, _)| *known == code);
    let mut encoding = found.map(|(_, encoding)| encoding).ok_or_else(|| {
        let names: Vec<_> = PIXELS.iter().map(|(code, _)| code.to_string()).collect();
        DecodeError::mismatch(
            format!("an image of pixels {}", names.join(", ")),
            format!("one of pixels {code}, which have no name in ROS"),
        )
    })?;
    if options.wrapyfi_images && encoding == Encoding::Rgb8 {
        encoding = spec.color_order.color_order().unwrap_or(Encoding::Bgr8);
    }
    let size = |value: usize| {
        u32::try_from(value).map_err(|error| DecodeError::malformed("image", error.to_string()))
    };
    let (width, height) = (size(header.width)?, size(header.height)?);
    let read = if header.is_empty() {
        RawPixels::dense(width, height, encoding, Bytes::new())
    } else {
        let step = size(header.stride)?;
        RawPixels::new(width, height, encoding, step, image.data().clone())
    };
    read.map_err(|error| DecodeError::malformed("image", error.to_string()))
}

fn decode_file(bottle: &Bottle) -> DecodeResult<Pixels> {
    let unlike = || {
        DecodeError::mismatch(
            "an image, or a JPEG file as Wrapyfi sends it",
            native::as_text(bottle),
        )
    };
    match bottle.values.as_slice() {
        [Element::Blob(bytes)] => file(bytes.clone()),
        [Element::String(text)] => {
            let read = base64::decode_strictly(text.as_bytes());
            let read = read.map_or_else(|| base64::decode_leniently(text.as_bytes()), Ok);
            let npy = read.map_err(|_reason| unlike())?;
            match npy::read(&npy.into())? {
                NpyArray::Array(array) => file(array.data),
                NpyArray::Tensor(tensor) => file(tensor.data().clone()),
            }
        }
        _ => Err(unlike()),
    }
}

/// An image file, told by its first bytes.
fn file(data: Bytes) -> DecodeResult<Pixels> {
    let format = CompressedFormat::sniff(&data);
    let format = format.ok_or_else(|| {
        DecodeError::mismatch("a jpeg or png file", format!("{} other bytes", data.len()))
    })?;
    Ok(Pixels::Compressed { format, data })
}
