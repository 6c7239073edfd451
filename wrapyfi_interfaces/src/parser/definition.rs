//! What a definition says: names, fields, types, constants.

use std::fmt;

use super::{DefaultValue, Literal, ParseFault};

/// Full name of a message type, written `sensor_msgs/msg/Image`.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct TypeName {
    package: String,
    name: String,
}

impl TypeName {
    /// A name from its parts, for instance `sensor_msgs` and `Image`.
    ///
    /// # Errors
    /// When a part breaks the ROS rules for names.
    pub fn new(package: &str, name: &str) -> Result<Self, ParseFault> {
        let package_ok = package.starts_with(|c: char| c.is_ascii_lowercase())
            && package.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_')
            && !package.contains("__")
            && !package.ends_with('_');
        if !package_ok {
            return Err(ParseFault::PackageName { name: package.to_owned() });
        }
        let name_ok = name.starts_with(|c: char| c.is_ascii_uppercase())
            && name.chars().all(|c| c.is_ascii_alphanumeric());
        if !name_ok {
            return Err(ParseFault::TypeName { name: name.to_owned() });
        }
        Ok(Self { package: package.to_owned(), name: name.to_owned() })
    }

    /// Package, for instance `sensor_msgs`.
    #[must_use]
    pub fn package(&self) -> &str {
        &self.package
    }

    /// Name inside the package, for instance `Image`.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Name of the type on DDS, for instance `sensor_msgs::msg::dds_::Image_`.
    #[must_use]
    pub fn dds(&self) -> String {
        format!("{}::msg::dds_::{}_", self.package, self.name)
    }
}

impl fmt::Display for TypeName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/msg/{}", self.package, self.name)
    }
}

/// A parsed `.msg` file.
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

/// A field of a message.
#[derive(Debug, Clone, PartialEq)]
pub struct Field {
    /// Name, lower case.
    pub name: String,
    /// Type.
    pub field_type: FieldType,
    /// Value in a freshly made message, where the definition states one.
    pub default: Option<DefaultValue>,
    /// Comment lines above the field and behind it.
    pub doc: Vec<String>,
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
    /// Comment lines above the constant and behind it.
    pub doc: Vec<String>,
}

/// Type of a field: an element, alone or many of it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FieldType {
    /// What one element is.
    pub element: Element,
    /// How many there are.
    pub container: Container,
}

/// How many elements a field has.
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

/// Primitive types under their `.msg` names.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(missing_docs)] // the names are the documentation
pub enum Primitive {
    Bool,
    Byte,
    Char,
    Int8,
    Uint8,
    Int16,
    Uint16,
    Int32,
    Uint32,
    Int64,
    Uint64,
    Float32,
    Float64,
}

impl Primitive {
    /// The primitive of that `.msg` name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Some(match name {
            "bool" => Self::Bool,
            "byte" => Self::Byte,
            "char" => Self::Char,
            "int8" => Self::Int8,
            "uint8" => Self::Uint8,
            "int16" => Self::Int16,
            "uint16" => Self::Uint16,
            "int32" => Self::Int32,
            "uint32" => Self::Uint32,
            "int64" => Self::Int64,
            "uint64" => Self::Uint64,
            "float32" => Self::Float32,
            "float64" => Self::Float64,
            _ => return None,
        })
    }

    /// Size in bytes, which is its alignment in CDR too.
    #[must_use]
    pub fn size(self) -> usize {
        match self {
            Self::Bool | Self::Byte | Self::Char | Self::Int8 | Self::Uint8 => 1,
            Self::Int16 | Self::Uint16 => 2,
            Self::Int32 | Self::Uint32 | Self::Float32 => 4,
            Self::Int64 | Self::Uint64 | Self::Float64 => 8,
        }
    }
}
