//! [`Value`] and its parts as fields of a Rust type.
//!
//! Through [`super::to_value`] and [`super::from_value`] they pass as they are. In any other format
//! (`serde_json`, …) plain values take the format's own forms, and an array is a struct of
//! `dtype`, `shape`, `device` and `data`; what has no such form is an error.

use std::fmt;

use num_bigint::BigInt;
use serde::de::value::SeqAccessDeserializer;
use serde::de::{Deserialize, Deserializer, Error as _, MapAccess, SeqAccess, Visitor};
use serde::ser::{Error as _, Serialize, SerializeStruct, Serializer};

use super::exact;
use crate::types::{DateTime, Map, Tensor, Value};

/// A value on its way into a serializer that may be ours.
struct Content<'a>(&'a Value);

impl Serialize for Value {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_newtype_struct(exact::NAME, &Content(self))
    }
}

impl Serialize for Content<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        if exact::offer(|| self.0.clone()) {
            return serializer.serialize_unit();
        }
        match self.0 {
            Value::Null => serializer.serialize_unit(),
            Value::Bool(value) => serializer.serialize_bool(*value),
            Value::Int(value) => serializer.serialize_i64(*value),
            Value::BigInt(value) => match (u64::try_from(value), i128::try_from(value)) {
                (Ok(value), _) => serializer.serialize_u64(value),
                (_, Ok(value)) => serializer.serialize_i128(value),
                _ => serializer.serialize_str(&value.to_string()),
            },
            Value::Float(value) => serializer.serialize_f64(*value),
            Value::Str(text) | Value::DateTime64(text) => serializer.serialize_str(text),
            Value::DateTime(when) => serializer.collect_str(when),
            Value::Bytes(bytes) => serializer.serialize_bytes(bytes),
            Value::List(items) | Value::Tuple(items) | Value::Set(items) => {
                serializer.collect_seq(items)
            }
            Value::Map(map) => serializer.collect_map(map.iter()),
            Value::Tensor(tensor) => {
                let mut fields = serializer.serialize_struct("Tensor", 4)?;
                fields.serialize_field("dtype", tensor.dtype().name())?;
                fields.serialize_field("shape", tensor.shape())?;
                fields.serialize_field("device", tensor.device())?;
                fields.serialize_field("data", &**tensor.data())?;
                fields.end()
            }
            other => Err(S::Error::custom(format!(
                "a {} has no form but a native object's; use to_value",
                other.kind()
            ))),
        }
    }
}

impl<'de> Deserialize<'de> for Value {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_newtype_struct(exact::NAME, ValueVisitor)
    }
}

struct ValueVisitor;

/// Methods of plain values, some of which become a value through another type.
macro_rules! plain {
    ($($method:ident($kind:ty $(as $through:ty)?))*) => {$(
        fn $method<E>(self, value: $kind) -> Result<Value, E> {
            Ok($(<$through>::from)?(value).into())
        }
    )*};
}

impl<'de> Visitor<'de> for ValueVisitor {
    type Value = Value;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a native object")
    }

    fn visit_newtype_struct<D: Deserializer<'de>>(self, inner: D) -> Result<Value, D::Error> {
        match exact::take() {
            Some(value) => Ok(value),
            None => inner.deserialize_any(self),
        }
    }

    fn visit_unit<E>(self) -> Result<Value, E> {
        Ok(Value::Null)
    }

    fn visit_none<E>(self) -> Result<Value, E> {
        Ok(Value::Null)
    }

    fn visit_some<D: Deserializer<'de>>(self, inner: D) -> Result<Value, D::Error> {
        Value::deserialize(inner)
    }

    plain! {
        visit_bool(bool) visit_i64(i64) visit_u64(u64) visit_i128(i128 as BigInt)
        visit_u128(u128 as BigInt) visit_f64(f64) visit_str(&str) visit_string(String)
    }

    fn visit_bytes<E>(self, bytes: &[u8]) -> Result<Value, E> {
        Ok(bytes::Bytes::copy_from_slice(bytes).into())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, members: A) -> Result<Value, A::Error> {
        Vec::deserialize(SeqAccessDeserializer::new(members)).map(Value::List)
    }

    fn visit_map<A: MapAccess<'de>>(self, mut members: A) -> Result<Value, A::Error> {
        let mut pairs = Vec::<(Value, Value)>::new();
        while let Some(pair) = members.next_entry()? {
            pairs.push(pair);
        }
        Ok(Map::from_iter(pairs).into())
    }
}

