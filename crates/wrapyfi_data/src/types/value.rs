//! Wrapyfi's native object: what a Python script may return from a registered method.

use bytes::Bytes;
use num_bigint::BigInt;

use super::datetime::DateTime;
use super::image::Pixels;
use super::labelled::{Labelled, Picture, Quantity};
use super::map::Map;
use super::object::{ForeignObject, PluginObject};
use super::table::Table;
use super::tensor::{NumpyArray, Tensor};

/// A native object: any value of Python's built-in types, NumPy arrays, and tagged plug-in
/// objects (paper section 3.3, `docs/reference/wire/native-object.md`).
///
/// Containers nest up to [`crate::Limits::depth`].
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::types; }
/// use wrapyfi_core::types::{Map, Value};
/// let value = Value::from(Map::from([("speed", 1.5)]));
/// assert_eq!(value.get("speed").and_then(Value::as_f64), Some(1.5));
/// ```
#[derive(Debug, Clone, PartialEq, Default)]
#[non_exhaustive]
pub enum Value {
    /// `None`.
    #[default]
    Null,
    /// `True` or `False`.
    Bool(bool),
    /// An integer that fits 64 bits signed.
    Int(i64),
    /// An integer beyond [`Value::Int`]'s range, exactly.
    BigInt(BigInt),
    /// A float; NaN and the infinities included.
    Float(f64),
    /// Text.
    Str(String),
    /// Text that is not valid Unicode (Python strings may hold lone surrogates), as UTF-16 code
    /// units, so that it travels on unchanged.
    Utf16(Vec<u16>),
    /// Raw bytes. Wrapyfi's JSON has no form for them: encoding to it fails and says so.
    Bytes(Bytes),
    /// `list`.
    List(Vec<Value>),
    /// `tuple`.
    Tuple(Vec<Value>),
    /// `set`; order carries no meaning.
    Set(Vec<Value>),
    /// `dict`, in insertion order, keys unique.
    Map(Map),
    /// `datetime.datetime`, naive or with an offset from UTC.
    DateTime(DateTime),
    /// `numpy.datetime64` scalar as ISO 8601 text; the digits imply the unit. `NaT` is allowed.
    DateTime64(String),
    /// An array of numbers.
    Tensor(Tensor),
    /// An array whose elements are not plain numbers (structured, text, `datetime64`, `longdouble`).
    Array(NumpyArray),
    /// A data frame, a series, an index or Arrow data (pandas, dask, PyArrow).
    Table(Box<Table>),
    /// A Pillow image.
    Picture(Box<Picture>),
    /// A number with its unit (pint).
    Quantity(Box<Quantity>),
    /// An array with named dimensions and coordinates, or a set of them (xarray).
    Labelled(Box<Labelled>),
    /// An object of a plug-in outside this crate.
    Object(ForeignObject),
    /// An object that no plug-in here reads, carried intact.
    Tagged(Tagged),
}

/// An object behind a plug-in key that is not decoded here (`{"__wrapyfi__": [key, ...]}`).
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::{Limits, codec, plugin, types}; }
/// use wrapyfi_core::Limits;
/// use wrapyfi_core::codec::json;
/// use wrapyfi_core::plugin::Plugins;
/// use wrapyfi_core::types::{Tagged, Value};
/// let text = r#"{"__wrapyfi__": ["MyPose", 1.0, 2.0]}"#;
/// let value = json::decode(&text.into(), &Limits::default(), &Plugins::none())?;
/// assert_eq!(value, Value::from(Tagged::new("MyPose", text)));
/// assert_eq!(json::encode(&value, &Plugins::none()).as_deref(), Ok(text.as_bytes()));
/// # Ok::<(), wrapyfi_data::DecodeError>(())
/// ```
#[derive(Debug, Clone, Eq)]
pub struct Tagged {
    /// The plug-in key, for instance `PytorchTensor`.
    pub key: String,
    /// JSON text of the whole tagged object, byte for byte as received.
    pub json: Bytes,
    /// Reason that the object was not decoded although its plug-in is known here, with path and
    /// limit; `None` for an unknown plug-in. It is no part of the object: two equal ones may differ
    /// in it.
    pub refused: Option<String>,
}

impl Tagged {
    /// An object of an unknown plug-in.
    pub fn new(key: impl Into<String>, json: impl Into<Bytes>) -> Self {
        Self { key: key.into(), json: json.into(), refused: None }
    }
}

