//! Image files: files to pixels, and pixels to files without loss.
//!
//! ```text
//!   JPEG, PNG, BMP, GIF, TIFF, WebP ─ size checked first ─▶ RawPixels
//!   RawPixels ─▶ PNG; 32-bit grey and inks, which PNG has not ─▶ TIFF
//! ```
//!
//! | pixels in the file | become |
//! | --- | --- |
//! | grey of 1 to 8 bits; 16 bits | `mono8`; `mono16` |
//! | colour, palettes | `rgb8` or `bgr8`, as asked for |
//! | colour or grey with alpha | `rgba8` or `bgra8` |
//! | cyan, magenta, yellow and black (TIFF) | `rgb8` or `bgr8` |
//! | colour of 16 bits | their upper 8 bits |
//! | 32-bit floats; integers (TIFF) | `32FC1`, `32FC3`; `32SC1` |
//!
//! The first frame of a film is read. TIFF goes past `image`, which lets its decoder allocate 128
//! MiB whatever the limit is; BigTIFF is not read. WebP is read only where `message_bytes` has room
//! for 16 MiB beside the picture, which its decoder may take because a file claims it.

mod claims;

use std::io::Cursor;

use bytes::Bytes;
use image::{ColorType, ImageDecoder, ImageFormat, ImageReader};
use tiff::decoder::DecodingResult;
use tiff::encoder::colortype::{CMYK8, Gray32Float, GrayI32};

use super::{DecodeError, DecodeResult, EncodeError, jpeg};
use crate::Limits;
use crate::types::{CompressedFormat, Encoding, RawPixels};

/// Decompresses a file of any of the formats above, which its first bytes tell. Colour comes as
/// `rgb8` or `bgr8` as `color_order` says, `bgr8` by default.
///
/// # Errors
/// When the format is another, the file is broken, or its picture would exceed `message_bytes`.
pub fn decode(
    file: &Bytes,
    limits: &Limits,
    color_order: Option<Encoding>,
) -> DecodeResult<RawPixels> {
    if CompressedFormat::sniff(file) == Some(CompressedFormat::Jpeg) {
        return jpeg::decode(file, limits, color_order);
    }
    let color_order = color_order.unwrap_or(Encoding::Bgr8);
    let (format, name) = known_format(file)?;
    let malformed = |reason: String| DecodeError::malformed(name, reason);
    if format == ImageFormat::Bmp {
        claims::check_bmp(file).map_err(malformed)?;
    } else if format == ImageFormat::Tiff {
        let raw = match tiff(file, limits, name)? {
            (raw, true) => inks_to_rgb(&raw),
            (raw, false) => raw,
        };
        return Ok(raw.in_color_order(color_order));
    }
    let mut reader = ImageReader::with_format(Cursor::new(&**file), format);
    let mut bounds = image::Limits::no_limits();
    bounds.max_alloc = Some(limits.message_bytes as u64);
    reader.limits(bounds);
    let decoder = reader.into_decoder().map_err(|error| malformed(error.to_string()))?;
    let ((width, height), color) = (decoder.dimensions(), decoder.color_type());
    let work = if format == ImageFormat::WebP { WEBP_WORK } else { 0 };
    DecodeError::check_pixels(
        name,
        width,
        height,
        decoder.total_bytes().saturating_add(work),
        limits,
    )?;
    let mut pixels = vec![0; usize::try_from(decoder.total_bytes()).unwrap_or(usize::MAX)];
    decoder.read_image(&mut pixels).map_err(|error| malformed(error.to_string()))?;
    let (encoding, pixels) =
        encoded(color, pixels).ok_or_else(|| malformed(format!("pixels of type {color:?}")))?;
    let raw = RawPixels::dense(width, height, encoding, pixels)
        .map_err(|error| malformed(error.to_string()))?;
    Ok(raw.in_color_order(color_order))
}

/// Largest number of bytes that a WebP decoder takes because three bytes of a file claim them.
const WEBP_WORK: u64 = 1 << 24;

