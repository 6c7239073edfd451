//! Parameters as messages carry them.

use wrapyfi_interfaces::rcl_interfaces::msg;

use super::{Parameter, ParameterDescriptor, ParameterRange, SetError};
use crate::ParameterValue;

impl From<Parameter> for msg::Parameter {
    fn from(parameter: Parameter) -> Self {
        Self { name: parameter.name, value: parameter.value.into() }
    }
}

impl TryFrom<msg::Parameter> for Parameter {
    type Error = SetError;

    fn try_from(message: msg::Parameter) -> Result<Self, SetError> {
        let msg::Parameter { name, value } = message;
        match ParameterValue::try_from(value) {
            Ok(value) => Ok(Self { name, value }),
            Err(unknown) => Err(SetError::UnknownType { name, number: unknown.0 }),
        }
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
