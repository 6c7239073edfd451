//! Errors of declaring, reading and setting parameters. [`SetError::reason`], which a service
//! carries to a client, has the words of rclpy, which people search for.

use crate::ParameterType;

/// Error of declaring a parameter.
///
/// ```
/// use std::collections::BTreeMap;
/// use wrapyfi_node::parameters::{ParameterDescriptor, ParameterStore};
/// use wrapyfi_node::NodeName;
/// let mut store = ParameterStore::new(&NodeName::new("camera", "/")?, BTreeMap::new())?;
/// store.declare(ParameterDescriptor::new("rate"), 30)?;
/// let error = store.declare(ParameterDescriptor::new("rate"), 30).unwrap_err();
/// assert_eq!(error.to_string(), "parameter rate is declared already; declare it once");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DeclareError {
    /// The name, the type or the range cannot be, or does not go with the values.
    #[error("{0}")]
    Unfit(String),
    /// A parameter of this name is declared already.
    #[error("parameter {0} is declared already; declare it once")]
    AlreadyDeclared(String),
    /// The value given from outside is not allowed.
    #[error("parameter {0} cannot be what the command line or a parameter file says: {1}")]
    Override(String, #[source] SetError),
    /// The default value is not allowed.
    #[error("parameter {0} cannot have its default value: {1}")]
    Default(String, #[source] SetError),
}

/// Error of reading a parameter.
///
/// ```
/// use std::collections::BTreeMap;
/// use wrapyfi_node::parameters::{GetError, ParameterStore};
/// use wrapyfi_node::NodeName;
/// let store = ParameterStore::new(&NodeName::new("camera", "/")?, BTreeMap::new())?;
/// assert_eq!(store.get("rate"), Err(GetError::NotDeclared("rate".into())));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum GetError {
    /// No parameter of this name is declared.
    #[error("parameter {0} is not declared by this node; `ros2 param list` shows those that are")]
    NotDeclared(String),
    /// The parameter is declared without a value, and none was given.
    #[error("parameter {0} has no value yet; give one with -p {0}:=… or `ros2 param set`")]
    NotInitialized(String),
}

/// Error of setting a parameter.
///
/// ```
/// use std::collections::BTreeMap;
/// use wrapyfi_node::parameters::{ParameterDescriptor, ParameterStore};
/// use wrapyfi_node::NodeName;
/// let mut store = ParameterStore::new(&NodeName::new("camera", "/")?, BTreeMap::new())?;
/// store.declare(ParameterDescriptor::new("rate"), 30)?;
/// let error = store.set("rate", "fast").unwrap_err();
/// assert!(error.to_string().starts_with("parameter rate: Wrong parameter type, expected "));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SetError {
    /// No parameter of this name is declared.
    #[error("parameter {0} is not declared by this node; `ros2 param list` shows those that are")]
    NotDeclared(String),
    /// The parameter keeps the value with which it was declared.
    #[error("Trying to set a read-only parameter: {0}.")]
    ReadOnly(String),
    /// The parameter keeps its type.
    #[error("parameter {name}: {}", wrong_type(*.expected, *.found))]
    WrongType {
        /// The name.
        name: String,
        /// Type of the parameter.
        expected: ParameterType,
        /// Type of the value.
        found: ParameterType,
    },
    /// A value without type would delete the parameter, which keeps its type.
    #[error("parameter {0}: {STATIC_TYPE}")]
    StaticType(String),
    /// The value is outside the range, or between its steps; the text has the range.
    #[error("{0}")]
    Range(String),
    /// The value is too large.
    #[error("the value for parameter {name} has {size} bytes, the limit is {limit}")]
    TooLarge {
        /// The name.
        name: String,
        /// Size of the value in bytes.
        size: usize,
        /// [`MAX_VALUE_BYTES`](super::MAX_VALUE_BYTES).
        limit: usize,
    },
    /// The message names a type that ROS 2 has not.
    #[error(
        "the value for parameter {name} has type {number}; types are 0 (NOT_SET) to 9 (STRING_ARRAY)"
    )]
    UnknownType {
        /// The name.
        name: String,
        /// Number of the type.
        number: u8,
    },
    /// One request names the parameter twice.
    #[error("parameter {0} is in one atomic request twice; send it once")]
    Twice(String),
    /// One request has too many parameters.
    #[error("{count} parameters in one request, the limit is {limit}; send several requests")]
    TooMany {
        /// Number of parameters.
        count: usize,
        /// [`MAX_PARAMETERS`](super::MAX_PARAMETERS).
        limit: usize,
    },
}

const STATIC_TYPE: &str = "Static parameter cannot be undeclared";

fn wrong_type(expected: ParameterType, found: ParameterType) -> String {
    format!("Wrong parameter type, expected 'Type.{expected}' got 'Type.{found}'")
}

impl SetError {
    /// Text for `SetParametersResult.reason`, in the words of rclpy where it has some.
    pub fn reason(&self) -> String {
        match self {
            // rclpy's brackets are empty too.
            Self::NotDeclared { .. } => "Invalid access to undeclared parameter(s): []".to_owned(),
            Self::WrongType { expected, found, .. } => wrong_type(*expected, *found),
            Self::StaticType { .. } => STATIC_TYPE.to_owned(),
            _ => self.to_string(),
        }
    }
}