fn known_format(file: &[u8]) -> DecodeResult<(ImageFormat, &'static str)> {
    let known = [
        (ImageFormat::Png, "PNG"),
        (ImageFormat::Bmp, "BMP"),
        (ImageFormat::Gif, "GIF"),
        (ImageFormat::Tiff, "TIFF"),
        (ImageFormat::WebP, "WebP"),
    ];
    let format = image::guess_format(file).ok();
    let found = known.into_iter().find(|(known, _)| Some(*known) == format);
    found.ok_or_else(|| {
        let begins = file.get(..file.len().min(8)).unwrap_or_default();
        let begins = begins.escape_ascii();
        DecodeError::mismatch(
            "a JPEG, PNG, BMP, GIF, TIFF or WebP file",
            format!("a file of {} bytes that begins with \"{begins}\"", file.len()),
        )
    })
}

/// Converts pixels that the crate `image` decoded to an encoding that ROS has a name for.
fn encoded(color: ColorType, pixels: Vec<u8>) -> Option<(Encoding, Vec<u8>)> {
    /// Takes the upper byte of each 16-bit channel, which `image` leaves in the machine's order.
    fn upper(pixels: &[u8]) -> Vec<u8> {
        let (channels, _) = pixels.as_chunks::<2>();
        channels.iter().map(|&channel| (u16::from_ne_bytes(channel) >> 8) as u8).collect()
    }
    /// Makes colour with alpha of grey with alpha.
    fn spread(pixels: &[u8]) -> Vec<u8> {
        let (pixels, _) = pixels.as_chunks::<2>();
        pixels.iter().flat_map(|&[grey, alpha]| [grey, grey, grey, alpha]).collect()
    }
    let little_endian = |pixels: Vec<u8>, width: usize| {
        let mut pixels = pixels;
        if cfg!(target_endian = "big") {
            crate::types::swap_byte_order(&mut pixels, width);
        }
        pixels
    };
    Some(match color {
        ColorType::L8 => (Encoding::Mono8, pixels),
        ColorType::Rgb8 => (Encoding::Rgb8, pixels),
        ColorType::Rgba8 => (Encoding::Rgba8, pixels),
        ColorType::La8 => (Encoding::Rgba8, spread(&pixels)),
        ColorType::L16 => (Encoding::Mono16, little_endian(pixels, 2)),
        ColorType::Rgb16 => (Encoding::Rgb8, upper(&pixels)),
        ColorType::Rgba16 => (Encoding::Rgba8, upper(&pixels)),
        ColorType::La16 => (Encoding::Rgba8, spread(&upper(&pixels))),
        ColorType::Rgb32F => (Encoding::F32C3, little_endian(pixels, 4)),
        _ => return None,
    })
}

/// Reads the inks in a TIFF file, four bytes a pixel; `None` where it has none.
///
/// # Errors
/// As [`decode`].
pub fn decode_inks(file: &[u8], limits: &Limits) -> DecodeResult<Option<RawPixels>> {
    if !matches!(known_format(file), Ok((ImageFormat::Tiff, _))) {
        return Ok(None);
    }
    tiff(file, limits, "TIFF").map(|(raw, inks)| inks.then_some(raw))
}

/// Converts cyan, magenta, yellow and black to colours, as Pillow does.
pub(crate) fn inks_to_rgb(inks: &RawPixels) -> RawPixels {
    let dense = inks.to_dense();
    let (pixels, _) = dense.data.as_chunks::<4>();
    let colour = |ink: u8, black: u8| {
        let left = u32::from(255 - black);
        let product = u32::from(ink) * left + 128;
        // The quotient is at most `left`.
        (left - (((product >> 8) + product) >> 8).min(left)) as u8
    };
    let data: Vec<u8> = pixels
        .iter()
        .flat_map(|&[c, m, y, k]| [colour(c, k), colour(m, k), colour(y, k)])
        .collect();
    let step = dense.width.saturating_mul(3);
    RawPixels { encoding: Encoding::Rgb8, step, data: data.into(), ..dense }
}

