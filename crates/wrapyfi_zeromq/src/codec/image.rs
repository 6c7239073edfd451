//! The body of an image: a JSON array, or a file.

use bytes::Bytes;

use wrapyfi_data::codec::{DecodeError, DecodeResult, EncodeResult, json, picture};
use wrapyfi_data::types::{CompressedFormat, Encoding, Image, Pixels, Stamp, Value};
use wrapyfi_endpoint::TopicSpec;

pub(super) fn decode(
    body: &Bytes,
    stamp: Stamp,
    color_order: Encoding,
    spec: &TopicSpec,
) -> DecodeResult<Image> {
    if let Some(format) = CompressedFormat::sniff(body) {
        return Ok(Image::new(stamp, Pixels::Compressed { format, data: body.clone() }));
    }
    match json::decode(body, &spec.limits, &spec.plugins)? {
        value @ Value::Tensor(_) => Image::from_value(&value, color_order, stamp),
        other => Err(DecodeError::mismatch("an image as array", other.kind())),
    }
}

/// Body of an image that has the form of its type, and the order of its channels where it is an array of colours.
pub(super) fn encode(image: &Image, spec: &TopicSpec) -> EncodeResult<(Vec<u8>, Option<Encoding>)> {
    match &image.pixels {
        Pixels::Compressed { data, .. } => Ok((data.to_vec(), None)),
        Pixels::Raw(raw) => {
            let order = raw.encoding.color_order().map(|_| spec.color_order);
            let array = picture::array(raw.clone(), spec.color_order)?;
            Ok((json::encode(&Value::Tensor(array), &spec.plugins)?, order))
        }
    }
}
