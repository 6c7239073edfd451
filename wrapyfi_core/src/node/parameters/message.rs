//! Parameters as messages carry them.

use bytes::Bytes;
use wrapyfi_interfaces::rcl_interfaces::msg;

use super::{Parameter, ParameterDescriptor, ParameterRange};
use crate::node::{ParameterType, ParameterValue};

/// A message names a type that ROS 2 has not.
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

    /// Takes the field that the type names, and none of the others.
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

impl From<Parameter> for msg::Parameter {
    fn from(parameter: Parameter) -> Self {
        Self { name: parameter.name, value: parameter.value.into() }
    }
}

impl TryFrom<msg::ParameterDescriptor> for ParameterDescriptor {
    type Error = UnknownType;

    /// Of several ranges, which the definition has no room for, the first counts.
    fn try_from(message: msg::ParameterDescriptor) -> Result<Self, UnknownType> {
        let parameter_type =
            ParameterType::from_number(message.r#type).ok_or(UnknownType(message.r#type))?;
        let integer = message.integer_range.first().map(|range| ParameterRange::Integer {
            from: range.from_value,
            to: range.to_value,
            step: range.step,
        });
        let double = message.floating_point_range.first().map(|range| ParameterRange::Double {
            from: range.from_value,
            to: range.to_value,
            step: range.step,
        });
        Ok(Self {
            name: message.name,
            parameter_type,
            description: message.description,
            additional_constraints: message.additional_constraints,
            read_only: message.read_only,
            dynamic_typing: message.dynamic_typing,
            range: integer.or(double),
        })
    }
}

impl From<&ParameterDescriptor> for msg::ParameterDescriptor {
    fn from(descriptor: &ParameterDescriptor) -> Self {
        let mut message = Self {
            name: descriptor.name.clone(),
            r#type: descriptor.parameter_type.number(),
            description: descriptor.description.clone(),
            additional_constraints: descriptor.additional_constraints.clone(),
            read_only: descriptor.read_only,
            dynamic_typing: descriptor.dynamic_typing,
            ..Self::default()
        };
        match descriptor.range {
            Some(ParameterRange::Integer { from: from_value, to: to_value, step }) => {
                message.integer_range = vec![msg::IntegerRange { from_value, to_value, step }];
            }
            Some(ParameterRange::Double { from: from_value, to: to_value, step }) => {
                message.floating_point_range =
                    vec![msg::FloatingPointRange { from_value, to_value, step }];
            }
            None => {}
        }
        message
    }
}
