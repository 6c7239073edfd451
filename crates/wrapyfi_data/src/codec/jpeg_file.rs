//! JPEG files read and written by libjpeg-turbo of the system, as OpenCV and image_transport do it.

use bytes::Bytes;
use turbojpeg::{Compressor, Decompressor, PixelFormat, Subsamp};

use super::jpeg_header::JpegHeader;
use super::{DecodeError, DecodeResult, EncodeError};
use crate::Limits;
use crate::types::{Encoding, RawPixels};

/// Largest number of rows and columns that libjpeg-turbo takes.
const MOST_ROWS: u32 = 65_500;

/// Compresses a picture of 8-bit channels; alpha is dropped.
///
/// # Errors
/// When the encoding has no form in JPEG, or the picture is empty, contradicts itself, or is wider or higher
/// than 65500.
pub fn encode(pixels: &RawPixels, quality: u8) -> Result<Bytes, EncodeError> {
    let RawPixels { width, height, encoding, step, .. } = *pixels;
    let refuse = |remedy: &str| {
        EncodeError::unrepresentable(
            "JPEG",
            format!("a {encoding} image of {width}x{height}"),
            remedy,
        )
    };
    let format = match encoding {
        Encoding::Mono8 => PixelFormat::GRAY,
        Encoding::Rgb8 => PixelFormat::RGB,
        Encoding::Bgr8 => PixelFormat::BGR,
        Encoding::Rgba8 => PixelFormat::RGBX,
        Encoding::Bgra8 => PixelFormat::BGRX,
        _ => return Err(refuse("use type Image")),
    };
    if ![width, height].iter().all(|extent| (1..=MOST_ROWS).contains(extent)) {
        return Err(refuse("use 1 to 65500 rows and columns, or type Image"));
    }
    // The fields are public, so they may contradict each other.
    let checked = RawPixels::new(width, height, encoding, step, pixels.data.clone())
        .map_err(|error| refuse(&error.to_string()))?;
    let image = turbojpeg::Image {
        pixels: &*checked.data,
        width: width as usize,
        pitch: step as usize,
        height: height as usize,
        format,
    };
    let subsampling = if encoding == Encoding::Mono8 { Subsamp::Gray } else { Subsamp::Sub2x2 };
    let compress = || {
        let mut compressor = Compressor::new()?;
        compressor.set_quality(i32::from(quality));
        compressor.set_subsamp(subsampling);
        // Room for the worst case, of which only what is written is ever touched.
        let mut file = vec![0; compressor.buf_len(image.width, image.height)?];
        let length = compressor.compress_to_slice(image, &mut file)?;
        file.truncate(length);
        Ok::<_, turbojpeg::Error>(Bytes::from(file))
    };
    compress().map_err(|error| refuse(&format!("the encoder says: {error}")))
}

/// Decompresses a file: grey to `mono8`, colour to `rgb8` or `bgr8` as `color_order` says,
/// `bgr8` by default.
///
/// # Errors
/// When the file is broken, or its picture would exceed the message size.
pub fn decode(
    file: &Bytes,
    limits: &Limits,
    color_order: Option<Encoding>,
) -> DecodeResult<RawPixels> {
    let malformed = |reason: String| DecodeError::malformed("JPEG", reason);
    let JpegHeader { width, height, components } = JpegHeader::read(file).map_err(malformed)?;
    let red_first = color_order.and_then(Encoding::color_order) == Some(Encoding::Rgb8);
    let color = if red_first { Encoding::Rgb8 } else { Encoding::Bgr8 };
    let (encoding, format) = match (components, red_first) {
        (1, _) => (Encoding::Mono8, PixelFormat::GRAY),
        (3, true) => (color, PixelFormat::RGB),
        (3, false) => (color, PixelFormat::BGR),
        (4, _) => (color, PixelFormat::CMYK),
        (other, _) => return Err(malformed(format!("{other} channels where 1, 3 or 4 are read"))),
    };
    let (width, height) = (u32::from(width), u32::from(height));
    let size = u64::from(width) * u64::from(height) * format.size() as u64;
    DecodeError::check_pixels("JPEG", width, height, size, limits)?;
    // Below the limit, which is a usize.
    let mut pixels = vec![0; usize::try_from(size).unwrap_or_default()];
    let image = turbojpeg::Image {
        pixels: pixels.as_mut_slice(),
        width: width as usize,
        pitch: width as usize * format.size(),
        height: height as usize,
        format,
    };
    let decompressed = Decompressor::new().and_then(|mut it| it.decompress(file, image));
    match decompressed {
        Err(turbojpeg::Error::TurboJpegError(text)) if is_harmless(&text) => {}
        other => other.map_err(|error| malformed(error.to_string()))?,
    }
    if format == PixelFormat::CMYK {
        pixels = without_black(&pixels, red_first);
    }
    RawPixels::dense(width, height, encoding, pixels).map_err(|error| malformed(error.to_string()))
}

/// True for a warning of libjpeg about bytes that many cameras write and every viewer accepts; the
/// picture is whole.
fn is_harmless(warning: &str) -> bool {
    warning.starts_with("Corrupt JPEG data") && warning.contains("extraneous bytes before marker")
}

/// Converts cyan, magenta, yellow and black, inverted as Adobe's programs and Pillow write them, to
/// colours.
pub(super) fn without_black(pixels: &[u8], red_first: bool) -> Vec<u8> {
    let of = |[c, m, y, k]: [u8; 4]| {
        let lit = |ink: u8| u8::try_from(u16::from(ink) * u16::from(k) / 255).unwrap_or(u8::MAX);
        if red_first { [lit(c), lit(m), lit(y)] } else { [lit(y), lit(m), lit(c)] }
    };
    pixels.as_chunks::<4>().0.iter().flat_map(|pixel| of(*pixel)).collect()
}
