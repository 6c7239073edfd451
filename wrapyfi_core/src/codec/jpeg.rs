//! JPEG files, and images in the form that a message type carries.
//!
//! ```text
//!   RawPixels ── encode (quality 95, 4:2:0 as OpenCV does) ──▶ file
//!   file ── header (size, scans: checked first) ── decode into the wanted channel order ──▶ RawPixels
//! ```
//!
//! libjpeg-turbo of the system does the work, as in OpenCV and image_transport.

use bytes::Bytes;
use turbojpeg::{Compressor, Decompressor, PixelFormat, Subsamp};

use super::jpeg_header::JpegHeader;
use super::{DecodeError, EncodeError, Path, image_file};
use crate::Limits;
use crate::types::{CompressedFormat, Encoding, Image, MessageType, Pixels, RawPixels};

/// Quality that Wrapyfi, by OpenCV's default, compresses with.
pub const WRAPYFI_QUALITY: u8 = 95;
/// Most rows and columns that libjpeg-turbo takes.
const MOST_ROWS: u32 = 65_500;

/// Compresses a picture of 8-bit channels; alpha is dropped.
///
/// # Errors
/// When the encoding has no form in JPEG, or the picture is empty, contradicts itself, or is wider or higher
/// than 65500.
pub fn encode(pixels: &RawPixels, quality: u8) -> Result<Bytes, EncodeError> {
    let RawPixels { width, height, encoding, step, .. } = *pixels;
    let refuse = |remedy: &str| EncodeError::Unrepresentable {
        format: "JPEG",
        what: format!("a {encoding} image of {width}x{height}"),
        path: Path::Root.to_string(),
        remedy: remedy.to_owned(),
    };
    let format = match encoding {
        Encoding::Mono8 => PixelFormat::GRAY,
        Encoding::Rgb8 => PixelFormat::RGB,
        Encoding::Bgr8 => PixelFormat::BGR,
        Encoding::Rgba8 => PixelFormat::RGBX,
        Encoding::Bgra8 => PixelFormat::BGRX,
        Encoding::Mono16 | Encoding::I32C1 | Encoding::F32C1 | Encoding::F32C3 => {
            return Err(refuse("use type Image"));
        }
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
) -> Result<RawPixels, DecodeError> {
    let malformed = |reason: String| DecodeError::Malformed {
        format: "JPEG",
        path: Path::Root.to_string(),
        reason,
    };
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
    if size > limits.message_bytes as u64 {
        return Err(DecodeError::TooLarge {
            what: "message",
            path: format!("JPEG of {width}x{height}"),
            actual: size,
            limit: limits.message_bytes as u64,
        });
    }
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

/// Whether libjpeg warns of what many cameras write and every viewer accepts, and decodes the picture.
fn is_harmless(warning: &str) -> bool {
    warning.starts_with("Corrupt JPEG data") && warning.contains("extraneous bytes before marker")
}

/// Cyan, magenta, yellow and black, inverted as Adobe's programs and Pillow write them, as colours.
fn without_black(pixels: &[u8], red_first: bool) -> Vec<u8> {
    let of = |[c, m, y, k]: [u8; 4]| {
        let lit = |ink: u8| u8::try_from(u16::from(ink) * u16::from(k) / 255).unwrap_or(u8::MAX);
        if red_first { [lit(c), lit(m), lit(y)] } else { [lit(y), lit(m), lit(c)] }
    };
    pixels.as_chunks::<4>().0.iter().flat_map(|pixel| of(*pixel)).collect()
}

/// Turns `image` into the form that `to` carries: pixels for [`MessageType::Image`], a file for
/// [`MessageType::CompressedImage`]. Free where it has that form already; other types change
/// nothing. `color_order` is the channel order of decompressed colour pictures.
///
/// # Errors
/// When the picture has no such form, is broken, or would exceed the message size.
pub fn convert(
    image: Image,
    to: MessageType,
    color_order: Encoding,
    limits: &Limits,
) -> Result<Image, EncodeError> {
    let pixels = match (&image.pixels, to) {
        (Pixels::Raw(raw), MessageType::CompressedImage) => Pixels::Compressed {
            format: CompressedFormat::Jpeg,
            data: encode(raw, WRAPYFI_QUALITY)?,
        },
        (Pixels::Compressed { format, data }, MessageType::Image) => {
            Pixels::Raw(decompress(*format, data, limits, color_order)?)
        }
        _ => return Ok(image),
    };
    Ok(Image { pixels, ..image })
}

fn decompress(
    format: CompressedFormat,
    file: &Bytes,
    limits: &Limits,
    color_order: Encoding,
) -> Result<RawPixels, EncodeError> {
    let decoded = match format {
        CompressedFormat::Jpeg => decode(file, limits, Some(color_order)),
        CompressedFormat::Png => image_file::decode(file, limits, Some(color_order)),
    };
    decoded.map_err(|error| match error {
        DecodeError::TooLarge { actual, limit, .. } => EncodeError::TooLarge { actual, limit },
        error => EncodeError::Unrepresentable {
            format: "uncompressed image",
            what: error.to_string(),
            path: Path::Root.to_string(),
            remedy: "check the sender".to_owned(),
        },
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::types::Stamp;

    fn picture(encoding: Encoding, pixel: &[u8]) -> RawPixels {
        RawPixels::dense(33, 17, encoding, pixel.repeat(33 * 17)).unwrap()
    }

    fn near(pixels: &RawPixels, pixel: &[u8]) -> bool {
        pixels
            .data
            .chunks(pixel.len())
            .all(|p| p.iter().zip(pixel).all(|(a, b)| a.abs_diff(*b) < 5))
    }

    #[test]
    fn red_stays_red_in_every_order() {
        let limits = Limits::default();
        for (encoding, red) in [
            (Encoding::Rgb8, &[254, 0, 0][..]),
            (Encoding::Bgr8, &[0, 0, 254]),
            (Encoding::Rgba8, &[254, 0, 0, 9]),
            (Encoding::Bgra8, &[0, 0, 254, 9]),
        ] {
            let file = encode(&picture(encoding, red), WRAPYFI_QUALITY).unwrap();
            let bgr = decode(&file, &limits, None).unwrap();
            assert_eq!((bgr.width, bgr.height, bgr.encoding), (33, 17, Encoding::Bgr8));
            assert!(near(&bgr, &[0, 0, 254]), "{encoding}: {:?}", &bgr.data[..6]);
            let rgb = decode(&file, &limits, Some(Encoding::Rgb8)).unwrap();
            assert!(near(&rgb, &[254, 0, 0]), "{encoding}: {:?}", &rgb.data[..6]);
        }
    }

    #[test]
    fn grey_stays_grey() {
        let file = encode(&picture(Encoding::Mono8, &[77]), WRAPYFI_QUALITY).unwrap();
        let grey = decode(&file, &Limits::default(), Some(Encoding::Rgb8)).unwrap();
        assert_eq!((grey.encoding, grey.data.len()), (Encoding::Mono8, 33 * 17));
        assert!(near(&grey, &[77]));
    }

    #[test]
    fn what_jpeg_does_not_hold() {
        let error = encode(&picture(Encoding::F32C1, &[0; 4]), 95).unwrap_err().to_string();
        assert_eq!(error, "JPEG cannot hold a 32FC1 image of 33x17 at $; use type Image");
        for (width, height) in [(70_000, 1), (0, 0)] {
            let bytes = vec![0; (width * height) as usize];
            let pixels = RawPixels::dense(width, height, Encoding::Mono8, bytes).unwrap();
            assert!(encode(&pixels, 95).is_err(), "{width}x{height}");
        }
    }

    /// As OpenCV reads them: a file that Pillow made of (cyan, magenta, yellow, black).
    #[test]
    fn four_inks_become_three_colours() {
        // 100 % yellow and 20 % black, inverted.
        let pixels = [255, 255, 0, 204].repeat(2);
        assert_eq!(without_black(&pixels, true), [204, 204, 0, 204, 204, 0]);
        assert_eq!(without_black(&pixels, false), [0, 204, 204, 0, 204, 204]);
        let file = include_bytes!("../../tests/data/cmyk.jpg");
        let rgb = decode(&Bytes::from_static(file), &Limits::default(), Some(Encoding::Rgb8));
        let rgb = rgb.unwrap();
        assert_eq!((rgb.width, rgb.height, rgb.encoding), (33, 17, Encoding::Rgb8));
        assert!(near(&rgb, &[204, 204, 0]), "{:?}", &rgb.data[..6]);
    }

    #[test]
    fn bytes_that_cameras_leave_before_the_end_do_no_harm_and_a_cut_file_does() {
        let whole = encode(&picture(Encoding::Rgb8, &[1, 200, 3]), WRAPYFI_QUALITY).unwrap();
        let (picture, end) = whole.split_at(whole.len() - 2);
        let file = [picture, &[0, 0, 0], end].concat();
        let limits = Limits::default();
        let seen = decode(&file.into(), &limits, None).unwrap();
        assert_eq!(seen, decode(&whole, &limits, None).unwrap());
        let error = decode(&whole.slice(..whole.len() - 40), &limits, None).unwrap_err();
        assert!(matches!(error, DecodeError::Malformed { format: "JPEG", .. }), "{error}");
    }

    #[test]
    fn rows_may_have_padding() {
        let dense = picture(Encoding::Bgr8, &[9, 90, 200]);
        let padded: Vec<u8> =
            dense.data.chunks(33 * 3).flat_map(|row| [row, &[7; 5]].concat()).collect();
        let padded = RawPixels::new(33, 17, Encoding::Bgr8, 33 * 3 + 5, padded).unwrap();
        assert_eq!(encode(&padded, 95).unwrap(), encode(&dense, 95).unwrap());
        let lying = RawPixels { step: 1, ..padded };
        assert!(encode(&lying, 95).is_err());
    }

    #[test]
    fn the_size_is_checked_before_the_picture_is_made() {
        let mut file = encode(&picture(Encoding::Rgb8, &[1, 2, 3]), 95).unwrap().to_vec();
        // The frame header: FF C0, length, precision, height, width.
        let frame = file.windows(2).position(|w| w == [0xFF, 0xC0]).unwrap();
        file[frame + 5..frame + 9].fill(0xFF);
        let error = decode(&file.into(), &Limits::default(), None).unwrap_err().to_string();
        assert!(error.contains("65535x65535 is 12884508675, the limit is 67108864"), "{error}");
    }

    #[test]
    fn converting_makes_the_form_that_is_asked_for() {
        let limits = Limits::default();
        let raw = Image::new(Stamp::default(), picture(Encoding::Rgb8, &[9, 90, 200]));
        let same = convert(raw.clone(), MessageType::Image, Encoding::Bgr8, &limits).unwrap();
        assert_eq!(same, raw);
        let file = convert(raw, MessageType::CompressedImage, Encoding::Bgr8, &limits).unwrap();
        let Pixels::Compressed { format: CompressedFormat::Jpeg, data } = &file.pixels else {
            panic!("a file");
        };
        assert_eq!(CompressedFormat::sniff(data), Some(CompressedFormat::Jpeg));
        let back = convert(file, MessageType::Image, Encoding::Bgr8, &limits).unwrap();
        let Pixels::Raw(back) = back.pixels else { panic!("pixels") };
        assert!(near(&back, &[200, 90, 9]));
    }

    #[test]
    fn a_png_file_becomes_pixels() {
        let limits = Limits::default();
        let file = image_file::encode(&picture(Encoding::Rgb8, &[9, 90, 200]), false).unwrap();
        let png = |data| {
            let pixels = Pixels::Compressed { format: CompressedFormat::Png, data };
            convert(
                Image::new(Stamp::default(), pixels),
                MessageType::Image,
                Encoding::Bgr8,
                &limits,
            )
        };
        let Pixels::Raw(raw) = png(file).unwrap().pixels else { panic!("pixels") };
        assert_eq!(raw, picture(Encoding::Bgr8, &[200, 90, 9]));
        let error = png(Bytes::new()).unwrap_err().to_string();
        assert!(error.contains("a file of 0 bytes"), "{error}");
    }

    proptest! {
        #[test]
        fn broken_files_are_refused_or_read(at in 0_usize..600, byte: u8, cut in 0_usize..600) {
            let file = encode(&picture(Encoding::Rgb8, &[1, 200, 3]), 95).unwrap();
            let mut broken = file.to_vec();
            let at = at % broken.len();
            broken[at] = byte;
            let limits = Limits { message_bytes: 1 << 20, ..Limits::default() };
            drop(decode(&broken.into(), &limits, None));
            drop(decode(&file.slice(..cut % file.len()), &limits, None));
        }
    }
}
