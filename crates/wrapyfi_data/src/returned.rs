//! Types that a registered method may return, and their conversion to payloads and back.
//!
//! ```text
//!   R ── to_payload ──▶ types::Payload ──▶ publisher
//!   R ◀─ from_payload ─ types::Payload ◀── listener
//! ```

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::codec::{ConvertError, EncodeError};
use crate::types::{
    self, AudioChunk, DataType, ReadError, RosTypeError, TypedError, from_value, to_value,
};
use wrapyfi_interfaces::{GeneratedType, Message};

/// The data types of `#[register]` as types.
pub mod kind {
    /// Values of any type that serde knows.
    ///
    /// See [`Returned`](super::Returned).
    #[derive(Debug, Clone, Copy)]
    pub struct NativeObject;
    /// A camera frame.
    ///
    /// See [`Returned`](super::Returned).
    #[derive(Debug, Clone, Copy)]
    pub struct Image;
    /// A chunk of sound.
    ///
    /// See [`Returned`](super::Returned).
    #[derive(Debug, Clone, Copy)]
    pub struct AudioChunk;
    /// Parameters of a node.
    ///
    /// See [`Returned`](super::Returned).
    #[derive(Debug, Clone, Copy)]
    pub struct Properties;
    /// A message of a ROS type.
    ///
    /// See [`Returned`](super::Returned).
    #[derive(Debug, Clone, Copy)]
    pub struct RosMessage;
}

/// A type that a method registered under the data type `K` may return.
///
/// | `K` | types |
/// | --- | --- |
/// | `NativeObject` | [`types::Value`], and every `Serialize + DeserializeOwned` |
/// | `Image` | [`types::Image`]; `Option` of it, whose `None` is not sent |
/// | `AudioChunk` | [`types::AudioChunk`]; `Option` of it, whose `None` is not sent |
/// | `Properties` | [`types::Properties`]; `Option` of it, whose `None` is not sent |
/// | `RosMessage` | every generated message ([`Message`]), of `rosidl_generator_rs` in `Rosidl`; [`types::RosMessage`], whose type the option `message_type` names |
///
/// ```
/// use wrapyfi_data::returned::{PayloadError, Returned, kind};
/// use wrapyfi_data::types::{DataType, Payload};
///
/// fn send<K>(value: &impl Returned<K>) -> Result<Option<Payload>, PayloadError> {
///     value.to_payload()
/// }
///
/// let payload = send::<kind::NativeObject>(&(7, "left".to_owned()))?.unwrap();
/// assert_eq!(payload.data_type(), DataType::NativeObject);
/// let back = <(i64, String) as Returned<kind::NativeObject>>::from_payload(payload)?;
/// assert_eq!(back, (7, "left".to_owned()));
/// assert!(send::<kind::Image>(&None)?.is_none());
/// # Ok::<(), PayloadError>(())
/// ```
#[diagnostic::on_unimplemented(
    message = "`{Self}` cannot be returned by a method registered under this data type",
    label = "not carried under this data type",
    note = "NativeObject carries `Value` and what is `Serialize + DeserializeOwned`, Image carries \
            `types::Image`, AudioChunk carries `types::AudioChunk`, Properties carries `types::Properties`, RosMessage carries \
            generated messages of `wrapyfi_interfaces`, `rosidl::Rosidl` and `types::RosMessage`"
)]
pub trait Returned<K>: Sized {
    /// ROS type that the Rust type is, where it is one.
    const ROS_TYPE: Option<GeneratedType> = None;

    /// Converts the value to a message; `None` where none is to be sent.
    ///
    /// # Errors
    /// When the value has no form as a message.
    fn to_payload(&self) -> Result<Option<types::Payload>, PayloadError>;

    /// Converts a message to the value.
    ///
    /// # Errors
    /// When the message is of another kind or type.
    fn from_payload(payload: types::Payload) -> Result<Self, PayloadError>;
}

