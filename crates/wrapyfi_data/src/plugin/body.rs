//! The parts behind a plug-in key, which are read in place and written straight into the text.

use bytes::Bytes;

use super::PluginError;
use crate::base64;
use crate::json_text::{RawString, Text};
use crate::types::Value;

/// The parts behind the key of a received object. Parts are counted from 0, the key left out.
///
/// Text parts stay undecoded in the message until they are asked for, because most of them are
/// files in base64: they are decoded once, and never copied as text.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::{Limits, codec, plugin, types}; }
/// use wrapyfi_core::Limits;
/// use wrapyfi_core::codec::json;
/// use wrapyfi_core::plugin::{Body, Part, Plugin, PluginError, Plugins, Unpacking};
/// use wrapyfi_core::types::Value;
///
/// /// `["Celsius", 21.5]`, read as the number.
/// struct Celsius;
/// impl Plugin for Celsius {
///     fn key(&self) -> &str { "Celsius" }
///     fn decode(&self, body: &Body<'_>, _: &Unpacking<'_>) -> Result<Value, PluginError> {
///         match body.len() {
///             1 => body.value(0).cloned(),
///             _ => Err(body.expected(1, "absent")),
///         }
///     }
///     fn encode(&self, value: &Value) -> Result<Vec<Part>, PluginError> {
///         Err(PluginError::not_mine("temperature", value))
///     }
/// }
///
/// let text = r#"{"__wrapyfi__": ["Celsius", 21.5]}"#.into();
/// let value = json::decode(&text, &Limits::default(), &Plugins::none().with(Celsius))?;
/// assert_eq!(value, Value::Float(21.5));
/// # Ok::<(), wrapyfi_data::DecodeError>(())
/// ```
#[derive(Debug)]
pub struct Body<'a> {
    pub(crate) elements: Vec<Element<'a>>,
}

/// A part as the JSON decoder found it.
#[derive(Debug)]
pub(crate) enum Element<'a> {
    Text(RawString<'a>),
    Value(Value),
}

impl Body<'_> {
    /// Number of parts.
    pub fn len(&self) -> usize {
        self.elements.len()
    }

    /// True when there are no parts.
    pub fn is_empty(&self) -> bool {
        self.elements.is_empty()
    }

    /// Error for a part that is not `wanted`, for instance `a number`.
    pub fn expected(&self, part: usize, wanted: &str) -> PluginError {
        let found = match self.elements.get(part) {
            None => format!("the object has {} parts", self.len()),
            Some(Element::Text(_)) => "it is text".to_owned(),
            Some(Element::Value(value)) => format!("it is of type {}", value.kind()),
        };
        PluginError::malformed(part, format!("{wanted} should be there, {found}"))
    }

    /// Reads a part that is text.
    ///
    /// # Errors
    /// When the part is absent, is no text, or holds a lone surrogate.
    pub fn text(&self, part: usize) -> Result<String, PluginError> {
        match self.raw(part)?.decode() {
            Ok(Text::Valid(text)) => Ok(text),
            Ok(Text::Utf16(_)) => Err(PluginError::malformed(part, "it holds a lone surrogate")),
            Err(reason) => Err(PluginError::malformed(part, reason)),
        }
    }

    /// Reads a part that is text or `None`.
    ///
    /// # Errors
    /// When the part is absent or of another kind.
    pub fn optional_text(&self, part: usize) -> Result<Option<String>, PluginError> {
        match self.elements.get(part) {
            Some(Element::Value(Value::Null)) => Ok(None),
            _ => self.text(part).map(Some),
        }
    }

    /// Reads a part that is a file in base64, which is decoded in place, by Python's rules.
    ///
    /// # Errors
    /// When the part is absent, is no text, or no base64.
    pub fn base64(&self, part: usize) -> Result<Bytes, PluginError> {
        let raw = self.raw(part)?;
        if let Some(file) = raw.plain().and_then(base64::decode_strictly) {
            return Ok(file.into());
        }
        let text = self.text(part)?;
        base64::decode_leniently(text.as_bytes())
            .map(Bytes::from)
            .map_err(|reason| PluginError::malformed(part, reason))
    }

    /// Reads a part that is a file with one character for each byte, U+0000 to U+00FF (Python's
    /// `latin-1`), as Wrapyfi sends pickles and image files.
    ///
    /// # Errors
    /// When the part is absent, is no text, or holds a character beyond U+00FF.
    pub fn latin1(&self, part: usize) -> Result<Bytes, PluginError> {
        self.raw(part)?
            .decode_latin1()
            .map(Bytes::from)
            .map_err(|reason| PluginError::malformed(part, reason))
    }

    /// Value of a part that is no text: a number, a list, a decoded object.
    ///
    /// # Errors
    /// When the part is absent or text.
    pub fn value(&self, part: usize) -> Result<&Value, PluginError> {
        match self.elements.get(part) {
            Some(Element::Value(value)) => Ok(value),
            _ => Err(self.expected(part, "something that is no text")),
        }
    }

    fn raw(&self, part: usize) -> Result<RawString<'_>, PluginError> {
        match self.elements.get(part) {
            Some(Element::Text(raw)) => Ok(*raw),
            _ => Err(self.expected(part, "text")),
        }
    }
}

/// A part to be written behind a plug-in key.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::plugin; }
/// use wrapyfi_core::plugin::Part;
/// // As the plug-in of pint writes three grams.
/// let parts = [Part::base64(r#"{"magnitude": 3, "units": "gram"}"#), Part::Text("Quantity".into())];
/// assert!(matches!(&parts, [Part::Base64(..), Part::Text(kind)] if kind == "Quantity"));
/// ```
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Part {
    /// Text.
    Text(String),
    /// A file in base64, given in two pieces that are written without joining them first.
    Base64(Bytes, Bytes),
    /// A file with one character for each byte.
    Latin1(Bytes),
    /// A value of any other kind.
    Value(Value),
}

impl Part {
    /// Makes a part of a file in base64.
    pub fn base64(file: impl Into<Bytes>) -> Self {
        Self::Base64(file.into(), Bytes::new())
    }
}
