//! A name and a value.

use crate::ParameterValue;

/// A parameter with a value.
///
/// ```
/// use wrapyfi_node::ParameterValue;
/// use wrapyfi_node::parameters::Parameter;
/// let rate = Parameter::new("camera.rate", 30);
/// assert_eq!(rate.value, ParameterValue::Integer(30));
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// Name; groups end with dots, as in `camera.rate`.
    pub name: String,
    /// Value; [`ParameterValue::NotSet`] deletes a parameter of dynamic type.
    pub value: ParameterValue,
}

impl Parameter {
    /// A parameter of this name and value.
    pub fn new(name: impl Into<String>, value: impl Into<ParameterValue>) -> Self {
        Self { name: name.into(), value: value.into() }
    }

    pub(super) fn size(&self) -> usize {
        self.name.len().saturating_add(self.value.size())
    }
}