/// Reads a [`Value`] and takes one kind of it.
fn one_kind<'de, T, D: Deserializer<'de>>(
    deserializer: D,
    wanted: &str,
    take: impl FnOnce(Value) -> Result<T, Value>,
) -> Result<T, D::Error> {
    take(Value::deserialize(deserializer)?)
        .map_err(|other| D::Error::custom(format!("{} where {wanted} should be", other.kind())))
}

macro_rules! serialize_as_value {
    ($($part:ident),*) => {$(
        impl Serialize for $part {
            fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                Value::from(self.clone()).serialize(serializer)
            }
        }
    )*};
}

serialize_as_value!(Tensor, Map, DateTime);

impl<'de> Deserialize<'de> for Tensor {
    /// Reads an array of a native object. No other format has arrays; their structs are not read
    /// back.
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        one_kind(deserializer, "an array of numbers", |value| match value {
            Value::Tensor(tensor) => Ok(tensor),
            other => Err(other),
        })
    }
}

impl<'de> Deserialize<'de> for Map {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        one_kind(deserializer, "a dict", |value| match value {
            Value::Map(map) => Ok(map),
            other => Err(other),
        })
    }
}

impl<'de> Deserialize<'de> for DateTime {
    /// A `datetime`, or text as Python's `isoformat` writes it.
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        one_kind(deserializer, "a datetime", |value| match value {
            Value::DateTime(when) => Ok(when),
            Value::Str(text) => text.parse().map_err(|_no_date| Value::Str(text)),
            other => Err(other),
        })
    }
}

/// For fields that are `ndarray` arrays: `#[serde(with = "wrapyfi_data::types::as_tensor")]` makes
/// them arrays on the wire instead of nested lists.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::types; }
/// use ndarray::{Array2, arr2};
/// use serde::{Deserialize, Serialize};
/// use wrapyfi_core::types::{from_value, to_value};
///
/// #[derive(Debug, PartialEq, Serialize, Deserialize)]
/// struct Pose {
///     #[serde(with = "wrapyfi_core::types::as_tensor")]
///     rotation: Array2<f64>,
/// }
///
/// let pose = Pose { rotation: arr2(&[[0.0, -1.0], [1.0, 0.0]]) };
/// let value = to_value(&pose)?;
/// assert_eq!(value.get("rotation").unwrap().as_tensor().unwrap().shape(), [2, 2]);
/// assert_eq!(from_value::<Pose>(value)?, pose);
/// # Ok::<(), wrapyfi_data::types::TypedError>(())
/// ```
#[cfg(feature = "ndarray")]
pub mod as_tensor {
    use ndarray::{Array, ArrayBase, Data, Dimension};

    use super::{Deserialize, Deserializer, Serialize, Serializer, Tensor};
    use crate::types::Element;

    /// Writes an array as a tensor.
    ///
    /// # Errors
    /// When the format has no arrays.
    pub fn serialize<T, D, C, S>(array: &ArrayBase<C, D>, serializer: S) -> Result<S::Ok, S::Error>
    where
        T: Element,
        D: Dimension,
        C: Data<Elem = T>,
        S: Serializer,
    {
        Tensor::from_ndarray(array).serialize(serializer)
    }

    /// Reads an array of exactly this element type and number of dimensions.
    ///
    /// # Errors
    /// When it is another one.
    pub fn deserialize<'de, T, D, R>(deserializer: R) -> Result<Array<T, D>, R::Error>
    where
        T: Element,
        D: Dimension,
        R: Deserializer<'de>,
    {
        use serde::de::Error as _;
        let tensor = Tensor::deserialize(deserializer)?;
        let array = tensor.to_ndarray::<T>().ok_or_else(|| {
            R::Error::custom(format!("an array of {} where {} should be", tensor.dtype(), T::DTYPE))
        })?;
        array.into_dimensionality().map_err(|_count| {
            let wanted = D::NDIM.map_or_else(|| "another number of".into(), |n| n.to_string());
            let shape = tensor.shape();
            R::Error::custom(format!(
                "an array of shape {shape:?} where {wanted} dimensions should be"
            ))
        })
    }
}