/// Reads the picture in a TIFF file: grey of 1, 8, 16 or 32 bits, colour of 8 bits; true beside it
/// where its four channels are inks, which have no encoding of their own.
fn tiff(file: &[u8], limits: &Limits, name: &'static str) -> DecodeResult<(RawPixels, bool)> {
    claims::check_tiff(file).map_err(|reason| DecodeError::malformed(name, reason))?;
    let fault = |error: tiff::TiffError| DecodeError::malformed(name, error.to_string());
    let mut bounds = tiff::decoder::Limits::default();
    bounds.decoding_buffer_size = limits.message_bytes;
    bounds.intermediate_buffer_size = limits.message_bytes;
    bounds.ifd_value_size = limits.message_bytes.min(1 << 20);
    let mut decoder =
        tiff::decoder::Decoder::new(Cursor::new(file)).map_err(fault)?.with_limits(bounds);
    let color = decoder.colortype().map_err(fault)?;
    let (encoding, pixel_bytes) = match color {
        tiff::ColorType::Gray(1 | 8) => (Encoding::Mono8, 1),
        tiff::ColorType::Gray(16) => (Encoding::Mono16, 2),
        tiff::ColorType::Gray(32) => (Encoding::F32C1, 4),
        tiff::ColorType::RGB(8) => (Encoding::Rgb8, 3),
        tiff::ColorType::RGBA(8) | tiff::ColorType::CMYK(8) => (Encoding::Rgba8, 4),
        other => return Err(DecodeError::malformed(name, format!("pixels of type {other:?}"))),
    };
    let (width, height) = decoder.dimensions().map_err(fault)?;
    let size = u64::from(width) * u64::from(height);
    DecodeError::check_pixels(name, width, height, size.saturating_mul(pixel_bytes), limits)?;
    let (encoding, pixels): (_, Vec<u8>) = match decoder.read_image().map_err(fault)? {
        DecodingResult::U8(bits) if color == tiff::ColorType::Gray(1) => {
            (encoding, unpack_bits(&bits, width as usize))
        }
        DecodingResult::U8(pixels) => (encoding, pixels),
        DecodingResult::U16(pixels) => {
            (encoding, pixels.into_iter().flat_map(u16::to_le_bytes).collect())
        }
        DecodingResult::F32(pixels) => {
            (Encoding::F32C1, pixels.into_iter().flat_map(f32::to_le_bytes).collect())
        }
        DecodingResult::I32(pixels) => {
            (Encoding::I32C1, pixels.into_iter().flat_map(i32::to_le_bytes).collect())
        }
        _ => {
            return Err(DecodeError::malformed(
                name,
                "pixels that are no numbers of 8, 16 or 32 bits",
            ));
        }
    };
    RawPixels::dense(width, height, encoding, pixels)
        .map(|raw| (raw, color == tiff::ColorType::CMYK(8)))
        .map_err(|error| DecodeError::malformed(name, error.to_string()))
}

/// Writes pixels as a file from which they are read unchanged: PNG, or TIFF for 32-bit grey.
/// `bgr8` and `bgra8` become `rgb8` and `rgba8`. One of Pillow's modes may change that: `1` writes `mono8` as one bit a
/// pixel, black for 0, white for everything else; `P` as a palette of greys; `CMYK` takes four bytes a pixel for inks,
/// whatever their encoding says.
///
/// # Errors
/// When the picture is empty, or of an encoding that neither format has.
pub fn encode(pixels: &RawPixels, mode: Option<&str>) -> Result<Bytes, EncodeError> {
    let bits = mode == Some("1");
    let dense = pixels.to_dense();
    let dense = match dense.encoding {
        Encoding::Bgr8 | Encoding::Bgra8 => dense.swap_red_blue(),
        _ => dense,
    };
    let RawPixels { width, height, encoding, .. } = dense;
    let refuse = |remedy: &str| {
        EncodeError::unrepresentable(
            "image file",
            format!("a {encoding} image of {width}x{height}"),
            remedy,
        )
    };
    if width == 0 || height == 0 {
        return Err(refuse("send at least one pixel"));
    }
    let (color, depth) = match encoding {
        Encoding::Rgba8 if mode == Some("CMYK") => {
            return tiff_file(&dense).map_err(|error| refuse(&error.to_string()));
        }
        Encoding::Mono8 if mode == Some("P") => (png::ColorType::Indexed, png::BitDepth::Eight),
        Encoding::Mono8 if bits => (png::ColorType::Grayscale, png::BitDepth::One),
        Encoding::Mono8 => (png::ColorType::Grayscale, png::BitDepth::Eight),
        Encoding::Mono16 => (png::ColorType::Grayscale, png::BitDepth::Sixteen),
        Encoding::Rgb8 => (png::ColorType::Rgb, png::BitDepth::Eight),
        Encoding::Rgba8 => (png::ColorType::Rgba, png::BitDepth::Eight),
        Encoding::F32C1 | Encoding::I32C1 => {
            return tiff_file(&dense).map_err(|error| refuse(&error.to_string()));
        }
        // A picture file has no mosaics: one of greys would be taken for a grey picture.
        _ => {
            return Err(refuse("send it as an array"));
        }
    };
    let data = match depth {
        png::BitDepth::One => pack_bits(&dense.data, width as usize).into(),
        png::BitDepth::Sixteen => {
            let mut data = dense.data.to_vec();
            crate::types::swap_byte_order(&mut data, 2);
            data.into()
        }
        _ => dense.data,
    };
    let mut file = Vec::with_capacity(data.len() / 2 + 1024);
    let mut encoder = png::Encoder::new(&mut file, width, height);
    encoder.set_color(color);
    encoder.set_depth(depth);
    encoder.set_compression(png::Compression::Fast);
    if color == png::ColorType::Indexed {
        encoder.set_palette((0..=255).flat_map(|grey| [grey; 3]).collect::<Vec<u8>>());
    }
    let fault = |error: png::EncodingError| refuse(&error.to_string());
    let mut writer = encoder.write_header().map_err(fault)?;
    writer.write_image_data(&data).map_err(fault)?;
    writer.finish().map_err(fault)?;
    Ok(file.into())
}