impl PartialEq for Tagged {
    fn eq(&self, other: &Self) -> bool {
        (&self.key, &self.json) == (&other.key, &other.json)
    }
}

/// Methods that lend what a value of one kind holds.
macro_rules! lent {
    ($($(#[$doc:meta])* $name:ident -> $content:ty: $kind:ident;)*) => {$(
        $(#[$doc])*
        #[must_use]
        pub fn $name(&self) -> Option<$content> {
            if let Self::$kind(content) = self { Some(content) } else { None }
        }
    )*};
}

impl Value {
    /// Name of the Python type, for messages: `list`, `numpy.ndarray`, …
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Null => "None",
            Self::Bool(_) => "bool",
            Self::Int(_) | Self::BigInt(_) => "int",
            Self::Float(_) => "float",
            Self::Str(_) | Self::Utf16(_) => "str",
            Self::Bytes(_) => "bytes",
            Self::List(_) => "list",
            Self::Tuple(_) => "tuple",
            Self::Set(_) => "set",
            Self::Map(_) => "dict",
            Self::DateTime(_) => "datetime",
            Self::DateTime64(_) => "numpy.datetime64",
            Self::Tensor(_) | Self::Array(_) => "numpy.ndarray",
            Self::Table(_) => "table",
            Self::Picture(_) => "picture",
            Self::Quantity(_) => "quantity",
            Self::Labelled(_) => "labelled array",
            Self::Object(_) | Self::Tagged(_) => "plug-in object",
        }
    }

    /// True for what Python can put into a set or use as a key.
    pub fn is_hashable(&self) -> bool {
        match self {
            Self::List(_)
            | Self::Set(_)
            | Self::Map(_)
            | Self::Tensor(_)
            | Self::Array(_)
            | Self::Table(_)
            | Self::Picture(_)
            | Self::Labelled(_)
            | Self::Object(_) => false,
            Self::Tuple(items) => items.iter().all(Self::is_hashable),
            _ => true,
        }
    }

    /// The value under a text key of a `dict`.
    pub fn get(&self, key: &str) -> Option<&Self> {
        self.as_map()?.get(key)
    }

    /// A `bool`.
    pub fn as_bool(&self) -> Option<bool> {
        if let Self::Bool(value) = self { Some(*value) } else { None }
    }

    /// An integer that fits 64 bits.
    pub fn as_i64(&self) -> Option<i64> {
        if let Self::Int(value) = self { Some(*value) } else { None }
    }

    /// A float, or an integer rounded to one.
    // As Python's float() does.
    pub fn as_f64(&self) -> Option<f64> {
        match self {
            Self::Float(value) => Some(*value),
            Self::Int(value) => Some(*value as f64),
            _ => None,
        }
    }

    lent! {
        /// Text that is valid Unicode.
        as_str -> &str: Str;
        /// A `dict`.
        as_map -> &Map: Map;
        /// An array of numbers.
        as_tensor -> &Tensor: Tensor;
        /// A table.
        as_table -> &Table: Table;
        /// A Pillow image.
        as_picture -> &Picture: Picture;
        /// A number with its unit.
        as_quantity -> &Quantity: Quantity;
        /// A labelled array or data set.
        as_labelled -> &Labelled: Labelled;
    }

    /// Members of a `list`, `tuple` or `set`.
    pub fn as_items(&self) -> Option<&[Self]> {
        match self {
            Self::List(items) | Self::Tuple(items) | Self::Set(items) => Some(items),
            _ => None,
        }
    }

    /// The object of a plug-in outside this crate, when it is a `T`.
    pub fn as_object<T: PluginObject>(&self) -> Option<&T> {
        if let Self::Object(object) = self { object.get() } else { None }
    }

    /// Key of the plug-in that writes it on Wrapyfi's wire; `None` for what needs none.
    pub fn plugin_key(&self) -> Option<&str> {
        match self {
            Self::Tensor(tensor) => tensor.framework(),
            Self::Table(table) => Some(table.key()),
            Self::Picture(_) => Some("PILImage"),
            Self::Quantity(_) => Some("PintData"),
            Self::Labelled(_) => Some("XArrayData"),
            Self::Object(object) => Some(object.key()),
            Self::Tagged(tagged) => Some(&tagged.key),
            _ => None,
        }
    }

    /// The objects inside that a plug-in refused, with the reason each.
    pub fn refusals(&self) -> impl Iterator<Item = (&Tagged, &str)> {
        let mut waiting = vec![self];
        std::iter::from_fn(move || {
            while let Some(value) = waiting.pop() {
                match value {
                    Self::List(items) | Self::Tuple(items) | Self::Set(items) => {
                        waiting.extend(items.iter().rev());
                    }
                    Self::Map(map) => waiting.extend(map.iter().rev().map(|(_, member)| member)),
                    Self::Tagged(tagged) => {
                        if let Some(reason) = &tagged.refused {
                            return Some((tagged, reason.as_str()));
                        }
                    }
                    _ => {}
                }
            }
            None
        })
    }

    /// About how many bytes of content it holds: array bytes, text and eight for every other
    /// value. For choosing buffer sizes.
    pub fn size_hint(&self) -> usize {
        let items = |items: &[Self]| items.iter().map(Self::size_hint).sum::<usize>();
        8 + match self {
            Self::Str(text) | Self::DateTime64(text) => text.len(),
            Self::Utf16(units) => units.len() * 2,
            Self::Bytes(bytes) => bytes.len(),
            Self::List(members) | Self::Tuple(members) | Self::Set(members) => items(members),
            Self::Map(map) => map.iter().map(|(key, v)| key.size_hint() + v.size_hint()).sum(),
            Self::Tensor(tensor) => tensor.data.len(),
            Self::Array(array) => array.data.len(),
            Self::Tagged(tagged) => tagged.json.len(),
            Self::Table(table) => table.memory_bytes(),
            Self::Picture(picture) => match &picture.image.pixels {
                Pixels::Raw(raw) => raw.data.len(),
                Pixels::Compressed { data, .. } => data.len(),
            },
            Self::Labelled(labelled) => labelled.size_hint(),
            _ => 0,
        }
    }
}

