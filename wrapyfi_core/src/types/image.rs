//! Camera frames.

use bytes::Bytes;

use super::Stamp;

/// One frame: `sensor_msgs/msg/Image` or `CompressedImage` in ROS 2, an `(H, W, 3)` or `(H, W)`
/// array or a JPEG file in Wrapyfi.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Image {
    /// When the frame was taken; reception time where the sender does not say.
    pub stamp: Stamp,
    /// Coordinate frame; empty from Wrapyfi.
    pub frame_id: String,
    /// The picture.
    pub pixels: Pixels,
}

/// The picture of an [`Image`]: stays compressed until a consumer needs pixels.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Pixels {
    /// Uncompressed rows.
    Raw(RawPixels),
    /// A complete image file.
    Compressed {
        /// `jpeg` or `png`, as `sensor_msgs/msg/CompressedImage.format` begins.
        format: CompressedFormat,
        /// The file.
        data: Bytes,
    },
}

/// Format of a compressed [`Image`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
#[allow(missing_docs)]
pub enum CompressedFormat {
    Jpeg,
    Png,
}

/// Uncompressed rows of pixels.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RawPixels {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Channels, their order and their type.
    pub encoding: Encoding,
    /// Bytes from one row to the next, at least `width * encoding.bytes_per_pixel()`.
    pub step: u32,
    /// `height * step` bytes, little-endian.
    pub data: Bytes,
}

/// Pixel encodings, by their names in `sensor_msgs/image_encodings.hpp`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
#[allow(missing_docs)]
pub enum Encoding {
    Mono8,
    Mono16,
    Rgb8,
    Bgr8,
    Rgba8,
    Bgra8,
    F32C1,
    F32C3,
}
