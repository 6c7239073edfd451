//! Parameters as messages carry them.

use wrapyfi_interfaces::rcl_interfaces::msg;

use super::{Parameter, ParameterDescriptor, ParameterRange};
use crate::ParameterType;
use wrapyfi_data::types::UnknownType;

impl From<Parameter> for msg::Parameter {
    fn from(parameter: Parameter) -> Self {
        Self { name: parameter.name, value: parameter.value.into() }
    }
}

impl TryFrom<msg::ParameterDescriptor> for ParameterDescriptor {
    type Error = UnknownType;

    /// Reads a descriptor. Of several ranges, which the definition has no room for, the first
    /// counts.
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
