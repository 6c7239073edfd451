//! Values of node parameters, as the command line and parameter files give them.

use std::fmt;

/// Value of a parameter, in the types ROS 2 has.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum ParameterValue {
    /// Declared or overridden, but without a value.
    #[default]
    NotSet,
    /// `true` or `false`.
    Bool(bool),
    /// 64-bit integer.
    Integer(i64),
    /// Floating point number.
    Double(f64),
    /// Text.
    String(String),
    /// Bytes; no command line makes them.
    ByteArray(Vec<u8>),
    /// List of `true` and `false`.
    BoolArray(Vec<bool>),
    /// List of integers.
    IntegerArray(Vec<i64>),
    /// List of floating point numbers.
    DoubleArray(Vec<f64>),
    /// List of texts.
    StringArray(Vec<String>),
}

impl ParameterValue {
    /// Name of the type in messages, for instance `INTEGER_ARRAY`.
    #[must_use]
    pub fn type_name(&self) -> &'static str {
        match self {
            Self::NotSet => "NOT_SET",
            Self::Bool(_) => "BOOL",
            Self::Integer(_) => "INTEGER",
            Self::Double(_) => "DOUBLE",
            Self::String(_) => "STRING",
            Self::ByteArray(_) => "BYTE_ARRAY",
            Self::BoolArray(_) => "BOOL_ARRAY",
            Self::IntegerArray(_) => "INTEGER_ARRAY",
            Self::DoubleArray(_) => "DOUBLE_ARRAY",
            Self::StringArray(_) => "STRING_ARRAY",
        }
    }
}

impl fmt::Display for ParameterValue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotSet => f.write_str("not set"),
            Self::Bool(value) => write!(f, "{value}"),
            Self::Integer(value) => write!(f, "{value}"),
            Self::Double(value) => write!(f, "{value:?}"),
            Self::String(value) => f.write_str(value),
            Self::ByteArray(values) => write!(f, "{values:?}"),
            Self::BoolArray(values) => write!(f, "{values:?}"),
            Self::IntegerArray(values) => write!(f, "{values:?}"),
            Self::DoubleArray(values) => write!(f, "{values:?}"),
            Self::StringArray(values) => write!(f, "{values:?}"),
        }
    }
}
