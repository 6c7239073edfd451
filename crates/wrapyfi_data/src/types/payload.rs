//! Payloads of messages, and the names under which configuration and command line ask for them.

use std::fmt;
use std::str::FromStr;

use super::{
    AudioChunk, Image, NativeObject, Properties, RosMessage, RosType, RosTypeError, Value,
};
use wrapyfi_interfaces::did_you_mean;
use wrapyfi_interfaces::named;
use wrapyfi_interfaces::store::{ResolveError, ResolvedType, TypeStore};

/// The content of one message, independent of the middleware that carries it.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::types; }
/// use wrapyfi_core::types::{DataType, Payload, Value};
/// let payload = Payload::from(Value::from("hello"));
/// assert_eq!(payload.data_type(), DataType::NativeObject);
/// let Payload::NativeObject(object) = payload else { panic!("no native object") };
/// assert_eq!(object.as_str(), Some("hello"));
/// ```
#[derive(Debug, Clone, PartialEq)]
pub enum Payload {
    /// Any Python object.
    NativeObject(Box<NativeObject>),
    /// A camera frame.
    Image(Image),
    /// A chunk of sound.
    AudioChunk(AudioChunk),
    /// Named parameters, or changes of them, in which one without a value is deleted.
    Properties(Properties),
    /// A ROS message of a type known while running.
    RosMessage(RosMessage),
}

impl Payload {
    /// Kind of the payload.
    pub fn data_type(&self) -> DataType {
        match self {
            Self::NativeObject(_) => DataType::NativeObject,
            Self::Image(_) => DataType::Image,
            Self::AudioChunk(_) => DataType::AudioChunk,
            Self::Properties(_) => DataType::Properties,
            Self::RosMessage(_) => DataType::RosMessage,
        }
    }
}

macro_rules! from {
    ($($source:ty => |$content:ident| $target:expr,)*) => {$(
        impl From<$source> for Payload {
            fn from($content: $source) -> Self {
                $target
            }
        }
    )*};
}

from! {
    Value => |value| NativeObject::from(value).into(),
    NativeObject => |object| Self::NativeObject(Box::new(object)),
    Image => |image| Self::Image(image),
    Properties => |properties| Self::Properties(properties),
    RosMessage => |message| Self::RosMessage(message),
    AudioChunk => |sound| Self::AudioChunk(sound),
}

named! {
    /// The kind of a [`Payload`]: Wrapyfi's `data_type`.
    ///
    /// ```
    /// # mod wrapyfi_core { pub use wrapyfi_data::types; }
    /// use wrapyfi_core::types::DataType;
    /// assert_eq!("ROSMessage".parse(), Ok(DataType::RosMessage));
    /// assert_eq!(DataType::AudioChunk.to_string(), "AudioChunk");
    /// ```
    #[allow(missing_docs)]
    pub enum DataType {
        NativeObject => "NativeObject",
        Image => "Image",
        AudioChunk => "AudioChunk",
        Properties => "Properties",
        RosMessage => "ROSMessage",
    }
    /// Wrapyfi's name: `NativeObject`, `Image`, `AudioChunk`, `Properties`, `ROSMessage`.
    pub fn name, from_name;
}

/// Error of reading the name of a type; the text lists the known ones.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::types; }
/// use wrapyfi_core::types::DataType;
/// let error = "Imgae".parse::<DataType>().unwrap_err();
/// assert!(error.to_string().starts_with("\"Imgae\" is no message type; did you mean `Image`? "));
/// ```
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{text:?} is no {wanted}; {hint}accepted are {accepted}")]
pub struct ParseTypeError {
    text: String,
    wanted: &'static str,
    hint: String,
    accepted: String,
}

const MESSAGE_TYPE: &str = "message type";

impl ParseTypeError {
    /// `kind` is that of the types of ROS which may be written, too: `msg` or `srv`.
    pub(super) fn new(text: &str, wanted: &'static str, accepted: &[&str], kind: &str) -> Self {
        let is_accepted = accepted.iter().any(|one| one.eq_ignore_ascii_case(text));
        let full = if is_accepted { Vec::new() } else { TypeStore::names_like(kind, text) };
        let hint = match full.as_slice() {
            [] => did_you_mean(text, accepted),
            full => format!("did you mean `{}`? ", full.join("` or `")),
        };
        Self { text: text.into(), wanted, hint, accepted: accepted.join(", ") }
    }
}

impl FromStr for DataType {
    type Err = ParseTypeError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Self::from_name(text).ok_or_else(|| {
            ParseTypeError::new(text, MESSAGE_TYPE, &Self::ALL.map(Self::name), "msg")
        })
    }
}

