//! The calibration of a camera, for each of its pictures: `sensor_msgs/msg/CameraInfo`.
//!
//! ```text
//!   header │ rows ──▶ width, height ┐
//!   envelope ──▶ header.stamp       ├─▶ CameraInfo, with the stamp and the frame of the picture
//!   what the camera told ──▶ k, d, p┘   ([`super::super::intrinsics`])
//! ```
//!
//! A camera that has told nothing has a calibration of zeros, which is ROS's word for none.

use bytes::Bytes;
use wrapyfi_yarp::sig::ImageHeader;

use super::super::intrinsics::Intrinsics;
use super::super::options::YarpOptions;
use super::{fault, numbers};
use wrapyfi_data::Limits;
use wrapyfi_data::types::Map;
use wrapyfi_endpoint::codec::{DecodeError, DecodeResult};

/// The size of the picture that a message is; none where it is something else.
pub(super) fn size(bytes: &Bytes, limits: &Limits) -> Option<(usize, usize)> {
    let header = ImageHeader::read(bytes, &fault::limits(limits)).ok()?;
    Some((header.width, header.height))
}

/// The fields of the `CameraInfo` of a picture, without its header.
pub(super) fn info((width, height): (usize, usize), options: &YarpOptions) -> DecodeResult<Map> {
    let size = |value: usize| {
        u32::try_from(value).map_err(|error| DecodeError::malformed("image", error.to_string()))
    };
    let mut fields = Map::from([("width", size(width)?), ("height", size(height)?)]);
    let Some(intrinsics) = &options.intrinsics else { return Ok(fields) };
    let Intrinsics { focal: [fx, fy], center: [cx, cy], model, distortion } = intrinsics;
    let (fx, fy, cx, cy) = (*fx, *fy, *cx, *cy);
    let matrix = [
        ("k", vec![fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]),
        ("r", vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]),
        ("p", vec![fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]),
        ("d", distortion.to_vec()),
    ];
    for (name, values) in matrix {
        fields.insert(name, numbers::field(values)?);
    }
    fields.insert("distortion_model", model.as_str());
    Ok(fields)
}
