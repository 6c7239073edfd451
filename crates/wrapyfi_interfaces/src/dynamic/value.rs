//! Values of fields.

use bytes::Bytes;
use serde::{Serialize, Serializer};

use super::DynamicMessage;
use crate::cdr::CdrPrimitive;

/// Value of a field. Numbers keep the width that the definition gives them.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
#[allow(missing_docs)] // the numbers' names are their documentation
pub enum DynamicValue {
    Bool(bool),
    I8(i8),
    /// `uint8`, `byte` and `char`.
    U8(u8),
    I16(i16),
    U16(u16),
    I32(i32),
    U32(u32),
    I64(i64),
    U64(u64),
    #[serde(serialize_with = "number")]
    F32(f32),
    #[serde(serialize_with = "number")]
    F64(f64),
    /// `string` and `wstring`.
    Text(String),
    /// A nested message.
    Message(DynamicMessage),
    /// Array or sequence of primitives.
    Primitives(Primitives),
    /// Array or sequence of strings.
    Texts(Vec<String>),
    /// Array or sequence of messages, all of one type.
    Messages(Vec<DynamicMessage>),
}

/// Array or sequence of primitives, in one piece of memory.
#[derive(Debug, Clone, PartialEq)]
#[allow(missing_docs)]
pub enum Primitives {
    Bool(Vec<bool>),
    I8(Vec<i8>),
    /// `uint8`, `byte` and `char`; decoded ones share the memory of the serialised message.
    Bytes(Bytes),
    I16(Vec<i16>),
    U16(Vec<u16>),
    I32(Vec<i32>),
    U32(Vec<u32>),
    I64(Vec<i64>),
    U64(Vec<u64>),
    F32(Vec<f32>),
    F64(Vec<f64>),
}

/// Runs `$body` with `$values` as the elements.
#[doc(hidden)]
#[macro_export]
macro_rules! with_elements {
    ($primitives:expr, $values:ident => $body:expr) => {
        match $primitives {
            $crate::dynamic::Primitives::Bool($values) => $body,
            $crate::dynamic::Primitives::I8($values) => $body,
            $crate::dynamic::Primitives::Bytes($values) => $body,
            $crate::dynamic::Primitives::I16($values) => $body,
            $crate::dynamic::Primitives::U16($values) => $body,
            $crate::dynamic::Primitives::I32($values) => $body,
            $crate::dynamic::Primitives::U32($values) => $body,
            $crate::dynamic::Primitives::I64($values) => $body,
            $crate::dynamic::Primitives::U64($values) => $body,
            $crate::dynamic::Primitives::F32($values) => $body,
            $crate::dynamic::Primitives::F64($values) => $body,
        }
    };
}

impl Primitives {
    /// Number of elements.
    pub fn len(&self) -> usize {
        with_elements!(self, values => values.len())
    }

    /// True without elements.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Memory of the elements in bytes.
    pub fn byte_count(&self) -> usize {
        with_elements!(self, values => size_of_val(values.as_ref() as &[_]))
    }

    /// The first `count` elements, or all where there are fewer.
    #[must_use]
    pub fn prefix(&self, count: usize) -> Self {
        with_elements!(self, values => {
            values.iter().take(count).copied().collect::<Vec<_>>().into()
        })
    }
}

/// The primitives, by Rust type, variant and name in definitions; `uint8`, whose arrays are [`Bytes`],
/// stands apart.
macro_rules! primitives {
    ($($from:ty => $variant:ident, $name:literal;)*) => {
        $(
            impl From<Vec<$from>> for Primitives {
                fn from(values: Vec<$from>) -> Self {
                    Self::$variant(values)
                }
            }
        )*

        impl Primitives {
            /// Name of the elements' type in definitions; `uint8` for `byte` and `char` too.
            pub fn element_name(&self) -> &'static str {
                match self {
                    Self::Bytes(_) => "uint8",
                    $(Self::$variant(_) => $name,)*
                }
            }
        }

        impl DynamicValue {
            /// Name of the type in definitions, of a single primitive.
            fn primitive_name(&self) -> Option<&'static str> {
                match self {
                    Self::U8(_) => Some("uint8"),
                    $(Self::$variant(_) => Some($name),)*
                    _ => None,
                }
            }
        }

        conversions! {
            $($from => |value| Self::$variant(value);)*
            $(Vec<$from> => |values| Self::Primitives(values.into());)*
        }
    };
}

