//! The body of an image: a JSON array, or a file.

use bytes::Bytes;

use crate::TopicSpec;
use crate::codec::{DecodeError, EncodeError, json, picture};
use wrapyfi_data::types::{CompressedFormat, Encoding, Image, Pixels, Stamp, Value};

pub(super) fn decode(
    body: &Bytes,
    stamp: Stamp,
    color_order: Encoding,
    spec: &TopicSpec,
) -> Result<Image, DecodeError> {
    if let Some(format) = CompressedFormat::sniff(body) {
        return Ok(Image::new(stamp, Pixels::Compressed { format, data: body.clone() }));
    }
    match json::decode(body, &spec.limits)? {
        value @ Value::Tensor(_) => Image::from_value(&value, color_order, stamp),
        other => Err(DecodeError::Mismatch {
            expected: "an image as array".into(),
            actual: other.kind().into(),
        }),
    }
}

/// Body of an image that has the form of its type, and the order of its channels where it is an array of colours.
pub(super) fn encode(
    image: &Image,
    spec: &TopicSpec,
) -> Result<(Vec<u8>, Option<Encoding>), EncodeError> {
    match &image.pixels {
        Pixels::Compressed { data, .. } => Ok((data.to_vec(), None)),
        Pixels::Raw(raw) => {
            let order = raw.encoding.color_order().map(|_| spec.color_order);
            let array = picture::array(raw.clone(), spec.color_order)?;
            Ok((json::encode(&Value::Tensor(array))?, order))
        }
    }
}
