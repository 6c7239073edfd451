//! Wrapyfi's JSON dialect: native objects as text.
//!
//! ```text
//!   text ─▶ decode ─▶ Value       {"pose": {"__wrapyfi__": ["numpy.ndarray", "k05VTVB…"]}}
//!             │                                              │          │
//!             │                                             tag    base64 of a .npy file
//!             └─ long strings are found by memchr and decoded where they stand:
//!                one pass over the text, one allocation per array
//!
//!   Value ─▶ encode ─▶ text       base64 goes straight into the output
//! ```
//!
//! Differences from RFC 8259 are those of Python: `NaN`, `Infinity` and `-Infinity`; integers of
//! any size (up to 4300 digits); strings with lone surrogates; repeated members, where the last one
//! counts. Tagged values and their rules: `docs/reference/wire/native-object.md`.

/// Base64 as Python reads and writes it.
pub mod base64 {
    pub use crate::base64::{append, decode_leniently, decode_strictly};
}
mod decode;
mod encode;
mod neutral;
mod number;
mod tags;

pub use neutral::{extents, extents_body, quantity, quantity_body};
pub use number::write_float;

use std::borrow::Cow;

use bytes::Bytes;

use super::{DecodeError, DecodeResult, EncodeResult};
use crate::Limits;
use crate::json_text::TAG;
use crate::plugin::Plugins;
use crate::types::{Tensor, Value};

/// Reads a native object. Arrays share no bytes with `text`; objects of unknown plug-ins do.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::{Limits, codec, plugin}; }
/// use wrapyfi_core::Limits;
/// use wrapyfi_core::codec::json;
/// use wrapyfi_core::plugin::Plugins;
/// let value = json::decode(&r#"{"speed": [1, 2.5, NaN]}"#.into(), &Limits::default(), &Plugins::none())?;
/// assert_eq!(value.get("speed").unwrap().as_items().unwrap()[1].as_f64(), Some(2.5));
/// # Ok::<(), wrapyfi_data::DecodeError>(())
/// ```
///
/// # Errors
/// When `text` is not a native object, or exceeds a limit. An object that its plug-in refuses is no error: it is
/// carried as [`crate::types::Tagged`] with the reason.
pub fn decode(text: &Bytes, limits: &Limits, plugins: &Plugins) -> DecodeResult<Value> {
    decode::run(text, None, limits, plugins)
}

/// [`decode`] for messages that people and programs without Wrapyfi write too, such as
/// `std_msgs/msg/String`: a text that is no JSON is that text. Bytes that are not UTF-8 become U+FFFD.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::{Limits, codec, plugin}; }
/// use wrapyfi_core::Limits;
/// use wrapyfi_core::codec::json;
/// use wrapyfi_core::plugin::Plugins;
/// let read = |text: &str| json::decode_or_text(&text.to_owned().into(), &Limits::default(), &Plugins::none());
/// assert_eq!(read(r#"{"n": 5}"#)?.get("n").unwrap().as_i64(), Some(5));
/// assert_eq!(read("Hello World: 5")?.as_str(), Some("Hello World: 5"));
/// # Ok::<(), wrapyfi_data::DecodeError>(())
/// ```
///
/// # Errors
/// As [`decode`] where a limit is exceeded, `__wrapyfi__` stands in the text, which was therefore
/// meant as an object.
pub fn decode_or_text(text: &Bytes, limits: &Limits, plugins: &Plugins) -> DecodeResult<Value> {
    decode(text, limits, plugins).or_else(|error| {
        let is_plain = matches!(error, DecodeError::Malformed { .. })
            && memchr::memmem::find(text, TAG.as_bytes()).is_none();
        match String::from_utf8_lossy(text) {
            Cow::Owned(repaired) => decode_or_text(&repaired.into(), limits, plugins),
            Cow::Borrowed(plain) if is_plain => Ok(plain.into()),
            Cow::Borrowed(_) => Err(error),
        }
    })
}

/// Reads a native object whose arrays travel beside the text: `{"__wrapyfi__": ["tensor", 0]}`
/// stands for `tensors[0]`, whose bytes are then shared.
///
/// # Errors
/// As [`decode`], and when an index has no tensor.
pub fn decode_with_tensors(
    text: &Bytes,
    tensors: &[Tensor],
    limits: &Limits,
    plugins: &Plugins,
) -> DecodeResult<Value> {
    decode::run(text, Some(tensors), limits, plugins)
}

/// Writes a native object as Python's `json.dumps` would, in ASCII. The vector's capacity is its
/// length: boxing it copies nothing.
///
/// A tensor without an origin is written as NumPy's: its device label is left out, and `bfloat16`
/// becomes `float32`.
///
/// # Errors
/// When something inside has no form in Wrapyfi's JSON, or the plug-in of an object inside is not among `plugins`; the
/// message says where and what to do.
pub fn encode(value: &Value, plugins: &Plugins) -> EncodeResult<Vec<u8>> {
    encode::run(value, None, plugins).map(|(text, _)| text)
}

/// Writes a native object with every [`Value::Tensor`] replaced by its index in the list that is
/// returned beside the text: what [`decode_with_tensors`] reads.
///
/// # Errors
/// As [`encode`].
pub fn encode_with_tensors(
    value: &Value,
    plugins: &Plugins,
) -> EncodeResult<(Vec<u8>, Vec<Tensor>)> {
    encode::run(value, Some(Vec::new()), plugins)
}

#[cfg(test)]
mod tests;
