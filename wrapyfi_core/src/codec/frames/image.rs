//! The body of an image: a JSON array, or a file.

use bytes::Bytes;

use crate::codec::{DecodeError, EncodeError, convert, json, picture};
use crate::endpoint::TopicSpec;
use crate::types::{CompressedFormat, Image, Pixels, Stamp, Value};

pub(super) fn decode(body: &Bytes, stamp: Stamp, spec: &TopicSpec) -> Result<Image, DecodeError> {
    if let Some(format) = CompressedFormat::sniff(body) {
        return Ok(Image::new(stamp, Pixels::Compressed { format, data: body.clone() }));
    }
    match json::decode(body, &spec.limits)? {
        value @ Value::Tensor(_) => Image::from_value(&value, spec.color_order, stamp),
        other => Err(DecodeError::Mismatch {
            expected: "an image as array".into(),
            actual: other.kind().into(),
        }),
    }
}

pub(super) fn encode(image: &Image, spec: &TopicSpec) -> Result<Vec<u8>, EncodeError> {
    let image = convert(image.clone(), spec.message_type, spec.color_order, &spec.limits)?;
    match image.pixels {
        Pixels::Compressed { data, .. } => Ok(data.into()),
        Pixels::Raw(raw) => json::encode(&Value::Tensor(picture::array(raw, spec.color_order)?)),
    }
}
