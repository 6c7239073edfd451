//! Values of node parameters and their types.

use std::fmt;

use wrapyfi_interfaces::named;

/// Value of a parameter, in the types of ROS 2.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::types; }
/// use wrapyfi_core::types::ParameterValue;
/// let rate = ParameterValue::from(30);
/// assert_eq!((rate.type_name(), rate.to_string().as_str()), ("INTEGER", "30"));
/// assert_eq!(ParameterValue::from(vec![0.5, 1.0]).to_string(), "[0.5, 1.0]");
/// ```
#[derive(Debug, Clone, PartialEq, Default)]
pub enum ParameterValue {
    /// No value, of a parameter that is declared or overridden.
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
    /// Bytes, which no command line can write.
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

named! {
    /// Types of parameters; the numbers are those of `rcl_interfaces/msg/ParameterType`.
    ///
    /// ```
    /// use wrapyfi_data::types::{ParameterType, ParameterValue};
    /// let kind = ParameterType::from_number(7).unwrap();
    /// assert_eq!(kind.name(), "INTEGER_ARRAY");
    /// assert_eq!(kind.empty_list(), Some(ParameterValue::IntegerArray(Vec::new())));
    /// ```
    #[derive(PartialOrd, Ord, Default)]
    pub enum ParameterType {
        /// No value.
        #[default]
        NotSet = 0 => "NOT_SET",
        /// `true` or `false`.
        Bool = 1 => "BOOL",
        /// 64-bit integer.
        Integer = 2 => "INTEGER",
        /// Floating point number.
        Double = 3 => "DOUBLE",
        /// Text.
        String = 4 => "STRING",
        /// Bytes.
        ByteArray = 5 => "BYTE_ARRAY",
        /// List of `true` and `false`.
        BoolArray = 6 => "BOOL_ARRAY",
        /// List of integers.
        IntegerArray = 7 => "INTEGER_ARRAY",
        /// List of floating point numbers.
        DoubleArray = 8 => "DOUBLE_ARRAY",
        /// List of texts.
        StringArray = 9 => "STRING_ARRAY",
    }
    /// Name in messages, for instance `INTEGER_ARRAY`.
    pub fn name;
}

impl ParameterType {
    /// Type with this number.
    pub fn from_number(number: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.number() == number)
    }

    /// Number in messages, for instance 7.
    pub fn number(self) -> u8 {
        self as u8
    }

    /// The empty list of this type; `None` of a type that is no list.
    pub fn empty_list(self) -> Option<ParameterValue> {
        Some(match self {
            Self::ByteArray => ParameterValue::ByteArray(Vec::new()),
            Self::BoolArray => ParameterValue::BoolArray(Vec::new()),
            Self::IntegerArray => ParameterValue::IntegerArray(Vec::new()),
            Self::DoubleArray => ParameterValue::DoubleArray(Vec::new()),
            Self::StringArray => ParameterValue::StringArray(Vec::new()),
            _ => return None,
        })
    }
}

impl ParameterValue {
    /// Type of the value.
    #[doc(hidden)]
    pub fn parameter_type(&self) -> ParameterType {
        match self {
            Self::NotSet => ParameterType::NotSet,
            Self::Bool(_) => ParameterType::Bool,
            Self::Integer(_) => ParameterType::Integer,
            Self::Double(_) => ParameterType::Double,
            Self::String(_) => ParameterType::String,
            Self::ByteArray(_) => ParameterType::ByteArray,
            Self::BoolArray(_) => ParameterType::BoolArray,
            Self::IntegerArray(_) => ParameterType::IntegerArray,
            Self::DoubleArray(_) => ParameterType::DoubleArray,
            Self::StringArray(_) => ParameterType::StringArray,
        }
    }

    /// Name of the type in messages, for instance `INTEGER_ARRAY`.
    pub fn type_name(&self) -> &'static str {
        self.parameter_type().name()
    }

    /// Size of the value in a message in bytes, about: without padding and empty fields.
    pub fn size(&self) -> usize {
        match self {
            Self::NotSet => 0,
            Self::Bool(_) => 1,
            Self::Integer(_) | Self::Double(_) => 8,
            Self::String(text) => text.len(),
            Self::ByteArray(values) => values.len(),
            Self::BoolArray(values) => values.len(),
            Self::IntegerArray(values) => values.len().saturating_mul(8),
            Self::DoubleArray(values) => values.len().saturating_mul(8),
            // Length and terminator of each.
            Self::StringArray(values) => {
                values.iter().fold(0, |sum, text| sum.saturating_add(text.len()).saturating_add(5))
            }
        }
    }
}

macro_rules! from {
    ($($from:ty => $variant:ident,)*) => {$(
        impl From<$from> for ParameterValue {
            fn from(value: $from) -> Self {
                Self::$variant(value.into())
            }
        }
    )*};
}

from! {
    bool => Bool,
    i64 => Integer,
    f64 => Double,
    &str => String,
    String => String,
    Vec<u8> => ByteArray,
    Vec<bool> => BoolArray,
    Vec<i64> => IntegerArray,
    Vec<f64> => DoubleArray,
    Vec<String> => StringArray,
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
