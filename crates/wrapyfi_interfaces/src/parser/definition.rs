//! Contents of a definition: names, fields, types, constants.

use std::fmt;

use super::{DefaultValue, Literal, TypeName};
use crate::named;

/// A parsed `.msg` file, or a part of a service or an action.
#[derive(Debug, Clone, PartialEq)]
pub struct MessageDefinition {
    /// Full name.
    pub name: TypeName,
    /// Comment lines that open the file.
    pub doc: Vec<String>,
    /// Fields in the order they are serialised.
    pub fields: Vec<Field>,
    /// Constants; they take no room in a message.
    pub constants: Vec<Constant>,
}

impl MessageDefinition {
    /// A message without constants and comments.
    pub(crate) fn new(name: TypeName, fields: Vec<Field>) -> Self {
        Self { name, doc: Vec::new(), fields, constants: Vec::new() }
    }
}

/// A field of a message.
#[derive(Debug, Clone, PartialEq)]
pub struct Field {
    /// Name, lower case (ROS 1 allows upper case too).
    pub name: String,
    /// Type.
    pub field_type: FieldType,
    /// Value in a freshly made message, where the definition states one.
    pub default: Option<DefaultValue>,
    /// Comment lines above the field and behind it.
    pub doc: Vec<String>,
}

impl Field {
    /// A field without default value and comments.
    pub(crate) fn new(name: &str, element: Element, container: Container) -> Self {
        let field_type = FieldType { element, container };
        Self { name: name.to_owned(), field_type, default: None, doc: Vec::new() }
    }
}

/// A named constant of a message.
#[derive(Debug, Clone, PartialEq)]
pub struct Constant {
    /// Name, upper case.
    pub name: String,
    /// Type: a primitive or an unbounded string.
    pub element: Element,
    /// Value, checked against the type.
    pub value: Literal,
    /// Value as the definition writes it; ROS 1 checksums cover this text.
    pub written: String,
    /// Comment lines above the constant and behind it.
    pub doc: Vec<String>,
}

/// Type of a field: an element, alone or many of it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FieldType {
    /// Type of one element.
    pub element: Element,
    /// Number of elements.
    pub container: Container,
}

/// Number of elements of a field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Container {
    /// One: `uint8 x`.
    Single,
    /// A fixed number: `uint8[16] x`.
    Array(u32),
    /// Any number, `uint8[] x`, or at most so many, `uint8[<=16] x`.
    Sequence {
        /// Largest number of elements.
        bound: Option<u32>,
    },
}

/// Type of one element.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Element {
    /// A number, a boolean or a byte.
    Primitive(Primitive),
    /// UTF-8 text: `string`, `string<=256`.
    String {
        /// Largest size in bytes, without the terminator.
        bound: Option<u32>,
    },
    /// UTF-16 text: `wstring`, `wstring<=256`.
    WString {
        /// Largest size in code units.
        bound: Option<u32>,
    },
    /// Another message.
    Nested(TypeName),
}

named! {
    /// Primitive types under their `.msg` names.
    #[allow(missing_docs)] // the names are the documentation
    pub enum Primitive {
        Bool => "bool",
        Byte => "byte",
        Char => "char",
        Int8 => "int8",
        Uint8 => "uint8",
        Int16 => "int16",
        Uint16 => "uint16",
        Int32 => "int32",
        Uint32 => "uint32",
        Int64 => "int64",
        Uint64 => "uint64",
        Float32 => "float32",
        Float64 => "float64",
    }
    /// The name in definitions, for instance `uint8`.
    pub fn name, from_name;
}

impl Primitive {
    /// Size in bytes, which is its alignment in CDR too.
    pub fn size(self) -> usize {
        match self {
            Self::Bool | Self::Byte | Self::Char | Self::Int8 | Self::Uint8 => 1,
            Self::Int16 | Self::Uint16 => 2,
            Self::Int32 | Self::Uint32 | Self::Float32 => 4,
            Self::Int64 | Self::Uint64 | Self::Float64 => 8,
        }
    }
}

impl fmt::Display for Element {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Primitive(primitive) => f.write_str(primitive.name()),
            Self::String { bound: None } => f.write_str("string"),
            Self::String { bound: Some(bound) } => write!(f, "string<={bound}"),
            Self::WString { bound: None } => f.write_str("wstring"),
            Self::WString { bound: Some(bound) } => write!(f, "wstring<={bound}"),
            Self::Nested(name) => write!(f, "{}/{}", name.package(), name.name()),
        }
    }
}

impl Container {
    /// Number of its elements, where that is not `actual`.
    pub(crate) fn other_count(self, actual: usize) -> Option<String> {
        match self {
            Self::Array(size) if actual != size as usize => Some(format!("exactly {size}")),
            Self::Sequence { bound: Some(bound) } if actual > bound as usize => {
                Some(format!("at most {bound}"))
            }
            _ => None,
        }
    }
}

impl fmt::Display for Container {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Single => Ok(()),
            Self::Array(size) => write!(f, "[{size}]"),
            Self::Sequence { bound: Some(bound) } => write!(f, "[<={bound}]"),
            Self::Sequence { bound: None } => f.write_str("[]"),
        }
    }
}

/// Writes the type as a definition does, with the package of a nested type.
impl fmt::Display for FieldType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}{}", self.element, self.container)
    }
}