/// Type that `type:` of a route or `--type` names: a data type, and the ROS type that carries it on
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
/// | `Text` | native object that is a text | `std_msgs/msg/String` holding that text | JSON |
/// | `Properties` | named parameters | the parameters of the node that the address names | JSON |
/// | any other `package/msg/Type` | message of that type | itself | JSON of its fields |
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::types; }
/// use wrapyfi_core::types::{DataType, MessageType};
/// let camera: MessageType = "sensor_msgs/msg/CompressedImage".parse()?;
/// assert_eq!(camera, MessageType::CompressedImage);
/// assert_eq!((camera.to_string().as_str(), camera.data_type()), ("CompressedImage", DataType::Image));
/// # Ok::<(), wrapyfi_data::types::ParseTypeError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum MessageType {
    /// `wrapyfi_msgs/msg/NativeObject`.
    NativeObject,
    /// JSON in `std_msgs/msg/String`.
    StringJson,
    /// Plain text in `std_msgs/msg/String`.
    Text,
    /// `sensor_msgs/msg/Image`.
    Image,
    /// `sensor_msgs/msg/CompressedImage`.
    CompressedImage,
    /// `wrapyfi_msgs/msg/AudioChunk`.
    AudioChunk,
    /// `wrapyfi_ros2_interfaces/msg/ROS2AudioMessage`.
    UpstreamAudio,
    /// The parameters of a ROS 2 node; no type of a topic there.
    Properties,
    /// Any other type of ROS 2, known while running.
    Ros(RosType),
}

impl MessageType {
    /// All types with names of their own, for errors that list them.
    pub const ALL: [Self; 8] = [
        Self::NativeObject,
        Self::StringJson,
        Self::Text,
        Self::Image,
        Self::CompressedImage,
        Self::AudioChunk,
        Self::UpstreamAudio,
        Self::Properties,
    ];

    /// Types that topics carry on every middleware.
    pub const TOPICS: [Self; 7] = {
        let [topics @ .., _properties] = Self::ALL;
        topics
    };

    /// Kind of payload that messages of the type carry.
    pub fn data_type(self) -> DataType {
        match self {
            Self::NativeObject | Self::StringJson | Self::Text => DataType::NativeObject,
            Self::Image | Self::CompressedImage => DataType::Image,
            Self::AudioChunk | Self::UpstreamAudio => DataType::AudioChunk,
            Self::Properties => DataType::Properties,
            Self::Ros(_) => DataType::RosMessage,
        }
    }

    /// Name of the ROS 2 type, for instance `sensor_msgs/msg/Image`; of properties that of one of them.
    pub fn ros_type(self) -> &'static str {
        match self {
            Self::NativeObject => "wrapyfi_msgs/msg/NativeObject",
            Self::StringJson | Self::Text => "std_msgs/msg/String",
            Self::Image => "sensor_msgs/msg/Image",
            Self::CompressedImage => "sensor_msgs/msg/CompressedImage",
            Self::AudioChunk => "wrapyfi_msgs/msg/AudioChunk",
            Self::UpstreamAudio => "wrapyfi_ros2_interfaces/msg/ROS2AudioMessage",
            Self::Properties => "rcl_interfaces/msg/Parameter",
            Self::Ros(ros_type) => ros_type.name(),
        }
    }
}

impl MessageType {
    /// Name that is unique among all types: that of the ROS 2 type, if no other type has it and
    /// topics have that type.
    pub fn label(self) -> &'static str {
        match self {
            Self::Text => "Text",
            Self::Properties => "Properties",
            other => other.ros_type(),
        }
    }

    /// True when messages of the type have a header: a time and a coordinate frame.
    pub fn has_header(self) -> bool {
        match self {
            Self::Ros(ros_type) => ros_type.has_header(),
            other => !matches!(other, Self::StringJson | Self::Text | Self::Properties),
        }
    }

    /// Short name, where there is one: `NativeObject`, `Image`, `CompressedImage`, `AudioChunk`,
    /// `Text`, `Properties`.
    pub fn short_name(self) -> Option<&'static str> {
        match self {
            Self::NativeObject => Some("NativeObject"),
            Self::Image => Some("Image"),
            Self::CompressedImage => Some("CompressedImage"),
            Self::AudioChunk => Some("AudioChunk"),
            Self::Properties => Some("Properties"),
            Self::Text => Some("Text"),
            Self::StringJson | Self::UpstreamAudio | Self::Ros(_) => None,
        }
    }
}

