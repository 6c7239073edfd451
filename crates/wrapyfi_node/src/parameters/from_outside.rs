//! Values from the command line and parameter files, for the parameters that are declared.

use super::{DeclareError, ParameterDescriptor, SHOWN};
use crate::{ParameterType, ParameterValue};

/// Converts a value from outside to the type of the parameter.
pub(super) fn override_for(
    descriptor: &ParameterDescriptor,
    value: &ParameterValue,
) -> Result<ParameterValue, DeclareError> {
    let (expected, found) = (descriptor.parameter_type, value.parameter_type());
    if descriptor.dynamic_typing || found == expected {
        return Ok(value.clone());
    }
    // `[]` on the command line is an empty list of any type.
    if let (ParameterType::NotSet, Some(empty)) = (found, expected.empty_list()) {
        return Ok(empty);
    }
    let (name, hint) = (&descriptor.name, hint(&descriptor.name, value, expected));
    let value: String = value.to_string().chars().take(SHOWN).collect();
    Err(DeclareError::Unfit(format!(
        "Trying to set parameter '{name}' to '{value}' of type '{found}', expecting type \
         '{expected}': write {hint}"
    )))
}

/// Example of a value of the type, as it is written on the command line.
fn hint(name: &str, value: &ParameterValue, expected: ParameterType) -> String {
    let example = match (expected, value) {
        (ParameterType::Double, ParameterValue::Integer(value)) => format!("{value}.0"),
        (ParameterType::String, ParameterValue::Integer(_) | ParameterValue::Bool(_)) => {
            format!("'\"{value}\"'")
        }
        (ParameterType::NotSet, _) => "VALUE".to_owned(),
        (ParameterType::Bool, _) => "true or false".to_owned(),
        (ParameterType::Integer, _) => "5".to_owned(),
        (ParameterType::Double, _) => "5.0".to_owned(),
        (ParameterType::String, _) => "text".to_owned(),
        // The command line has no way to write bytes.
        (ParameterType::ByteArray, _) => return "nothing: bytes are set by a service".to_owned(),
        (ParameterType::BoolArray, _) => "'[true, false]'".to_owned(),
        (ParameterType::IntegerArray, _) => "'[1, 2]'".to_owned(),
        (ParameterType::DoubleArray, _) => "'[1.0, 2.0]'".to_owned(),
        (ParameterType::StringArray, _) => "'[a, b]'".to_owned(),
    };
    format!("-p {name}:={example}")
}
