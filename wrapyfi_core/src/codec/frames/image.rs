//! The body of an image: a JSON array, or a file.

use bytes::Bytes;

use crate::codec::{DecodeError, EncodeError, convert, json};
use crate::endpoint::TopicSpec;
use crate::types::{
    CompressedFormat, Dtype, Encoding, Image, MessageType, Pixels, RawPixels, Stamp, Tensor, Value,
};

pub(super) fn decode(body: &Bytes, stamp: Stamp, spec: &TopicSpec) -> Result<Image, DecodeError> {
    if let Some(format) = CompressedFormat::sniff(body) {
        return Ok(Image::new(stamp, Pixels::Compressed { format, data: body.clone() }));
    }
    match json::decode(body, &spec.limits)? {
        Value::Tensor(tensor) => {
            raw_pixels(&tensor, spec.color_order).map(|raw| Image::new(stamp, raw))
        }
        other => Err(DecodeError::Mismatch {
            expected: "an image as array".into(),
            actual: other.kind().into(),
        }),
    }
}

/// The picture in an array of shape (height, width) or (height, width, channels).
fn raw_pixels(tensor: &Tensor, color_order: Encoding) -> Result<RawPixels, DecodeError> {
    let mismatch = || DecodeError::Mismatch {
        expected: "uint8 of shape (H, W), (H, W, 3) or (H, W, 4), float32 of shape (H, W) or \
                   (H, W, 3), or uint16 of shape (H, W)"
            .into(),
        actual: format!("{} of shape {:?}", tensor.dtype, tensor.shape),
    };
    let (height, width, channels) = match *tensor.shape {
        [height, width] => (height, width, 1),
        [height, width, channels] => (height, width, channels),
        _ => return Err(mismatch()),
    };
    let red_first = matches!(color_order, Encoding::Rgb8 | Encoding::Rgba8);
    let encoding = match (tensor.dtype, channels) {
        (Dtype::U8, 1) => Encoding::Mono8,
        (Dtype::U8, 3) if red_first => Encoding::Rgb8,
        (Dtype::U8, 3) => Encoding::Bgr8,
        (Dtype::U8, 4) if red_first => Encoding::Rgba8,
        (Dtype::U8, 4) => Encoding::Bgra8,
        (Dtype::U16, 1) => Encoding::Mono16,
        (Dtype::F32, 1) => Encoding::F32C1,
        (Dtype::F32, 3) => Encoding::F32C3,
        _ => return Err(mismatch()),
    };
    let (Ok(width), Ok(height)) = (u32::try_from(width), u32::try_from(height)) else {
        return Err(mismatch());
    };
    RawPixels::dense(width, height, encoding, tensor.data.clone()).map_err(|error| {
        DecodeError::Malformed { format: "image", path: "$".into(), reason: error.to_string() }
    })
}

pub(super) fn encode(image: &Image, spec: &TopicSpec) -> Result<Vec<u8>, EncodeError> {
    let image = convert(image.clone(), spec.message_type, spec.color_order, &spec.limits)?;
    match image.pixels {
        Pixels::Compressed { data, .. } => Ok(data.into()),
        Pixels::Raw(raw) => json::encode(&Value::Tensor(array(raw, spec)?)),
    }
}

/// The array for a picture, in the channel order that the topic has.
fn array(raw: RawPixels, spec: &TopicSpec) -> Result<Tensor, EncodeError> {
    debug_assert_eq!(spec.message_type, MessageType::Image);
    let dense = raw.to_dense();
    let order = spec.color_order;
    let other_order = match dense.encoding {
        Encoding::Rgb8 | Encoding::Rgba8 => matches!(order, Encoding::Bgr8 | Encoding::Bgra8),
        Encoding::Bgr8 | Encoding::Bgra8 => matches!(order, Encoding::Rgb8 | Encoding::Rgba8),
        _ => false,
    };
    drop(raw);
    let dense = if other_order { dense.swap_red_blue() } else { dense };
    let dtype = match dense.encoding {
        Encoding::Mono16 => Dtype::U16,
        Encoding::F32C1 | Encoding::F32C3 => Dtype::F32,
        _ => Dtype::U8,
    };
    let mut shape = vec![dense.height as usize, dense.width as usize];
    if dense.encoding.channels() > 1 {
        shape.push(dense.encoding.channels());
    }
    let what = format!("{} image of {}x{}", dense.encoding, dense.width, dense.height);
    Tensor::new(dtype, shape, dense.data).map_err(|error| EncodeError::Unrepresentable {
        format: "array",
        what,
        path: "$".into(),
        remedy: format!("its bytes do not fit: {error}"),
    })
}
