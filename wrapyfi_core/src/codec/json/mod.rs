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
//! What differs from RFC 8259, all of it Python's: `NaN`, `Infinity` and `-Infinity`; integers of
//! any size (up to 4300 digits); strings with lone surrogates; repeated members, where the last
//! one counts. Tagged values and their rules: `docs/wire/native-object.md`.

mod base64;
mod decode;
mod encode;
mod number;
mod tags;
mod text;

pub(in crate::codec) use number::repr;

use bytes::Bytes;

use super::{DecodeError, EncodeError};
use crate::Limits;
use crate::types::{Tensor, Value};

/// The member that makes an object a tagged value.
const TAG: &str = "__wrapyfi__";
/// Digits of the longest integer, Python's own limit on both sides.
const MAX_DIGITS: usize = 4300;

/// Reads a native object. Arrays share no bytes with `text`; objects of unknown plug-ins do.
///
/// ```
/// use wrapyfi_core::{Limits, codec::json};
/// let value = json::decode(&r#"{"speed": [1, 2.5, NaN]}"#.into(), &Limits::default())?;
/// assert_eq!(value.get("speed").unwrap().as_items().unwrap()[1].as_f64(), Some(2.5));
/// # Ok::<(), wrapyfi_core::DecodeError>(())
/// ```
///
/// # Errors
/// When `text` is not a native object, or exceeds a limit.
pub fn decode(text: &Bytes, limits: &Limits) -> Result<Value, DecodeError> {
    decode::run(text, None, limits)
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
) -> Result<Value, DecodeError> {
    decode::run(text, Some(tensors), limits)
}

/// Writes a native object as Python's `json.dumps` would, in ASCII. The vector's capacity is its
/// length: boxing it copies nothing.
///
/// Device labels of tensors have no place in the text and are left out; `bfloat16` becomes
/// `float32`.
///
/// # Errors
/// When something inside has no form in Wrapyfi's JSON; the message says where and what to do.
pub fn encode(value: &Value) -> Result<Vec<u8>, EncodeError> {
    encode::run(value, None).map(|(text, _)| text)
}

/// Writes a native object with every [`Value::Tensor`] replaced by its index in the list that is
/// returned beside the text: what [`decode_with_tensors`] reads.
///
/// # Errors
/// As [`encode`].
pub fn encode_with_tensors(value: &Value) -> Result<(Vec<u8>, Vec<Tensor>), EncodeError> {
    encode::run(value, Some(Vec::new()))
}

#[cfg(test)]
mod tests;
