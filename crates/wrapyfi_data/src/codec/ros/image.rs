//! Camera frames: `sensor_msgs/msg/Image` and `CompressedImage`.

use wrapyfi_interfaces::sensor_msgs::msg;

use super::part::{
    contradictory, countable, describe_pixels, header, little_endian, misfit, quote, stamp,
};
use crate::codec::{DecodeError, EncodeError};
use crate::types::{CompressedFormat, Encoding, Image, Pixels, RawPixels};

/// The fields of an uncompressed image.
pub(in crate::codec) fn raw_message(image: &Image) -> Result<msg::Image, EncodeError> {
    let Pixels::Raw(raw) = &image.pixels else {
        return Err(mismatch("a raw image for sensor_msgs/msg/Image", &image.pixels));
    };
    RawPixels::new(raw.width, raw.height, raw.encoding, raw.step, raw.data.clone())
        .map_err(|error| contradictory("image", &error, "RawPixels::new"))?;
    countable("data", raw.data.len())?;
    Ok(msg::Image {
        header: header(image.stamp, &image.frame_id),
        height: raw.height,
        width: raw.width,
        encoding: raw.encoding.name().to_owned(),
        is_bigendian: 0,
        step: raw.step,
        data: raw.data.clone(),
    })
}

/// The fields of an image file.
pub(in crate::codec) fn file_message(image: &Image) -> Result<msg::CompressedImage, EncodeError> {
    let Pixels::Compressed { format, data } = &image.pixels else {
        let expected = "a jpeg or png image for sensor_msgs/msg/CompressedImage";
        return Err(mismatch(expected, &image.pixels));
    };
    countable("data", data.len())?;
    Ok(msg::CompressedImage {
        header: header(image.stamp, &image.frame_id),
        format: format.name().to_owned(),
        data: data.clone(),
    })
}

fn mismatch(expected: &str, pixels: &Pixels) -> EncodeError {
    EncodeError::mismatch(expected.to_owned(), describe_pixels(pixels))
}

pub(in crate::codec) fn decode_raw(message: msg::Image) -> Result<Image, DecodeError> {
    let stamp = stamp(&message.header);
    let msg::Image { header, height, width, encoding, is_bigendian, step, data } = message;
    let encoding = Encoding::from_name(&encoding).ok_or_else(|| {
        DecodeError::mismatch(
            format!("an image encoded as {}", Encoding::ALL.map(Encoding::name).join(", ")),
            quote(&encoding),
        )
    })?;
    let mut raw = RawPixels::new(width, height, encoding, step, data).map_err(|e| misfit(&e))?;
    let value_size = encoding.bytes_per_pixel() / encoding.channels();
    if is_bigendian != 0 && value_size > 1 {
        raw.data = little_endian(&raw.data, value_size, step as usize);
    }
    Ok(Image { stamp, frame_id: header.frame_id, pixels: raw.into() })
}

pub(in crate::codec) fn decode_file(message: msg::CompressedImage) -> Result<Image, DecodeError> {
    let stamp = stamp(&message.header);
    let msg::CompressedImage { header, format, data } = message;
    let unknown =
        || DecodeError::mismatch("a jpeg or png image", format!("format {}", quote(&format)));
    let label = format.to_ascii_lowercase();
    // compressed_depth_image_transport puts a header of its own before the PNG file.
    if label.contains("compresseddepth") {
        return Err(unknown());
    }
    let labelled = if label.contains("jpeg") || label.contains("jpg") {
        Some(CompressedFormat::Jpeg)
    } else if label.contains("png") {
        Some(CompressedFormat::Png)
    } else {
        None
    };
    // The file knows better than its label.
    let format = CompressedFormat::sniff(&data).or(labelled).ok_or_else(unknown)?;
    Ok(Image { stamp, frame_id: header.frame_id, pixels: Pixels::Compressed { format, data } })
}
