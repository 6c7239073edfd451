//! Errors of reading a definition.

/// A line of a definition that could not be read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{interface}, line {line}: {fault} (the line is {text:?})")]
pub struct ParseError {
    /// Name of the definition being read.
    pub interface: String,
    /// Line, counted from 1.
    pub line: usize,
    /// The line itself, trimmed.
    pub text: String,
    /// Fault of the line.
    #[source]
    pub fault: ParseFault,
}

/// Fault of a line or a name.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ParseFault {
    /// A type without a name behind it.
    #[error("a name must follow the type")]
    MissingName,
    /// A package name breaks the rules.
    #[error("{0:?} is no package name; use lower case letters, digits and single underscores")]
    PackageName(String),
    /// A type is neither built in nor a valid message name.
    #[error("{0:?} is no type; use a built-in type, `Name` or `package/Name`, names in CamelCase")]
    TypeName(String),
    /// A field name breaks the rules.
    #[error("{0:?} is no field name; use lower case letters, digits and single underscores")]
    FieldName(String),
    /// A constant name breaks the rules.
    #[error("{0:?} is no constant name; use upper case letters, digits and single underscores")]
    ConstantName(String),
    /// The name was used before.
    #[error("{0:?} is defined twice")]
    Duplicate(String),
    /// A bound or an array size is no positive 32-bit number.
    #[error("{0:?} is no size; use a number from 1 to 4294967295")]
    Size(String),
    /// Constants are primitives or strings.
    #[error("a constant cannot be of type {0:?}; use a primitive type or string")]
    ConstantType(String),
    /// Messages have no default value.
    #[error("a field of a message type cannot have a default value")]
    NestedDefault,
    /// A value does not fit its type.
    #[error("{text:?} is no value for {type_name}")]
    Value {
        /// Value as written.
        text: String,
        /// Type it is for.
        type_name: String,
    },
    /// The number of default elements does not fit the field.
    #[error("{actual} default values for {expected} elements")]
    DefaultCount {
        /// Elements written.
        actual: usize,
        /// `exactly N` or `at most N`.
        expected: String,
    },
    /// A word that ROS 1 does not know.
    #[error("ROS 1 has no such thing as {0}; read the definition as one of ROS 2")]
    OnlyRos2(&'static str),
    /// The parts of a service or an action are not as many as they must be.
    #[error(
        "{separators} lines with `---` where {expected} are needed; write {parts}, each of which \
         may be empty"
    )]
    Sections {
        /// Separators there are.
        separators: usize,
        /// Separators there must be.
        expected: usize,
        /// The parts in words.
        parts: &'static str,
    },
    /// A message was asked for under the name of a service or an action, or the other way round.
    #[error("{name} is no {expected}; its name must read package/{expected}/Name")]
    Kind {
        /// The name given.
        name: String,
        /// `msg`, `srv` or `action`.
        expected: &'static str,
    },
}