macro_rules! from {
    ($($source:ty => |$value:ident| $target:expr,)*) => {$(
        impl From<$source> for Value {
            fn from($value: $source) -> Self {
                $target
            }
        }
    )*};
}

from! {
    () => |_nothing| Self::Null,
    bool => |value| Self::Bool(value),
    i8 => |value| Self::Int(value.into()),
    i16 => |value| Self::Int(value.into()),
    i32 => |value| Self::Int(value.into()),
    i64 => |value| Self::Int(value),
    u8 => |value| Self::Int(value.into()),
    u16 => |value| Self::Int(value.into()),
    u32 => |value| Self::Int(value.into()),
    u64 => |value| i64::try_from(value).map_or_else(|_| Self::BigInt(value.into()), Self::Int),
    BigInt => |value| i64::try_from(&value).map_or_else(|_| Self::BigInt(value), Self::Int),
    f32 => |value| Self::Float(value.into()),
    f64 => |value| Self::Float(value),
    &str => |value| Self::Str(value.into()),
    String => |value| Self::Str(value),
    Bytes => |value| Self::Bytes(value),
    Vec<Self> => |items| Self::List(items),
    Map => |map| Self::Map(map),
    DateTime => |value| Self::DateTime(value),
    Tensor => |tensor| Self::Tensor(tensor),
    NumpyArray => |array| Self::Array(array),
    Tagged => |tagged| Self::Tagged(tagged),
    Table => |table| Self::Table(Box::new(table)),
    Picture => |picture| Self::Picture(Box::new(picture)),
    Quantity => |quantity| Self::Quantity(Box::new(quantity)),
    Labelled => |labelled| Self::Labelled(Box::new(labelled)),
    ForeignObject => |object| Self::Object(object),
}

impl<T: Into<Self>> From<Option<T>> for Value {
    fn from(value: Option<T>) -> Self {
        value.map_or(Self::Null, Into::into)
    }
}

impl<T: Into<Self>> FromIterator<T> for Value {
    /// A `list`.
    fn from_iter<I: IntoIterator<Item = T>>(items: I) -> Self {
        Self::List(items.into_iter().map(Into::into).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integers_take_the_smallest_form() {
        assert_eq!(Value::from(u64::MAX), Value::BigInt(BigInt::from(u64::MAX)));
        assert_eq!(Value::from(BigInt::from(-5)), Value::Int(-5));
        assert_eq!(Value::from(7_u64).as_f64(), Some(7.0));
    }

    #[test]
    fn a_tuple_is_hashable_when_its_members_are() {
        assert!(Value::Tuple(vec![1.into(), "a".into()]).is_hashable());
        assert!(!Value::Tuple(vec![Value::List(vec![])]).is_hashable());
    }
}
