//! Plain text in `std_msgs/msg/String`, as ROS users write and read it.

use wrapyfi_interfaces::Message;
use wrapyfi_interfaces::cdr::CdrParts;
use wrapyfi_interfaces::std_msgs::msg::String as Text;

use super::part::countable;
use crate::codec::{DecodeError, EncodeError};
use crate::types::Value;

/// Writes a text as it is.
pub(super) fn encode(value: &Value) -> Result<CdrParts, EncodeError> {
    let Some(text) = value.as_str() else {
        return Err(EncodeError::mismatch("a text", format!("a {}", value.kind())));
    };
    countable("data", text.len())?;
    Ok(Text { data: text.to_owned() }.encode())
}

/// Reads a text as it is.
pub(super) fn decode(message: Text) -> Result<Value, DecodeError> {
    Ok(message.data.into())
}
