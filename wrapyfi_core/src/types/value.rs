//! Wrapyfi's native object: what a Python script may return from a registered method.

use bytes::Bytes;
use chrono::{FixedOffset, NaiveDateTime};
use num_bigint::BigInt;

use super::tensor::{NumpyArray, Tensor};

/// A native object: any value of Python's built-in types, NumPy arrays, and tagged plug-in
/// objects (paper section 3.3, `docs/wire/native-object.md`).
///
/// Containers nest up to [`crate::Limits::depth`].
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Value {
    /// `None`.
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
    /// An object of a plug-in this process does not know, carried intact.
    Tagged(Tagged),
}

/// `datetime.datetime` to the microsecond.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DateTime {
    /// Wall time where the offset holds.
    pub local: NaiveDateTime,
    /// Offset from UTC; `None` for a naive value.
    pub offset: Option<FixedOffset>,
}

/// An object behind a plug-in key that is not decoded here (`{"__wrapyfi__": [key, ...]}`).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Tagged {
    /// The plug-in key, for instance `PytorchTensor`.
    pub key: String,
    /// JSON text of the whole tagged object, byte for byte as received.
    pub json: Bytes,
}

/// `dict`: pairs in insertion order with unique keys.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Map(pub(crate) Vec<(Value, Value)>);
