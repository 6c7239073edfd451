//! The data model: what travels, whichever middleware carries it.
//!
//! | type | holds | ROS 2 type |
//! | --- | --- | --- |
//! | [`Value`] | any Python object | `wrapyfi_msgs/msg/NativeObject` |
//! | [`Tensor`] | an array of numbers | `wrapyfi_msgs/msg/Tensor` |
//! | [`Image`] | a camera frame | `sensor_msgs/msg/Image`, `CompressedImage` |
//! | [`AudioChunk`] | sound | `wrapyfi_msgs/msg/AudioChunk` |
//!
//! Payload bytes are [`bytes::Bytes`]: passing a value on shares them.

mod audio;
mod image;
mod payload;
mod stamp;
mod tensor;
mod value;

pub use audio::{AudioChunk, SampleFormat};
pub use image::{CompressedFormat, Encoding, Image, Pixels, RawPixels};
pub use payload::{DataType, MessageType, Payload};
pub use stamp::Stamp;
pub use tensor::{Dtype, NumpyArray, Tensor};
pub use value::{DateTime, Map, Tagged, Value};