/// Error of reading the name of a message or service type.
///
/// ```
/// use wrapyfi_data::types::MessageType;
/// use wrapyfi_interfaces::store::TypeStore;
/// let error = MessageType::resolve("std_msgs/msg/Strin", &mut TypeStore::generated()).unwrap_err();
/// assert!(error.to_string().starts_with("std_msgs/msg/Strin is defined nowhere; did you mean `String`?"));
/// ```
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MessageTypeError {
    /// The name is neither one of Wrapyfi's nor that of a ROS type.
    #[error("{error}, and every ROS 2 {form}")]
    Unknown {
        /// Fault of the name.
        error: ParseTypeError,
        /// Form of the names of ROS types, for instance `type as package/msg/Type`.
        form: &'static str,
    },
    /// The definition of the ROS type cannot be found.
    #[error(transparent)]
    Definition(#[from] Box<ResolveError>),
    /// The definition cannot be used.
    #[error(transparent)]
    Unusable(#[from] RosTypeError),
}

impl MessageType {
    /// Reads a type as [`MessageType::from_str`] does; any other name of a ROS type is looked up in
    /// `store`.
    ///
    /// # Errors
    /// When the text is no name of a type, or the definition cannot be found or used.
    #[doc(hidden)]
    pub fn resolve(text: &str, store: &mut TypeStore) -> Result<Self, MessageTypeError> {
        resolve(text, store, "type as package/msg/Type", |found| RosType::new(found).map(Self::Ros))
    }
}

/// Reads one of Wrapyfi's names, or makes a type of the definition with that name.
pub(super) fn resolve<T: FromStr<Err = ParseTypeError>>(
    text: &str,
    store: &mut TypeStore,
    form: &'static str,
    of: impl FnOnce(&ResolvedType) -> Result<T, RosTypeError>,
) -> Result<T, MessageTypeError> {
    match text.parse() {
        Ok(known) => Ok(known),
        // A name without slash was meant to be one of Wrapyfi's.
        Err(error) if !text.contains('/') => Err(MessageTypeError::Unknown { error, form }),
        Err(_) => Ok(of(&store.resolve_name(text).map_err(Box::new)?)?),
    }
}

impl fmt::Display for MessageType {
    /// Writes the shortest name that [`MessageType::from_str`] reads.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.short_name().unwrap_or_else(|| self.ros_type()))
    }
}

impl FromStr for MessageType {
    type Err = ParseTypeError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        // A topic of single parameters is not the parameters of a node.
        let spellings = |kind: Self| {
            let named = Self::TOPICS.contains(&kind) && kind != Self::Text;
            let topic = named.then(|| kind.ros_type());
            kind.short_name().into_iter().chain(topic)
        };
        let mut all = Self::ALL.into_iter();
        all.find(|&kind| spellings(kind).any(|spelling| spelling == text)).ok_or_else(|| {
            ParseTypeError::new(
                text,
                MESSAGE_TYPE,
                &Self::ALL.into_iter().flat_map(spellings).collect::<Vec<_>>(),
                "msg",
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_spelling_is_read() {
        for kind in MessageType::ALL {
            assert_eq!(kind.to_string().parse(), Ok(kind));
        }
        for kind in MessageType::TOPICS {
            // A String is JSON unless it is called Text.
            let read = if kind == MessageType::Text { MessageType::StringJson } else { kind };
            assert_eq!(kind.ros_type().parse(), Ok(read));
        }
        assert!(MessageType::Properties.ros_type().parse::<MessageType>().is_err());
        let wrong = "Imag".parse::<MessageType>().unwrap_err().to_string();
        assert!(wrong.contains("\"Imag\" is no message type; did you mean `Image`? "), "{wrong}");
        for kind in DataType::ALL {
            assert_eq!(kind.to_string().parse(), Ok(kind));
        }
    }

    #[test]
    fn any_ros_type_is_read_where_its_definition_is_found() {
        let mut store = TypeStore::generated();
        let joints = MessageType::resolve("sensor_msgs/msg/JointState", &mut store).unwrap();
        assert_eq!(joints.ros_type(), "sensor_msgs/msg/JointState");
        assert_eq!(joints.data_type(), DataType::RosMessage);
        let image = MessageType::resolve("sensor_msgs/msg/Image", &mut store).unwrap();
        assert_eq!(image, MessageType::Image);
        let error = MessageType::resolve("demo/msg/None", &mut store).unwrap_err().to_string();
        assert!(error.starts_with("demo/msg/None is defined nowhere"), "{error}");
        let error = MessageType::resolve("Imag", &mut store).unwrap_err().to_string();
        assert!(error.ends_with("and every ROS 2 type as package/msg/Type"), "{error}");
    }

    #[test]
    fn a_wrong_spelling_is_told_the_right_ones() {
        let error = "image".parse::<MessageType>().unwrap_err().to_string();
        assert!(error.starts_with(
            "\"image\" is no message type; did you mean `Image`? accepted are NativeObject, "
        ));
        assert!(
            error.contains("std_msgs/msg/String, Text, Image, sensor_msgs/msg/Image, "),
            "{error}"
        );
        for (written, meant) in
            [("JointState", "sensor_msgs/msg/JointState"), ("range", "sensor_msgs/msg/Range")]
        {
            let error = MessageType::resolve(written, &mut TypeStore::generated()).unwrap_err();
            assert!(error.to_string().contains(&format!("did you mean `{meant}`? ")), "{error}");
        }
    }
}
