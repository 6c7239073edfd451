//! The data model, which is the same for all middlewares.
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

#[cfg(feature = "tables")]
pub mod arrow;
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
mod parameter_message;
mod payload;
mod properties;
mod ros_action;
mod ros_message;
mod ros_service;
mod ros_type;
mod ros_value;
mod service_kind;
mod shape;
mod stamp;
#[cfg(feature = "tables")]
mod table;
#[cfg(not(feature = "tables"))]
#[path = "no_table.rs"]
mod table;
#[cfg(feature = "tables")]
mod table_text;
mod tensor;
mod typed;
mod value;

#[cfg(feature = "candle")]
pub use self::candle::CandleError;
pub use audio::{AudioChunk, SampleFormat};
pub use datetime::{DateTime, ParseDateTimeError};
pub use dtype::Dtype;
pub use element::{Element, into_bytes, swap_byte_order};
pub use header::{Header, HeaderChange};
pub use image::{CompressedFormat, Encoding, Image, Pixels, RawPixels};
pub use labelled::{Labelled, LabelledContent, Picture, Quantity, Variable};
pub use map::Map;
pub use native_object::NativeObject;
pub use nested::{nested_list, rectangular};
pub use object::{ForeignObject, PluginObject};
pub use origin::Origin;
pub use parameter::{ParameterType, ParameterValue};
pub use parameter_message::UnknownType;
pub use payload::{DataType, MessageType, MessageTypeError, ParseTypeError, Payload};
pub use properties::{Properties, PropertiesError};
pub use ros_action::RosAction;
pub use ros_message::{ReadError, RosMessage};
pub use ros_service::RosService;
pub use ros_type::{MAX_ROS_TYPES, RosType, RosTypeError};
pub use ros_value::{RosValueError, fields_of, fields_of_call, fields_of_return, value_of};
pub use service_kind::ServiceKind;
pub use shape::{ShapeError, element_count};
pub use stamp::Stamp;
pub use table::Table;
pub use tensor::{NumpyArray, Tensor};
#[cfg(feature = "ndarray")]
pub use typed::as_tensor;
pub use typed::{MAX_DEPTH, TypedError, from_value, to_value};
pub use value::{Tagged, Value};

pub(crate) use map::unique_members;