fn tiff_file(dense: &RawPixels) -> Result<Bytes, tiff::TiffError> {
    let (values, _) = dense.data.as_chunks::<4>();
    let inks = dense.encoding == Encoding::Rgba8;
    let mut file = Cursor::new(Vec::with_capacity(dense.data.len() + 1024));
    let mut encoder = tiff::encoder::TiffEncoder::new(&mut file)?;
    let (width, height) = (dense.width, dense.height);
    if inks {
        encoder.write_image::<CMYK8>(width, height, &dense.data)?;
    } else if dense.encoding == Encoding::F32C1 {
        let values: Vec<f32> = values.iter().map(|&value| f32::from_le_bytes(value)).collect();
        encoder.write_image::<Gray32Float>(width, height, &values)?;
    } else {
        let values: Vec<i32> = values.iter().map(|&value| i32::from_le_bytes(value)).collect();
        encoder.write_image::<GrayI32>(width, height, &values)?;
    }
    Ok(file.into_inner().into())
}

/// Packs rows of bytes into rows of bits, the first pixel in the highest, rows padded to bytes.
fn pack_bits(pixels: &[u8], width: usize) -> Vec<u8> {
    let eight = |pixels: &[u8]| {
        pixels.iter().enumerate().fold(0_u8, |bits, (index, &pixel)| {
            bits | (u8::from(pixel != 0) << (7_usize.saturating_sub(index)))
        })
    };
    pixels.chunks(width.max(1)).flat_map(|row| row.chunks(8).map(eight)).collect()
}

