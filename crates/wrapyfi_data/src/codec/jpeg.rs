//! JPEG files, and images in the form that a message type carries.
//!
//! ```text
//!   RawPixels ── encode (quality 95, 4:2:0 as OpenCV does) ──▶ file
//!   file ── header (size, scans: checked first) ── decode into the wanted channel order ──▶ RawPixels
//! ```

use bytes::Bytes;

use super::error::{DecodeError, EncodeError, EncodeResult};
#[cfg(not(feature = "jpeg"))]
pub use super::jpeg_absent::{decode, encode};
#[cfg(feature = "jpeg")]
pub use super::jpeg_file::{decode, encode};
use crate::Limits;
use crate::types::{CompressedFormat, Encoding, Image, MessageType, Payload, Pixels, RawPixels};

/// Quality with which Wrapyfi compresses, by OpenCV's default.
pub const WRAPYFI_QUALITY: u8 = 95;

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
) -> EncodeResult<Image> {
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

/// Checks that a picture has the form of messages of type `to`: pixels, or a file.
///
/// # Errors
/// A mismatch when it has the other one.
pub fn check_form(payload: &Payload, to: MessageType) -> EncodeResult<()> {
    let Payload::Image(image) = payload else { return Ok(()) };
    match (&image.pixels, to) {
        (Pixels::Raw(_), MessageType::CompressedImage)
        | (Pixels::Compressed { .. }, MessageType::Image) => {
            Err(EncodeError::mismatch(to.ros_type(), super::ros::describe(payload)))
        }
        _ => Ok(()),
    }
}

fn decompress(
    format: CompressedFormat,
    file: &Bytes,
    limits: &Limits,
    color_order: Encoding,
) -> EncodeResult<RawPixels> {
    let decoded = match format {
        CompressedFormat::Jpeg => decode(file, limits, Some(color_order)),
        #[cfg(feature = "pictures")]
        CompressedFormat::Png => super::image_file::decode(file, limits, Some(color_order)),
        #[cfg(not(feature = "pictures"))]
        CompressedFormat::Png => {
            Err(DecodeError::mismatch("JPEG, or a program built with feature `pictures`", "PNG"))
        }
    };
    decoded.map_err(|error| match error {
        DecodeError::TooLarge { actual, limit, .. } => EncodeError::TooLarge { actual, limit },
        error => EncodeError::unrepresentable(
            "uncompressed image",
            error.to_string(),
            "check the sender",
        ),
    })
}

#[cfg(test)]
#[cfg(feature = "jpeg")]
mod tests {
    use proptest::prelude::*;

    use super::super::jpeg_file::without_black;
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

    #[cfg(feature = "pictures")]
    #[test]
    fn a_png_file_becomes_pixels() {
        let limits = Limits::default();
        let file = crate::codec::image_file::encode(&picture(Encoding::Rgb8, &[9, 90, 200]), None)
            .unwrap();
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
