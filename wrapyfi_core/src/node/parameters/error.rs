//! Why parameters are not declared, read or set. Where a service carries the reason to a client,
//! [`SetError::reason`] has the words of rclpy, which people search for.

use crate::node::ParameterType;

/// Why a parameter was not declared.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DeclareError {
    /// It has no name.
    #[error("a parameter has an empty name; give it one")]
    EmptyName,
    /// Its name is too long.
    #[error("the parameter name {start:?}… has {length} bytes, the limit is {limit}; shorten it")]
    NameTooLong {
        /// First characters of the name.
        start: String,
        /// Its length in bytes.
        length: usize,
        /// [`MAX_NAME_BYTES`](super::MAX_NAME_BYTES).
        limit: usize,
    },
    /// Its name has a NUL, which ends texts on the wire.
    #[error("the parameter name {name:?} contains a NUL; leave it out")]
    NameNul {
        /// The name.
        name: String,
    },
    /// There is one of this name.
    #[error("parameter {name} is declared already; declare it once")]
    AlreadyDeclared {
        /// The name.
        name: String,
    },
    /// The node has too many.
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
        /// Its type.
        found: ParameterType,
        /// Type of the parameter.
        expected: ParameterType,
        /// How a value of this type is written.
        hint: String,
    },
    /// The value given from outside is not allowed.
    #[error("parameter {} cannot be what the command line or a parameter file says: {source}", source.name())]
    Override {
        /// Why not.
        source: SetError,
    },
    /// The default value is not allowed.
    #[error("parameter {} cannot have its default value: {source}", source.name())]
    Default {
        /// Why not.
        source: SetError,
    },
}

/// Why a parameter has no value to give.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum GetError {
    /// There is none of this name.
    #[error(
        "parameter {name} is not declared by this node; `ros2 param list` shows those that are"
    )]
    NotDeclared {
        /// The name.
        name: String,
    },
    /// It is declared without a value, and nobody gave one.
    #[error("parameter {name} has no value yet; give one with -p {name}:=… or `ros2 param set`")]
    NotInitialized {
        /// The name.
        name: String,
    },
}

/// Why a parameter was not removed.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum UndeclareError {
    /// There is none of this name.
    #[error(
        "parameter {name} is not declared by this node; `ros2 param list` shows those that are"
    )]
    NotDeclared {
        /// The name.
        name: String,
    },
    /// It stays what it is as long as the node lives.
    #[error("parameter {name} is read-only and stays as long as its node")]
    ReadOnly {
        /// The name.
        name: String,
    },
}

/// Why a parameter was not set.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SetError {
    /// There is none of this name.
    #[error(
        "parameter {name} is not declared by this node; `ros2 param list` shows those that are"
    )]
    NotDeclared {
        /// The name.
        name: String,
    },
    /// It keeps the value it was declared with.
    #[error("Trying to set a read-only parameter: {name}.")]
    ReadOnly {
        /// The name.
        name: String,
    },
    /// It keeps its type.
    #[error("parameter {name}: {}", wrong_type(*.expected, *.found))]
    WrongType {
        /// The name.
        name: String,
        /// Type of the parameter.
        expected: ParameterType,
        /// Type of the value.
        found: ParameterType,
    },
    /// No value would delete it, but it keeps its type.
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
        /// Its size in bytes.
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
    /// One request names it twice.
    #[error("parameter {name} is in one atomic request twice; send it once")]
    Twice {
        /// The name.
        name: String,
    },
    /// One request has too many.
    #[error("{count} parameters in one request, the limit is {limit}; send several requests")]
    TooMany {
        /// Number of parameters.
        count: usize,
        /// [`MAX_PARAMETERS`](super::MAX_PARAMETERS).
        limit: usize,
    },
    /// A validator of the node does not want it.
    #[error("parameter {name} was refused: {reason}")]
    Refused {
        /// The name, the first one of an atomic request.
        name: String,
        /// What the validator said.
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
    /// Name of the parameter; empty where it is about a whole request.
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

    /// What `SetParametersResult.reason` says, in the words of rclpy where it has some.
    #[must_use]
    pub fn reason(&self) -> String {
        match self {
            // The brackets are empty there too.
            Self::NotDeclared { .. } => "Invalid access to undeclared parameter(s): []".to_owned(),
            Self::WrongType { expected, found, .. } => wrong_type(*expected, *found),
            Self::StaticType { .. } => STATIC_TYPE.to_owned(),
            Self::Refused { reason, .. } => reason.clone(),
            _ => self.to_string(),
        }
    }
}