macro_rules! conversions {
    ($($from:ty => |$value:ident| $into:expr;)*) => {$(
        impl From<$from> for DynamicValue {
            fn from($value: $from) -> Self {
                $into
            }
        }
    )*};
}

primitives! {
    bool => Bool, "bool";
    i8 => I8, "int8";
    i16 => I16, "int16";
    u16 => U16, "uint16";
    i32 => I32, "int32";
    u32 => U32, "uint32";
    i64 => I64, "int64";
    u64 => U64, "uint64";
    f32 => F32, "float32";
    f64 => F64, "float64";
}

conversions! {
    u8 => |value| Self::U8(value);
    Vec<u8> => |values| Self::Primitives(values.into());
    Bytes => |bytes| Self::Primitives(Primitives::Bytes(bytes));
    Primitives => |values| Self::Primitives(values);
    &str => |text| Self::Text(text.to_owned());
    String => |text| Self::Text(text);
    Vec<String> => |texts| Self::Texts(texts);
    DynamicMessage => |message| Self::Message(message);
    Vec<DynamicMessage> => |messages| Self::Messages(messages);
}

impl From<Vec<u8>> for Primitives {
    fn from(values: Vec<u8>) -> Self {
        Self::Bytes(Bytes::from(values))
    }
}

impl DynamicValue {
    /// The text of a string.
    pub fn as_str(&self) -> Option<&str> {
        match self {
            Self::Text(text) => Some(text),
            _ => None,
        }
    }

    /// A number of any type; integers beyond 53 bits lose their last digits.
    pub fn as_f64(&self) -> Option<f64> {
        match self {
            Self::F32(value) => Some(f64::from(*value)),
            Self::F64(value) => Some(*value),
            other => other.as_integer().map(|value| value as f64),
        }
    }

    /// An integer of any type.
    pub fn as_integer(&self) -> Option<i128> {
        Some(match self {
            Self::I8(value) => i128::from(*value),
            Self::U8(value) => i128::from(*value),
            Self::I16(value) => i128::from(*value),
            Self::U16(value) => i128::from(*value),
            Self::I32(value) => i128::from(*value),
            Self::U32(value) => i128::from(*value),
            Self::I64(value) => i128::from(*value),
            Self::U64(value) => i128::from(*value),
            _ => return None,
        })
    }

    /// A nested message.
    pub fn as_message(&self) -> Option<&DynamicMessage> {
        match self {
            Self::Message(message) => Some(message),
            _ => None,
        }
    }

    /// Name of the value's kind, in the words of definitions.
    pub(super) fn kind_name(&self) -> String {
        match self {
            Self::Text(_) => "string".to_owned(),
            Self::Message(message) => message.type_name().to_owned(),
            Self::Primitives(values) => format!("{} {}", values.len(), values.element_name()),
            Self::Texts(values) => format!("{} string", values.len()),
            Self::Messages(values) => match values.first() {
                None => "0 messages".to_owned(),
                Some(first) => format!("{} {}", values.len(), first.type_name()),
            },
            primitive => primitive.primitive_name().unwrap_or_default().to_owned(),
        }
    }
}

/// A float. Those of 32 bits are written with the digits of the double they equal, as ROS does.
pub(super) struct Number<T: CdrPrimitive + Into<f64>>(pub(super) T);

/// Writes one as a field.
fn number<T: CdrPrimitive + Into<f64>, S: Serializer>(
    value: &T,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    Number(*value).serialize(serializer)
}

impl<T: CdrPrimitive + Into<f64>> Serialize for Number<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self.0.into() {
            value if value.is_nan() => serializer.serialize_str("NaN"),
            f64::INFINITY => serializer.serialize_str("Infinity"),
            f64::NEG_INFINITY => serializer.serialize_str("-Infinity"),
            value => serializer.serialize_f64(value),
        }
    }
}
