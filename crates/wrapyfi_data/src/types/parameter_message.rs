//! Values of parameters as messages carry them.

use bytes::Bytes;
use wrapyfi_interfaces::rcl_interfaces::msg;

use super::{ParameterType, ParameterValue};

/// Error of a message that names a type which ROS 2 does not have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("a parameter value has type {0}; types are 0 (NOT_SET) to 9 (STRING_ARRAY)")]
pub struct UnknownType(
    /// Number of the type.
    pub u8,
);

impl From<ParameterValue> for msg::ParameterValue {
    fn from(value: ParameterValue) -> Self {
        let mut message = Self { r#type: value.parameter_type().number(), ..Self::default() };
        match value {
            ParameterValue::NotSet => {}
            ParameterValue::Bool(value) => message.bool_value = value,
            ParameterValue::Integer(value) => message.integer_value = value,
            ParameterValue::Double(value) => message.double_value = value,
            ParameterValue::String(value) => message.string_value = value,
            ParameterValue::ByteArray(values) => message.byte_array_value = Bytes::from(values),
            ParameterValue::BoolArray(values) => message.bool_array_value = values,
            ParameterValue::IntegerArray(values) => message.integer_array_value = values,
            ParameterValue::DoubleArray(values) => message.double_array_value = values,
            ParameterValue::StringArray(values) => message.string_array_value = values,
        }
        message
    }
}

impl TryFrom<msg::ParameterValue> for ParameterValue {
    type Error = UnknownType;

    /// Reads the field that the type names, and none of the others.
    fn try_from(message: msg::ParameterValue) -> Result<Self, UnknownType> {
        let kind = ParameterType::from_number(message.r#type).ok_or(UnknownType(message.r#type))?;
        Ok(match kind {
            ParameterType::NotSet => Self::NotSet,
            ParameterType::Bool => Self::Bool(message.bool_value),
            ParameterType::Integer => Self::Integer(message.integer_value),
            ParameterType::Double => Self::Double(message.double_value),
            ParameterType::String => Self::String(message.string_value),
            ParameterType::ByteArray => Self::ByteArray(message.byte_array_value.to_vec()),
            ParameterType::BoolArray => Self::BoolArray(message.bool_array_value),
            ParameterType::IntegerArray => Self::IntegerArray(message.integer_array_value),
            ParameterType::DoubleArray => Self::DoubleArray(message.double_array_value),
            ParameterType::StringArray => Self::StringArray(message.string_array_value),
        })
    }
}
