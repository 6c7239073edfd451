//! JPEG files, and images in the form that a message type carries.
//!
//! ```text
//!   RawPixels ── encode (quality 95, 4:2:0 as OpenCV does) ──▶ file
//!   file ── decode (size checked first, straight into the wanted channel order) ──▶ RawPixels
//! ```

use bytes::Bytes;
use jpeg_encoder::{ColorType, Encoder, SamplingFactor};
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use super::{DecodeError, EncodeError, Path, image_file};
use crate::Limits;
use crate::types::{CompressedFormat, Encoding, Image, MessageType, Pixels, RawPixels};

/// Quality that Wrapyfi, by OpenCV's default, compresses with.
pub const WRAPYFI_QUALITY: u8 = 95;

/// Compresses a picture of 8-bit channels; alpha is dropped.
///
/// # Errors
/// When the encoding has no form in JPEG, or the picture is empty or wider or higher than 65535.
pub fn encode(pixels: &RawPixels, quality: u8) -> Result<Bytes, EncodeError> {
    let RawPixels { width, height, encoding, .. } = *pixels;
    let refuse = |remedy: &str| EncodeError::Unrepresentable {
        format: "JPEG",
        what: format!("a {encoding} image of {width}x{height}"),
        path: Path::Root.to_string(),
        remedy: remedy.to_owned(),
    };
    let color = match encoding {
        Encoding::Mono8 => ColorType::Luma,
        Encoding::Rgb8 => ColorType::Rgb,
        Encoding::Bgr8 => ColorType::Bgr,
        Encoding::Rgba8 => ColorType::Rgba,
        Encoding::Bgra8 => ColorType::Bgra,
        Encoding::Mono16 | Encoding::I32C1 | Encoding::F32C1 | Encoding::F32C3 => {
            return Err(refuse("use type Image"));
        }
    };
    let (Ok(columns), Ok(rows)) = (u16::try_from(width), u16::try_from(height)) else {
        return Err(refuse("use at most 65535 rows and columns, or type Image"));
    };
    let dense = pixels.to_dense();
    let mut file = Vec::with_capacity(dense.data.len() / 4);
    let mut encoder = Encoder::new(&mut file, quality);
    encoder.set_sampling_factor(SamplingFactor::F_2_2);
    encoder
        .encode(&dense.data, columns, rows, color)
        .map_err(|error| refuse(&format!("the encoder says: {error}")))?;
    Ok(file.into())
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
    let (encoding, space) = match color_order {
        Some(Encoding::Rgb8 | Encoding::Rgba8) => (Encoding::Rgb8, ColorSpace::RGB),
        _ => (Encoding::Bgr8, ColorSpace::BGR),
    };
    let options = DecoderOptions::default()
        .set_max_width(usize::from(u16::MAX))
        .set_max_height(usize::from(u16::MAX))
        .jpeg_set_out_colorspace(space);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(&**file), options);
    decoder.decode_headers().map_err(|error| malformed(format!("{error:?}")))?;
    let info = decoder.info().ok_or_else(|| malformed("no picture size".into()))?;
    let (encoding, space) =
        if info.components == 1 { (Encoding::Mono8, ColorSpace::Luma) } else { (encoding, space) };
    decoder.set_options(options.jpeg_set_out_colorspace(space));

    let (width, height) = (u32::from(info.width), u32::from(info.height));
    let size = u64::from(width) * u64::from(height) * encoding.bytes_per_pixel() as u64;
    if size > limits.message_bytes as u64 {
        return Err(DecodeError::TooLarge {
            what: "message",
            path: format!("JPEG of {width}x{height}"),
            actual: size,
            limit: limits.message_bytes as u64,
        });
    }
    let pixels = decoder.decode().map_err(|error| malformed(format!("{error:?}")))?;
    RawPixels::dense(width, height, encoding, pixels).map_err(|error| malformed(error.to_string()))
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
