//! Values of parameters as messages carry them.

use wrapyfi_interfaces::rcl_interfaces::msg;

use super::{ParameterType, ParameterValue};

/// Error of a message that names a type which ROS 2 does not have.
///
/// ```
/// use wrapyfi_data::types::ParameterValue;
/// use wrapyfi_interfaces::rcl_interfaces::msg;
/// let message = msg::ParameterValue { r#type: 42, ..Default::default() };
/// let error = ParameterValue::try_from(message).unwrap_err();
/// assert!(error.to_string().starts_with("a parameter value has type 42; types are 0 (NOT_SET)"));
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("a parameter value has type {0}; types are 0 (NOT_SET) to 9 (STRING_ARRAY)")]
pub struct UnknownType(
    /// Number of the type.
    pub u8,
);

/// Conversions, by the variant of a value and the field that holds it.
macro_rules! fields {
    ($($variant:ident: $field:ident,)*) => {
        impl From<ParameterValue> for msg::ParameterValue {
            fn from(value: ParameterValue) -> Self {
                let kind = value.parameter_type().number();
                let mut message = Self { r#type: kind, ..Self::default() };
                match value {
                    ParameterValue::NotSet => {}
                    $(ParameterValue::$variant(value) => message.$field = value.into(),)*
                }
                message
            }
        }

        impl TryFrom<msg::ParameterValue> for ParameterValue {
            type Error = UnknownType;

            /// Reads the field that the type names, and none of the others.
            fn try_from(message: msg::ParameterValue) -> Result<Self, UnknownType> {
                let kind = message.r#type;
                Ok(match ParameterType::from_number(kind).ok_or(UnknownType(kind))? {
                    ParameterType::NotSet => Self::NotSet,
                    $(ParameterType::$variant => Self::$variant(message.$field.into()),)*
                })
            }
        }
    };
}

fields! {
    Bool: bool_value,
    Integer: integer_value,
    Double: double_value,
    String: string_value,
    ByteArray: byte_array_value,
    BoolArray: bool_array_value,
    IntegerArray: integer_array_value,
    DoubleArray: double_array_value,
    StringArray: string_array_value,
}
