//! The error of converting between Rust types and native objects.

use std::fmt::Display;

/// Error of a conversion between a Rust type and a native object.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::types; }
/// use wrapyfi_core::types::{Value, from_value};
/// let points = Value::from(vec![Value::from(1.5), Value::from("two")]);
/// let error = from_value::<Vec<f64>>(points).unwrap_err();
/// assert_eq!(error.to_string(), "at $[1]: invalid type: string \"two\", expected f64");
/// ```
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("at ${path}: {reason}")]
pub struct TypedError {
    /// Steps from the whole to the part, for instance `.pose[2]`; empty for the whole.
    path: String,
    reason: String,
}

impl TypedError {
    pub(super) fn new(reason: impl Display) -> Self {
        Self { path: String::new(), reason: reason.to_string() }
    }

    /// The same error, seen from the container that holds the part under `step`.
    pub(super) fn below(mut self, step: impl Display) -> Self {
        self.path = format!("{step}{}", self.path);
        self
    }
}

impl serde::ser::Error for TypedError {
    fn custom<T: Display>(reason: T) -> Self {
        Self::new(reason)
    }
}

impl serde::de::Error for TypedError {
    fn custom<T: Display>(reason: T) -> Self {
        Self::new(reason)
    }
}