/// Undoes `pack_bits`: 255 for a set bit.
pub fn unpack_bits(bits: &[u8], width: usize) -> Vec<u8> {
    bits.chunks(width.div_ceil(8).max(1))
        .flat_map(|row| {
            let pixels = row.iter().flat_map(|byte| (0..8).rev().map(move |at| byte >> at & 1));
            pixels.map(|bit| bit * 255).take(width)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn bits_are_packed_as_they_were() {
        let bits = [0b1010_0000, 0b1000_0000, 0xFF, 0x80];
        let pixels = unpack_bits(&bits, 9);
        assert_eq!(pixels.len(), 18);
        assert_eq!(pixels[..9], [255, 0, 255, 0, 0, 0, 0, 0, 255]);
        assert_eq!(pack_bits(&pixels, 9), bits);
    }

    #[test]
    fn other_files_are_refused_by_their_first_bytes() {
        let error = decode(&Bytes::from_static(b"%PDF-1.7\n..."), &Limits::default(), None);
        let error = error.unwrap_err().to_string();
        assert!(error.contains("begins with \"%PDF-1.7\""), "{error}");
    }

    /// Written by Pillow 13: a TIFF of mode `1`, a WebP without loss.
    #[test]
    fn other_writers_files_are_read() {
        let bits =
            b"II*\x00\x08\x00\x00\x00\x08\x00\x00\x01\x04\x00\x01\x00\x00\x00\x09\x00\x00\x00\
            \x01\x01\x04\x00\x01\x00\x00\x00\x02\x00\x00\x00\x03\x01\x03\x00\x01\x00\x00\x00\
            \x01\x00\x00\x00\x06\x01\x03\x00\x01\x00\x00\x00\x01\x00\x00\x00\x11\x01\x04\x00\
            \x01\x00\x00\x00n\x00\x00\x00\x16\x01\x04\x00\x01\x00\x00\x00\x02\x00\x00\x00\
            \x17\x01\x04\x00\x01\x00\x00\x00\x04\x00\x00\x00\x1c\x01\x03\x00\x01\x00\x00\x00\
            \x01\x00\x00\x00\x00\x00\x00\x00\x80\x00\x00\x80";
        let grey = decode(&Bytes::from_static(bits), &Limits::default(), None).unwrap();
        let mut pixels = vec![0; 18];
        (pixels[0], pixels[17]) = (255, 255);
        assert_eq!(grey, RawPixels::dense(9, 2, Encoding::Mono8, pixels).unwrap());

        let webp = Bytes::from_static(
            b"RIFF&\x00\x00\x00WEBPVP8L\x1a\x00\x00\x00/\x02@\x00\x00\x0fp\x0a\xa8+\xf8\x9e\
            \xc2c\xfe\x83\x07\x04\x92\xb6x\xdb\x1f\xd1\xff\xe0",
        );
        let color = decode(&webp, &Limits::default(), None).unwrap();
        let mut pixels = [30, 20, 10].repeat(6);
        pixels[15..].copy_from_slice(&[50, 100, 200]);
        assert_eq!(color, RawPixels::dense(3, 2, Encoding::Bgr8, pixels).unwrap());
        let limits = Limits { message_bytes: 1 << 24, ..Limits::default() };
        let error = decode(&webp, &limits, None).unwrap_err().to_string();
        assert!(error.contains("WebP of 3x2"), "{error}");
    }

    #[test]
    fn the_size_is_checked_before_the_picture_is_made() {
        let pixels = RawPixels::dense(200, 100, Encoding::Rgb8, vec![7; 60_000]).unwrap();
        let floats = RawPixels::dense(200, 75, Encoding::F32C1, vec![0; 60_000]).unwrap();
        for raw in [pixels, floats] {
            let file = encode(&raw, None).unwrap();
            let limits = Limits { message_bytes: 59_999, ..Limits::default() };
            let error = decode(&file, &limits, None).unwrap_err();
            let (actual, limit) = (60_000, 59_999);
            assert!(
                matches!(error, DecodeError::TooLarge { actual: a, limit: l, .. } if (a, l) == (actual, limit)),
                "{error}"
            );
        }
    }

    proptest! {
        #[test]
        fn files_lose_nothing(
            encoding in proptest::sample::select(vec![
                Encoding::Mono8, Encoding::Mono16, Encoding::Rgb8, Encoding::Bgr8,
                Encoding::Rgba8, Encoding::Bgra8, Encoding::I32C1, Encoding::F32C1,
            ]),
            width in 1_u32..20,
            height in 1_u32..20,
            seed: u64,
        ) {
            let size = (width * height) as usize * encoding.bytes_per_pixel();
            let data: Vec<u8> = (0..size as u64).map(|i| (i.wrapping_mul(seed) >> 7) as u8).collect();
            let raw = RawPixels::dense(width, height, encoding, data).unwrap();
            let file = encode(&raw, None).unwrap();
            prop_assert_eq!(decode(&file, &Limits::default(), Some(encoding)).unwrap(), raw);
        }

        #[test]
        fn broken_files_are_refused_or_read(
            kind in 0_usize..2, at in 0_usize..2000, byte: u8, cut in 0_usize..2000,
        ) {
            let encoding = [Encoding::Rgb8, Encoding::F32C1][kind];
            let size = 9 * 7 * encoding.bytes_per_pixel();
            let raw = RawPixels::dense(9, 7, encoding, vec![5; size]).unwrap();
            let file = encode(&raw, None).unwrap();
            let mut broken = file.to_vec();
            let at = at % broken.len();
            broken[at] = byte;
            let limits = Limits { message_bytes: 1 << 16, ..Limits::default() };
            drop(decode(&broken.into(), &limits, None));
            drop(decode(&file.slice(..cut % file.len()), &limits, None));
        }
    }
}
