//! Errors of compiling a type, and of values that do not fit their type.

use serde_json::Value;

use crate::cdr::{path_in_element, path_in_field};

/// Error of compiling a type into a plan.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct PlanError(pub(super) String);

/// Error of a value that does not fit its type. `path` is the field, for instance
/// `poses[2].position.x`.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ValueError {
    /// A message has no such field.
    #[error("{path}: {message} has no such field{}", did_you_mean(suggestion))]
    UnknownField {
        /// The field.
        path: String,
        /// Type of the message.
        message: String,
        /// The field that was probably meant.
        suggestion: Option<String>,
    },
    /// The value is of another kind.
    #[error("{}needs {expected}, found {found}", at(path))]
    Kind {
        /// The field; empty for the message as a whole.
        path: String,
        /// Type of the field.
        expected: String,
        /// Kind of the value that was given.
        found: String,
    },
    /// A number is outside its type.
    #[error("{path}: {value} is no {expected}, which goes from {low} to {high}")]
    Range {
        /// The field.
        path: String,
        /// Value as given.
        value: String,
        /// Type of the field.
        expected: &'static str,
        /// Least value.
        low: String,
        /// Largest value.
        high: String,
    },
    /// There are too many or too few elements or characters.
    #[error("{path} has {actual} {unit}, it must have {expected}")]
    Count {
        /// The field.
        path: String,
        /// Number that there are.
        actual: usize,
        /// `elements` or `characters`.
        unit: &'static str,
        /// `exactly N` or `at most N`.
        expected: String,
    },
    /// The message would become too large.
    #[error(
        "{}the message needs more than the {limit} bytes allowed; send less, or raise the limit",
        at(path)
    )]
    TooLarge {
        /// The field that does not fit any more.
        path: String,
        /// The limit in bytes.
        limit: usize,
    },
}

fn did_you_mean(suggestion: &Option<String>) -> String {
    suggestion.as_ref().map(|name| format!("; did you mean {name:?}?")).unwrap_or_default()
}

fn at(path: &str) -> String {
    if path.is_empty() { String::new() } else { format!("{path}: ") }
}

impl ValueError {
    /// The same error, seen from the message that has the value in its field `name`.
    #[must_use]
    pub(super) fn in_field(mut self, name: &str) -> Self {
        let path = self.path_mut();
        *path = path_in_field(path, name);
        self
    }

    /// The same error, seen from the sequence that has the value at `index`.
    #[must_use]
    pub(super) fn in_element(mut self, index: usize) -> Self {
        let path = self.path_mut();
        *path = path_in_element(path, index);
        self
    }

    fn path_mut(&mut self) -> &mut String {
        match self {
            Self::UnknownField { path, .. }
            | Self::Kind { path, .. }
            | Self::Range { path, .. }
            | Self::Count { path, .. }
            | Self::TooLarge { path, .. } => path,
        }
    }
}

/// The error for a value of another kind.
pub(super) fn kind(expected: String, json: &Value) -> ValueError {
    let found = match json {
        Value::Null => "null".to_owned(),
        Value::Bool(value) => format!("the boolean {value}"),
        Value::Number(value) => format!("the number {value}"),
        Value::String(text) if text.chars().count() <= 40 => format!("the string {text:?}"),
        Value::String(text) => format!("a string of {} bytes", text.len()),
        Value::Array(elements) => format!("an array of {} elements", elements.len()),
        Value::Object(fields) => format!("an object with {} fields", fields.len()),
    };
    ValueError::Kind { path: String::new(), expected, found }
}
