//! Descriptions of parameters: purpose, type, and the values that a parameter may have.

use wrapyfi_interfaces::parser::{DefaultValue, Literal};

use super::SetError;
use crate::{ParameterType, ParameterValue};

/// Relative difference below which two floating point numbers count as one.
const TOLERANCE: f64 = 1e-6;

/// Purpose and type of a parameter, and the values that it may have.
///
/// ```
/// use wrapyfi_node::parameters::ParameterDescriptor;
/// let rate = ParameterDescriptor::new("camera.rate")
///     .with_description("Images per second")
///     .with_integer_range(1, 120, 1);
/// assert!(!rate.read_only);
/// ```
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ParameterDescriptor {
    /// Name; groups end with dots, as in `camera.rate`.
    pub name: String,
    /// Type; [`ParameterType::NotSet`] takes that of the default value.
    pub parameter_type: ParameterType,
    /// Purpose of the parameter.
    pub description: String,
    /// Rules that a range cannot say, in words.
    pub additional_constraints: String,
    /// True when the parameter keeps the value with which it was declared.
    pub read_only: bool,
    /// True when the type of the parameter may change.
    pub dynamic_typing: bool,
    /// Range of an `INTEGER` or `DOUBLE`.
    pub range: Option<ParameterRange>,
}

/// Values that a number may have. The ends are allowed whatever the step.
///
/// ```
/// use wrapyfi_node::parameters::{ParameterDescriptor, ParameterRange};
/// let gain = ParameterDescriptor::new("gain").with_double_range(0.0, 4.0, 0.5);
/// assert_eq!(gain.range, Some(ParameterRange::Double { from: 0.0, to: 4.0, step: 0.5 }));
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ParameterRange {
    /// Range of an `INTEGER`.
    Integer {
        /// Least value.
        from: i64,
        /// Largest value.
        to: i64,
        /// Distance of allowed values, counted from `from`; 0 allows all.
        step: u64,
    },
    /// Range of a `DOUBLE`.
    Double {
        /// Least value.
        from: f64,
        /// Largest value.
        to: f64,
        /// Distance of allowed values, counted from `from`; 0 allows all.
        step: f64,
    },
}

impl ParameterDescriptor {
    /// Describes a parameter of this name with static type and no range, which may be set.
    pub fn new(name: impl Into<String>) -> Self {
        Self { name: name.into(), ..Self::default() }
    }

    /// Sets the type, for a parameter that has no value until one is given.
    #[must_use]
    pub fn with_type(self, parameter_type: ParameterType) -> Self {
        Self { parameter_type, ..self }
    }

    /// Sets the purpose, in words.
    #[must_use]
    pub fn with_description(self, description: impl Into<String>) -> Self {
        Self { description: description.into(), ..self }
    }

    /// Makes the parameter read-only: only the start of the node sets it.
    #[must_use]
    pub fn read_only(self) -> Self {
        Self { read_only: true, ..self }
    }

    /// Lets the type change, and lets clients delete the parameter by setting no value.
    #[must_use]
    pub fn dynamic(self) -> Self {
        Self { dynamic_typing: true, ..self }
    }

    /// Sets the integers that the value may be.
    #[must_use]
    pub fn with_integer_range(self, from: i64, to: i64, step: u64) -> Self {
        Self { range: Some(ParameterRange::Integer { from, to, step }), ..self }
    }

    /// Sets the floating point numbers that the value may be.
    #[must_use]
    pub fn with_double_range(self, from: f64, to: f64, step: f64) -> Self {
        Self { range: Some(ParameterRange::Double { from, to, step }), ..self }
    }

    /// Checks that the parameter may have this value, apart from being read-only.
    pub(super) fn check(&self, value: &ParameterValue) -> Result<(), SetError> {
        let found = value.parameter_type();
        if !self.dynamic_typing && found != self.parameter_type {
            return Err(match found {
                ParameterType::NotSet => SetError::StaticType(self.name.clone()),
                _ => SetError::WrongType {
                    name: self.name.clone(),
                    expected: self.parameter_type,
                    found,
                },
            });
        }
        let size = value.size();
        if size > super::MAX_VALUE_BYTES {
            let (name, limit) = (self.name.clone(), super::MAX_VALUE_BYTES);
            return Err(SetError::TooLarge { name, size, limit });
        }
        match (self.range, value) {
            (Some(ParameterRange::Integer { from, to, step }), ParameterValue::Integer(value)) => {
                self.check_integer(from, to, step, *value)
            }
            (Some(ParameterRange::Double { from, to, step }), ParameterValue::Double(value)) => {
                self.check_double(from, to, step, *value)
            }
            _ => Ok(()),
        }
    }

    fn check_integer(&self, from: i64, to: i64, step: u64, value: i64) -> Result<(), SetError> {
        let (min, max) = (from.min(to), from.max(to));
        if value == min || value == max {
            return Ok(());
        }
        if value < min || value > max {
            // rclpy has a full stop here for integers only.
            return Err(self.out_of_range(".", [min, max, value].map(|number| number.to_string())));
        }
        // value > min, so the distance fits.
        let distance = value.abs_diff(min);
        if distance.checked_rem(step).unwrap_or(0) != 0 {
            let numbers = [min, max, value].map(|number| number.to_string());
            return Err(self.off_step("", numbers, &step.to_string()));
        }
        Ok(())
    }

    fn check_double(&self, from: f64, to: f64, step: f64, value: f64) -> Result<(), SetError> {
        let (min, max) = (from.min(to), from.max(to));
        if is_close(value, min) || is_close(value, max) {
            return Ok(());
        }
        // Not a number is in no range.
        if !(min < value && value < max) {
            return Err(self.out_of_range("", [min, max, value].map(python)));
        }
        if step != 0.0 && !is_close(min + ((value - min) / step).round() * step, value) {
            let numbers = [min, max, value].map(python);
            return Err(self.off_step("close enough to ", numbers, &python(step)));
        }
        Ok(())
    }

    fn out_of_range(&self, dot: &str, [min, max, value]: [String; 3]) -> SetError {
        let name = &self.name;
        SetError::Range(format!(
            "Parameter {name} out of range{dot} Min: {min}, Max: {max}, value: {value}"
        ))
    }

    fn off_step(&self, close: &str, [min, max, value]: [String; 3], step: &str) -> SetError {
        let name = &self.name;
        SetError::Range(format!(
            "The parameter value for {name} is not {close}a valid step. Min: {min}, max: {max}, \
             value: {value}, step: {step}"
        ))
    }
}

impl ParameterRange {
    /// Type of the values in the range.
    pub fn parameter_type(&self) -> ParameterType {
        match self {
            Self::Integer { .. } => ParameterType::Integer,
            Self::Double { .. } => ParameterType::Double,
        }
    }
}

/// A number in an error, written as Python does: `1.0`, `1e+16`, `inf`.
fn python(number: f64) -> String {
    DefaultValue::One(Literal::Float(number)).to_python()
}

fn is_close(a: f64, b: f64) -> bool {
    // Equal infinities have no difference.
    let equal = a == b;
    equal || (a - b).abs() <= TOLERANCE * a.abs().max(b.abs()) && a.is_finite() && b.is_finite()
}