/// Error of converting between a returned value and a message.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::returned as communicator; }
/// use wrapyfi_core::communicator::PayloadError;
/// # use wrapyfi_data::returned::{Returned, kind};
/// # use wrapyfi_data::types::{AudioChunk, Value};
/// # let text = Value::from("no sound").into();
/// # let found = <AudioChunk as Returned<kind::AudioChunk>>::from_payload(text).unwrap_err();
/// let error = PayloadError::Kind { expected: "AudioChunk".into(), actual: "NativeObject".into() };
/// assert_eq!(error.to_string(), "NativeObject where AudioChunk should be");
/// # assert_eq!(found, error);
/// ```
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PayloadError {
    /// The native object does not fit the Rust type, or the Rust value cannot be a native object.
    #[error(transparent)]
    Typed(#[from] TypedError),
    /// The message is of another kind.
    #[error("{actual} where {expected} should be")]
    Kind {
        /// Data type that the method is registered under.
        expected: String,
        /// Data type of the message.
        actual: String,
    },
    /// An image or a sound differs from an option.
    #[error("{what} is {actual}, and the option says {option} = {wanted}: change one of them")]
    Rule {
        /// Property that was measured.
        what: &'static str,
        /// Name of the option.
        option: &'static str,
        /// Value that the option asks for.
        wanted: String,
        /// Value that was found.
        actual: String,
    },
    /// The message is of another ROS type, or no message of it.
    #[error(transparent)]
    Message(#[from] ReadError),
    /// The definition of a generated message cannot be used.
    #[error(transparent)]
    Definition(#[from] RosTypeError),
    /// The middleware has no form for the value.
    #[error(transparent)]
    Encode(#[from] EncodeError),
    /// The value has no form of the type.
    #[error(transparent)]
    Convert(#[from] ConvertError),
    /// A struct that another generator wrote could not be written or read.
    #[error("{0}")]
    Foreign(String),
}

impl<T: Serialize + DeserializeOwned> Returned<kind::NativeObject> for T {
    fn to_payload(&self) -> Result<Option<types::Payload>, PayloadError> {
        Ok(Some(to_value(self)?.into()))
    }

    fn from_payload(payload: types::Payload) -> Result<Self, PayloadError> {
        match payload {
            types::Payload::NativeObject(object) => Ok(from_value(object.value)?),
            other => Err(other_kind(DataType::NativeObject, &other)),
        }
    }
}

fn other_kind(expected: DataType, found: &types::Payload) -> PayloadError {
    PayloadError::Kind { expected: expected.to_string(), actual: found.data_type().to_string() }
}

macro_rules! contents {
    ($($kind:ident => $content:ty,)*) => {$(
        impl Returned<kind::$kind> for $content {
            fn to_payload(&self) -> Result<Option<types::Payload>, PayloadError> {
                // Pixels, samples and bytes are shared.
                Ok(Some(self.clone().into()))
            }

            fn from_payload(payload: types::Payload) -> Result<Self, PayloadError> {
                match payload {
                    types::Payload::$kind(content) => Ok(content),
                    other => Err(other_kind(DataType::$kind, &other)),
                }
            }
        }
    )*};
}

macro_rules! optional {
    ($($kind:ident => $content:ty,)*) => {$(
        impl Returned<kind::$kind> for Option<$content> {
            fn to_payload(&self) -> Result<Option<types::Payload>, PayloadError> {
                Ok(self.clone().map(Into::into))
            }

            fn from_payload(payload: types::Payload) -> Result<Self, PayloadError> {
                <$content as Returned<kind::$kind>>::from_payload(payload).map(Some)
            }
        }
    )*};
}

contents! {
    Image => types::Image,
    AudioChunk => AudioChunk,
    Properties => types::Properties,
    RosMessage => types::RosMessage,
}

optional! {
    Image => types::Image,
    AudioChunk => AudioChunk,
    Properties => types::Properties,
}

impl<M: Message> Returned<kind::RosMessage> for M {
    const ROS_TYPE: Option<GeneratedType> = Some(GeneratedType::of::<M>());

    fn to_payload(&self) -> Result<Option<types::Payload>, PayloadError> {
        Ok(Some(types::RosMessage::of(self)?.into()))
    }

    fn from_payload(payload: types::Payload) -> Result<Self, PayloadError> {
        let message = <types::RosMessage as Returned<kind::RosMessage>>::from_payload(payload)?;
        Ok(message.read()?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::types::{Stamp, Value};

    #[test]
    fn a_native_object_is_any_type_of_serde() {
        let payload = Returned::<kind::NativeObject>::to_payload(&(1_u8, "a".to_owned())).unwrap();
        let back: (u8, String) =
            Returned::<kind::NativeObject>::from_payload(payload.unwrap()).unwrap();
        assert_eq!(back, (1, "a".to_owned()));
        let wrong: Result<(u8, u8), _> =
            Returned::<kind::NativeObject>::from_payload(Value::Str("no".into()).into());
        assert!(wrong.is_err());
    }

    #[test]
    fn a_ros_message_is_a_generated_one_or_one_by_name() {
        use wrapyfi_interfaces::geometry_msgs::msg::{Twist, Vector3};
        type Text = wrapyfi_interfaces::std_msgs::msg::String;
        let twist = Twist { linear: Vector3 { x: 1.5, ..Vector3::default() }, ..Twist::default() };
        assert_eq!(
            <Twist as Returned<kind::RosMessage>>::ROS_TYPE.map(|of| of.name),
            Some("geometry_msgs/msg/Twist")
        );
        assert_eq!(<types::RosMessage as Returned<kind::RosMessage>>::ROS_TYPE, None);
        let payload = Returned::<kind::RosMessage>::to_payload(&twist).unwrap().unwrap();
        let by_name: types::RosMessage =
            Returned::<kind::RosMessage>::from_payload(payload.clone()).unwrap();
        assert_eq!(by_name.ros_type.name(), "geometry_msgs/msg/Twist");
        let back: Twist = Returned::<kind::RosMessage>::from_payload(payload.clone()).unwrap();
        assert_eq!(back, twist);
        let other: Result<Text, _> = Returned::<kind::RosMessage>::from_payload(payload);
        let error = other.unwrap_err().to_string();
        assert!(error.starts_with("a message of geometry_msgs/msg/Twist (RIHS01_"), "{error}");
        assert!(error.contains("where one of std_msgs/msg/String (RIHS01_"), "{error}");
        let cut = types::RosMessage::new(by_name.ros_type, by_name.cdr.slice(..12));
        let cut: Result<Twist, _> = Returned::<kind::RosMessage>::from_payload(cut.into());
        assert!(matches!(cut, Err(PayloadError::Message(ReadError::Cdr(_)))), "{cut:?}");
    }

    #[test]
    fn nothing_is_not_sent_and_another_kind_is_named() {
        let none: Option<types::Image> = None;
        assert_eq!(Returned::<kind::Image>::to_payload(&none), Ok(None));
        let sound =
            AudioChunk::new(Stamp::default(), 0, 1, 8000, types::SampleFormat::F32Le, vec![]);
        let error = <types::Image as Returned<kind::Image>>::from_payload(sound.unwrap().into());
        assert_eq!(error.unwrap_err().to_string(), "AudioChunk where Image should be");
    }
}
