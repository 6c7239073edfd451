//! What a message carries, and the names under which configuration and command line ask for it.

use super::{AudioChunk, Image, Value};

/// The content of one message, independent of the middleware that carries it.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Payload {
    /// Any Python object.
    NativeObject(Box<Value>),
    /// A camera frame.
    Image(Image),
    /// A chunk of sound.
    AudioChunk(AudioChunk),
}

/// The kind of a [`Payload`]: Wrapyfi's `data_type`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
#[allow(missing_docs)]
pub enum DataType {
    NativeObject,
    Image,
    AudioChunk,
}

/// What `type:` of a route or `--type` asks for: a data type, and the ROS type that carries it on
/// the ROS 2 side.
///
/// | written | data type | on ROS 2 | on ZeroMQ |
/// | --- | --- | --- | --- |
/// | `NativeObject`, `wrapyfi_msgs/msg/NativeObject` | native object | `wrapyfi_msgs/msg/NativeObject` | JSON |
/// | `std_msgs/msg/String` | native object | `std_msgs/msg/String` holding JSON, as Python Wrapyfi speaks on ROS 2 | JSON |
/// | `Image`, `sensor_msgs/msg/Image` | image | `sensor_msgs/msg/Image` | array, Wrapyfi's `jpg=False` |
/// | `CompressedImage`, `sensor_msgs/msg/CompressedImage` | image | `sensor_msgs/msg/CompressedImage` | JPEG file, `jpg=True` |
/// | `AudioChunk`, `wrapyfi_msgs/msg/AudioChunk` | sound | `wrapyfi_msgs/msg/AudioChunk` | array |
/// | `wrapyfi_ros2_interfaces/msg/ROS2AudioMessage` | sound | upstream's message, with its label | array |
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum MessageType {
    /// `wrapyfi_msgs/msg/NativeObject`.
    NativeObject,
    /// JSON in `std_msgs/msg/String`.
    StringJson,
    /// `sensor_msgs/msg/Image`.
    Image,
    /// `sensor_msgs/msg/CompressedImage`.
    CompressedImage,
    /// `wrapyfi_msgs/msg/AudioChunk`.
    AudioChunk,
    /// `wrapyfi_ros2_interfaces/msg/ROS2AudioMessage`.
    UpstreamAudio,
}

impl MessageType {
    /// Every type, for messages that list what may be written.
    pub const ALL: [Self; 6] = [
        Self::NativeObject,
        Self::StringJson,
        Self::Image,
        Self::CompressedImage,
        Self::AudioChunk,
        Self::UpstreamAudio,
    ];

    /// The kind of payload it carries.
    #[must_use]
    pub fn data_type(self) -> DataType {
        match self {
            Self::NativeObject | Self::StringJson => DataType::NativeObject,
            Self::Image | Self::CompressedImage => DataType::Image,
            Self::AudioChunk | Self::UpstreamAudio => DataType::AudioChunk,
        }
    }

    /// Name of the ROS 2 type, for instance `sensor_msgs/msg/Image`.
    #[must_use]
    pub fn ros_type(self) -> &'static str {
        match self {
            Self::NativeObject => "wrapyfi_msgs/msg/NativeObject",
            Self::StringJson => "std_msgs/msg/String",
            Self::Image => "sensor_msgs/msg/Image",
            Self::CompressedImage => "sensor_msgs/msg/CompressedImage",
            Self::AudioChunk => "wrapyfi_msgs/msg/AudioChunk",
            Self::UpstreamAudio => "wrapyfi_ros2_interfaces/msg/ROS2AudioMessage",
        }
    }
}

/// A text names no message type.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("type {0:?} is not known")]
pub struct UnknownType(pub String);

impl std::str::FromStr for MessageType {
    type Err = UnknownType;
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Self::ALL
            .into_iter()
            .find(|t| t.ros_type() == text || t.ros_type().rsplit('/').next() == Some(text))
            .ok_or_else(|| UnknownType(text.to_owned()))
    }
}
