//! Parameters as messages carry them.

use wrapyfi_interfaces::rcl_interfaces::msg;

use super::{Parameter, ParameterDescriptor, ParameterRange};

impl From<Parameter> for msg::Parameter {
    fn from(parameter: Parameter) -> Self {
        Self { name: parameter.name, value: parameter.value.into() }
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
