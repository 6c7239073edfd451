//! The data model: what travels, whichever middleware carries it.
//!
//! | type | holds | ROS 2 type |
//! | --- | --- | --- |
//! | [`Value`] | any Python object | `wrapyfi_msgs/msg/NativeObject` |
//! | [`Tensor`] | an array of numbers | `wrapyfi_msgs/msg/Tensor` |
//! | [`Table`] | a data frame as Arrow columns | `wrapyfi_msgs/msg/NativeObject` |
//! | [`Image`] | a camera frame | `sensor_msgs/msg/Image`, `CompressedImage` |
//! | [`AudioChunk`] | sound | `wrapyfi_msgs/msg/AudioChunk` |
//! | [`Properties`] | named parameters | the parameters of a node |
//! | [`RosMessage`] | a ROS message of any type | itself |
//!
//! Payload bytes are [`bytes::Bytes`]: passing a value on shares them.

mod audio;
#[cfg(feature = "candle")]
mod candle;
mod datetime;
mod dtype;
mod element;
mod header;
mod image;
mod labelled;
mod map;
mod native_object;
mod nested;
mod object;
mod origin;
mod parameter;
mod payload;
mod properties;
mod ros_message;
mod ros_service;
mod ros_type;
mod ros_value;
mod service_kind;
mod shape;
mod stamp;
mod table;
mod table_text;
mod tensor;
mod typed;
mod value;

#[cfg(feature = "candle")]
pub use self::candle::CandleError;
pub use audio::{AudioChunk, SampleFormat};
pub use datetime::{DateTime, ParseDateTimeError};
pub use dtype::Dtype;
pub use element::Element;
pub use header::{Header, HeaderChange};
pub use image::{CompressedFormat, Encoding, Image, Pixels, RawPixels};
pub use labelled::{Labelled, LabelledContent, Picture, Quantity, Variable};
pub use map::Map;
pub use native_object::NativeObject;
pub use object::{ForeignObject, PluginObject};
pub use origin::Origin;
pub use parameter::{ParameterType, ParameterValue};
pub use payload::{DataType, MessageType, MessageTypeError, ParseTypeError, Payload};
pub use properties::{Properties, PropertiesError};
pub use ros_message::RosMessage;
pub use ros_service::RosService;
pub use ros_type::{MAX_ROS_TYPES, RosType, RosTypeError};
pub use ros_value::RosValueError;
pub use service_kind::{ParseServiceError, ServiceKind, ServiceKindError};
pub use shape::ShapeError;
pub use stamp::Stamp;
pub use table::Table;
pub use tensor::{NumpyArray, Tensor};
pub use typed::{MAX_DEPTH, TypedError, as_tensor, from_value, to_value};
pub use value::{Tagged, Value};

pub(crate) use element::swap_byte_order;
pub(crate) use map::unique_members;
pub(crate) use nested::{nested_list, rectangular};
#[allow(unused_imports, reason = "which of them are used depends on the middlewares")]
pub(crate) use ros_value::{fields_of, fields_of_call, fields_of_return, value_of};
pub(crate) use shape::element_count;
