//! Kinds of values that a function returns, and the names under which services are asked for.

use std::fmt;
use std::str::FromStr;

use wrapyfi_interfaces::store::TypeStore;

use super::{DataType, MessageType, MessageTypeError, ParseTypeError, RosService};

/// Type that `--type` of `call` and `serve` names: the kind of payload that a function of Wrapyfi
/// returns, and the ROS service that carries it on the ROS 2 side.
///
/// | written | returns | on ROS 2 | on ZeroMQ |
/// | --- | --- | --- | --- |
/// | `NativeObject`, `wrapyfi_msgs/srv/NativeObjectService` | native object | that service | JSON |
/// | `Image`, `wrapyfi_msgs/srv/ImageService` | image | that service | lists of numbers |
/// | `AudioChunk`, `wrapyfi_msgs/srv/AudioService` | sound | that service | lists of numbers |
/// | `wrapyfi_ros2_interfaces/srv/ROS2NativeObjectService` | native object | as Python Wrapyfi serves it | JSON |
/// | `wrapyfi_ros2_interfaces/srv/ROS2ImageService` | image | as Python Wrapyfi serves it | lists of numbers |
/// | `CompressedImage`, `wrapyfi_ros2_interfaces/srv/ROS2CompressedImageService` | image | as Python Wrapyfi serves it | JPEG file, `jpg=True` |
/// | `wrapyfi_ros2_interfaces/srv/ROS2AudioService` | sound | as Python Wrapyfi serves it | lists of numbers |
/// | any other `package/srv/Type` | dict of the reply's fields | itself: arguments are the request's fields, by name or in order | JSON |
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::types; }
/// use wrapyfi_core::types::{DataType, ServiceKind};
/// let snapshot: ServiceKind = "Image".parse()?;
/// assert_eq!(snapshot.ros_type(), "wrapyfi_msgs/srv/ImageService");
/// assert_eq!((snapshot.data_type(), snapshot.is_upstream()), (DataType::Image, false));
/// # Ok::<(), wrapyfi_data::types::ParseTypeError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ServiceKind {
    /// `wrapyfi_msgs/srv/NativeObjectService`.
    NativeObject,
    /// `wrapyfi_msgs/srv/ImageService`.
    Image,
    /// `wrapyfi_ros2_interfaces/srv/ROS2CompressedImageService`.
    CompressedImage,
    /// `wrapyfi_msgs/srv/AudioService`.
    AudioChunk,
    /// `wrapyfi_ros2_interfaces/srv/ROS2NativeObjectService`.
    UpstreamNativeObject,
    /// `wrapyfi_ros2_interfaces/srv/ROS2ImageService`.
    UpstreamImage,
    /// `wrapyfi_ros2_interfaces/srv/ROS2AudioService`.
    UpstreamAudio,
    /// Any other service of ROS 2, known at run time: arguments are the fields of its request, and
    /// the result is a dict of the fields of its reply.
    Ros(RosService),
}

impl ServiceKind {
    /// All kinds with names of their own, for errors that list them.
    pub const ALL: [Self; 7] = [
        Self::NativeObject,
        Self::Image,
        Self::CompressedImage,
        Self::AudioChunk,
        Self::UpstreamNativeObject,
        Self::UpstreamImage,
        Self::UpstreamAudio,
    ];

    /// Name of the ROS 2 service type, for instance `wrapyfi_msgs/srv/ImageService`.
    pub fn ros_type(self) -> &'static str {
        match self {
            Self::NativeObject => "wrapyfi_msgs/srv/NativeObjectService",
            Self::Image => "wrapyfi_msgs/srv/ImageService",
            Self::CompressedImage => "wrapyfi_ros2_interfaces/srv/ROS2CompressedImageService",
            Self::AudioChunk => "wrapyfi_msgs/srv/AudioService",
            Self::UpstreamNativeObject => "wrapyfi_ros2_interfaces/srv/ROS2NativeObjectService",
            Self::UpstreamImage => "wrapyfi_ros2_interfaces/srv/ROS2ImageService",
            Self::UpstreamAudio => "wrapyfi_ros2_interfaces/srv/ROS2AudioService",
            Self::Ros(service) => service.name(),
        }
    }

    /// Short name, where there is one: `NativeObject`, `Image`, `CompressedImage`, `AudioChunk`.
    pub fn short_name(self) -> Option<&'static str> {
        match self {
            Self::NativeObject => Some("NativeObject"),
            Self::Image => Some("Image"),
            Self::CompressedImage => Some("CompressedImage"),
            Self::AudioChunk => Some("AudioChunk"),
            Self::UpstreamNativeObject
            | Self::UpstreamImage
            | Self::UpstreamAudio
            | Self::Ros(_) => None,
        }
    }

    /// True when the ROS type is Python Wrapyfi's own, whose replies have no room for an error.
    pub fn is_upstream(self) -> bool {
        !matches!(self, Self::Ros(_)) && self.ros_type().starts_with("wrapyfi_ros2_interfaces/")
    }

    /// Type of message that holds a reply's payload.
    pub fn message_type(self) -> MessageType {
        match self {
            Self::NativeObject | Self::Ros(_) => MessageType::NativeObject,
            Self::UpstreamNativeObject => MessageType::StringJson,
            Self::Image | Self::UpstreamImage => MessageType::Image,
            Self::CompressedImage => MessageType::CompressedImage,
            Self::AudioChunk => MessageType::AudioChunk,
            Self::UpstreamAudio => MessageType::UpstreamAudio,
        }
    }

    /// Kind of payload in replies.
    pub fn data_type(self) -> DataType {
        self.message_type().data_type()
    }
}

impl ServiceKind {
    /// Reads a kind as [`ServiceKind::from_str`] does; any other name of a ROS service is looked up
    /// in `store`.
    ///
    /// # Errors
    /// When the text is no name of a service, or the definition cannot be found or used.
    #[doc(hidden)]
    pub fn resolve(text: &str, store: &mut TypeStore) -> Result<Self, MessageTypeError> {
        super::payload::resolve(text, store, "service as package/srv/Type", |found| {
            RosService::new(found).map(Self::Ros)
        })
    }
}

impl fmt::Display for ServiceKind {
    /// Writes the shortest name that [`ServiceKind::from_str`] reads.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.short_name().unwrap_or_else(|| self.ros_type()))
    }
}

impl FromStr for ServiceKind {
    type Err = ParseTypeError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let named = |kind: &Self| kind.short_name() == Some(text) || kind.ros_type() == text;
        Self::ALL.into_iter().find(named).ok_or_else(|| {
            let names = Self::ALL.map(|kind| kind.short_name().unwrap_or(kind.ros_type()));
            ParseTypeError::new(text, "function of Wrapyfi", &names, "srv")
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_spelling_is_read() {
        for kind in ServiceKind::ALL {
            assert_eq!(kind.to_string().parse(), Ok(kind));
            assert_eq!(kind.ros_type().parse(), Ok(kind));
        }
    }

    #[test]
    fn a_wrong_spelling_is_told_the_right_ones() {
        let error = "std_srvs/srv/SetBool".parse::<ServiceKind>().unwrap_err().to_string();
        assert!(error.contains("no function of Wrapyfi; accepted are NativeObject, Image, "));
        let error = "SetBool".parse::<ServiceKind>().unwrap_err().to_string();
        assert!(error.contains("did you mean `std_srvs/srv/SetBool`? "), "{error}");
        let error = "Imag".parse::<ServiceKind>().unwrap_err().to_string();
        assert!(error.contains("did you mean `Image`? accepted are"), "{error}");
    }
}
