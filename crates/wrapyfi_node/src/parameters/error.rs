//! Errors of declaring, reading and setting parameters. Where a service carries the reason to a
//! client, [`SetError::reason`] has the words of rclpy, which people search for.

use crate::ParameterType;

/// Error of declaring a parameter.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DeclareError {
    /// The parameter has no name.
    #[error("a parameter has an empty name; give it one")]
    EmptyName,
    /// The name is too long.
    #[error("the parameter name {start:?}… has {length} bytes, the limit is {limit}; shorten it")]
    NameTooLong {
        /// First characters of the name.
        start: String,
        /// Length of the name in bytes.
        length: usize,
        /// [`MAX_NAME_BYTES`](super::MAX_NAME_BYTES).
        limit: usize,
    },
    /// The name has a NUL, which ends texts on the wire.
    #[error("the parameter name {name:?} contains a NUL; leave it out")]
    NameNul {
        /// The name.
        name: String,
    },
    /// A parameter of this name is declared already.
    #[error("parameter {name} is declared already; declare it once")]
    AlreadyDeclared {
        /// The name.
        name: String,
    },
    /// The node has too many parameters.
    #[error("parameter {name} is one too many: a node has at most {limit}; use lists instead")]
    TooMany {
        /// The name.
        name: String,
        /// [`MAX_PARAMETERS`](super::MAX_PARAMETERS).
        limit: usize,
    },
    /// The default value is of another type than the descriptor says.
    #[error("parameter {name} is declared as {expected}, but its default value is {found}")]
    DefaultType {
        /// The name.
        name: String,
        /// Type in the descriptor.
        expected: ParameterType,
        /// Type of the value.
        found: ParameterType,
    },
    /// Neither the descriptor nor the default value says of which type it is.
    #[error("parameter {name} has no type; give a default value, a type, or dynamic typing")]
    NoType {
        /// The name.
        name: String,
    },
    /// The range is of another type than the parameter.
    #[error("parameter {name} is {found}, but its range is one of {range}")]
    RangeType {
        /// The name.
        name: String,
        /// Type of the parameter.
        found: ParameterType,
        /// Type of the range.
        range: ParameterType,
    },
    /// The value given from outside is of another type.
    #[error(
        "Trying to set parameter '{name}' to '{value}' of type '{found}', expecting type \
         '{expected}': write {hint}"
    )]
    OverrideType {
        /// The name.
        name: String,
        /// The value, cut where it is long.
        value: String,
        /// Type of the value that was given.
        found: ParameterType,
        /// Type of the parameter.
        expected: ParameterType,
        /// Example of a value of this type, as it is written on the command line.
        hint: String,
    },
    /// The value given from outside is not allowed.
    #[error("parameter {} cannot be what the command line or a parameter file says: {source}", source.name())]
    Override {
        /// Cause.
        source: SetError,
    },
    /// The default value is not allowed.
    #[error("parameter {} cannot have its default value: {source}", source.name())]
    Default {
        /// Cause.
        source: SetError,
    },
}

/// Error of reading a parameter.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum GetError {
    /// No parameter of this name is declared.
    #[error(
        "parameter {name} is not declared by this node; `ros2 param list` shows those that are"
    )]
    NotDeclared {
        /// The name.
        name: String,
    },
    /// The parameter is declared without a value, and none was given.
    #[error("parameter {name} has no value yet; give one with -p {name}:=… or `ros2 param set`")]
    NotInitialized {
        /// The name.
        name: String,
    },
}

/// Error of setting a parameter.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SetError {
    /// No parameter of this name is declared.
    #[error(
        "parameter {name} is not declared by this node; `ros2 param list` shows those that are"
    )]
    NotDeclared {
        /// The name.
        name: String,
    },
    /// The parameter keeps the value with which it was declared.
    #[error("Trying to set a read-only parameter: {name}.")]
    ReadOnly {
        /// The name.
        name: String,
    },
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
    #[error("parameter {name}: {STATIC_TYPE}")]
    StaticType {
        /// The name.
        name: String,
    },
    /// The value is outside the range.
    #[error("Parameter {name} out of range{} Min: {min}, Max: {max}, value: {value}", dot(*.kind))]
    OutOfRange {
        /// The name.
        name: String,
        /// `INTEGER` or `DOUBLE`.
        kind: ParameterType,
        /// Least value.
        min: Box<str>,
        /// Largest value.
        max: Box<str>,
        /// The value.
        value: Box<str>,
    },
    /// The value is between the steps of the range.
    #[error(
        "The parameter value for {name} is not {}a valid step. Min: {min}, max: {max}, value: \
         {value}, step: {step}",
        close(*.kind)
    )]
    OffStep {
        /// The name.
        name: String,
        /// `INTEGER` or `DOUBLE`.
        kind: ParameterType,
        /// Least value.
        min: Box<str>,
        /// Largest value.
        max: Box<str>,
        /// The value.
        value: Box<str>,
        /// Distance of allowed values.
        step: Box<str>,
    },
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
    #[error("parameter {name} is in one atomic request twice; send it once")]
    Twice {
        /// The name.
        name: String,
    },
    /// One request has too many parameters.
    #[error("{count} parameters in one request, the limit is {limit}; send several requests")]
    TooMany {
        /// Number of parameters.
        count: usize,
        /// [`MAX_PARAMETERS`](super::MAX_PARAMETERS).
        limit: usize,
    },
    /// A validator of the node refuses the value.
    #[error("parameter {name} was refused: {reason}")]
    Refused {
        /// The name, the first one of an atomic request.
        name: String,
        /// Reason that the validator gave.
        reason: String,
    },
}

const STATIC_TYPE: &str = "Static parameter cannot be undeclared";

fn wrong_type(expected: ParameterType, found: ParameterType) -> String {
    format!("Wrong parameter type, expected 'Type.{expected}' got 'Type.{found}'")
}

/// rclpy has a full stop here for integers only.
fn dot(kind: ParameterType) -> &'static str {
    if kind == ParameterType::Integer { "." } else { "" }
}

fn close(kind: ParameterType) -> &'static str {
    if kind == ParameterType::Integer { "" } else { "close enough to " }
}

impl SetError {
    /// Name of the parameter; empty for an error of a whole request.
    #[must_use]
    pub fn name(&self) -> &str {
        match self {
            Self::NotDeclared { name }
            | Self::ReadOnly { name }
            | Self::WrongType { name, .. }
            | Self::StaticType { name }
            | Self::OutOfRange { name, .. }
            | Self::OffStep { name, .. }
            | Self::TooLarge { name, .. }
            | Self::UnknownType { name, .. }
            | Self::Twice { name }
            | Self::Refused { name, .. } => name,
            Self::TooMany { .. } => "",
        }
    }

    /// Text for `SetParametersResult.reason`, in the words of rclpy where it has some.
    #[must_use]
    pub fn reason(&self) -> String {
        match self {
            // rclpy's brackets are empty too.
            Self::NotDeclared { .. } => "Invalid access to undeclared parameter(s): []".to_owned(),
            Self::WrongType { expected, found, .. } => wrong_type(*expected, *found),
            Self::StaticType { .. } => STATIC_TYPE.to_owned(),
            Self::Refused { reason, .. } => reason.clone(),
            _ => self.to_string(),
        }
    }
}
