//! What a registered method may return, and the way into a message and back.
//!
//! ```text
//!   R ── to_payload ──▶ types::Payload ──▶ publisher
//!   R ◀─ from_payload ─ types::Payload ◀── listener
//! ```

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::EncodeError;
use crate::types::{self, AudioChunk, DataType, TypedError, from_value, to_value};

/// The data types of `#[register]` as types.
pub mod kind {
    /// Anything that serde knows.
    #[derive(Debug, Clone, Copy)]
    pub struct NativeObject;
    /// A camera frame.
    #[derive(Debug, Clone, Copy)]
    pub struct Image;
    /// A chunk of sound.
    #[derive(Debug, Clone, Copy)]
    pub struct AudioChunk;
    /// Parameters of a node.
    #[derive(Debug, Clone, Copy)]
    pub struct Properties;
}

/// What a method registered under the data type `K` may return.
///
/// | `K` | types |
/// | --- | --- |
/// | `NativeObject` | [`types::Value`], and every `Serialize + DeserializeOwned` |
/// | `Image` | [`types::Image`]; `Option` of it, whose `None` is not sent |
/// | `AudioChunk` | [`types::AudioChunk`]; `Option` of it, whose `None` is not sent |
/// | `Properties` | [`types::Properties`]; `Option` of it, whose `None` is not sent |
#[diagnostic::on_unimplemented(
    message = "`{Self}` cannot be returned by a method registered under this data type",
    label = "not carried under this data type",
    note = "NativeObject carries `Value` and what is `Serialize + DeserializeOwned`, Image carries \
            `types::Image`, AudioChunk carries `types::AudioChunk`, Properties carries `types::Properties`"
)]
pub trait Payload<K>: Sized {
    /// The message, or `None` where there is nothing to send.
    ///
    /// # Errors
    /// When the value has no form as a message.
    fn to_payload(&self) -> Result<Option<types::Payload>, PayloadError>;

    /// The value in a message.
    ///
    /// # Errors
    /// When it is another one.
    fn from_payload(payload: types::Payload) -> Result<Self, PayloadError>;
}

/// Why a value and a message do not fit each other.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PayloadError {
    /// A native object that is not the Rust type, or a Rust value without a form.
    #[error(transparent)]
    Typed(#[from] TypedError),
    /// A message of another kind.
    #[error("{actual} where {expected} should be")]
    Kind {
        /// As registered.
        expected: DataType,
        /// What it is.
        actual: DataType,
    },
    /// An image or a sound that is not as an option says.
    #[error("{what} is {actual}, and the option says {option} = {wanted}: change one of them")]
    Rule {
        /// Thing measured.
        what: &'static str,
        /// Option.
        option: &'static str,
        /// As the option says.
        wanted: String,
        /// As it is.
        actual: String,
    },
    /// The middleware has no form for it.
    #[error(transparent)]
    Encode(#[from] EncodeError),
}

impl<T: Serialize + DeserializeOwned> Payload<kind::NativeObject> for T {
    fn to_payload(&self) -> Result<Option<types::Payload>, PayloadError> {
        Ok(Some(to_value(self)?.into()))
    }

    fn from_payload(payload: types::Payload) -> Result<Self, PayloadError> {
        match payload {
            types::Payload::NativeObject(value) => Ok(from_value(*value)?),
            other => Err(other_kind(DataType::NativeObject, &other)),
        }
    }
}

fn other_kind(expected: DataType, found: &types::Payload) -> PayloadError {
    PayloadError::Kind { expected, actual: found.data_type() }
}

macro_rules! media {
    ($($kind:ident => $content:ty,)*) => {$(
        impl Payload<kind::$kind> for $content {
            fn to_payload(&self) -> Result<Option<types::Payload>, PayloadError> {
                // Pixels and samples are shared.
                Ok(Some(self.clone().into()))
            }

            fn from_payload(payload: types::Payload) -> Result<Self, PayloadError> {
                match payload {
                    types::Payload::$kind(content) => Ok(content),
                    other => Err(other_kind(DataType::$kind, &other)),
                }
            }
        }

        impl Payload<kind::$kind> for Option<$content> {
            fn to_payload(&self) -> Result<Option<types::Payload>, PayloadError> {
                Ok(self.clone().map(Into::into))
            }

            fn from_payload(payload: types::Payload) -> Result<Self, PayloadError> {
                <$content as Payload<kind::$kind>>::from_payload(payload).map(Some)
            }
        }
    )*};
}

media! {
    Image => types::Image,
    AudioChunk => AudioChunk,
    Properties => types::Properties,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::types::{Stamp, Value};

    #[test]
    fn a_native_object_is_any_type_of_serde() {
        let payload = Payload::<kind::NativeObject>::to_payload(&(1_u8, "a".to_owned())).unwrap();
        let back: (u8, String) =
            Payload::<kind::NativeObject>::from_payload(payload.unwrap()).unwrap();
        assert_eq!(back, (1, "a".to_owned()));
        let wrong: Result<(u8, u8), _> =
            Payload::<kind::NativeObject>::from_payload(Value::Str("no".into()).into());
        assert!(wrong.is_err());
    }

    #[test]
    fn nothing_is_not_sent_and_another_kind_is_named() {
        let none: Option<types::Image> = None;
        assert_eq!(Payload::<kind::Image>::to_payload(&none), Ok(None));
        let sound =
            AudioChunk::new(Stamp::default(), 0, 1, 8000, types::SampleFormat::F32Le, vec![]);
        let error = <types::Image as Payload<kind::Image>>::from_payload(sound.unwrap().into());
        assert_eq!(error.unwrap_err().to_string(), "AudioChunk where Image should be");
    }
}
