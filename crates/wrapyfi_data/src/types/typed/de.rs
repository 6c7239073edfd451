//! `Deserialize` from [`Value`].

use num_bigint::BigInt;
use serde::de::value::{MapAccessDeserializer, StringDeserializer};
use serde::de::{Deserializer, Visitor};
use serde::forward_to_deserialize_any;

use super::de_access::{Elements, Pairs};
use super::{TypedError, exact};
use crate::types::{Dtype, Tensor, Value, nested_list};

/// Gives a value to whatever is deserialised.
pub(super) struct FromValue {
    pub(super) value: Value,
    /// True for the key of a dict, in which text may stand for a number.
    pub(super) key: bool,
}

impl FromValue {
    fn unfit(&self, wanted: &str) -> TypedError {
        TypedError::new(format!("{} where {wanted} should be", self.value.kind()))
    }

    /// A key such as `"1"` as the number it stands for, where a number is asked for: JSON, and so
    /// Python's `json`, has text keys only.
    fn number_of_key(self) -> Self {
        let Self { value: Value::Str(text), key: true } = &self else { return self };
        let number = match text.as_str() {
            "true" => Some(Value::Bool(true)),
            "false" => Some(Value::Bool(false)),
            text => match text.parse::<BigInt>() {
                Ok(integer) => Some(integer.into()),
                Err(_no_integer) => text.parse().ok().map(Value::Float),
            },
        };
        match number {
            Some(value) => Self { value, key: false },
            None => self,
        }
    }
}

fn visit_big<'de, V: Visitor<'de>>(value: &BigInt, visitor: V) -> Result<V::Value, TypedError> {
    if let Ok(value) = u64::try_from(value) {
        return visitor.visit_u64(value);
    }
    if let Ok(value) = i128::try_from(value) {
        return visitor.visit_i128(value);
    }
    match u128::try_from(value) {
        Ok(value) => visitor.visit_u128(value),
        Err(_wide) => Err(TypedError::new(format!(
            "an integer of {} bits where at most 128 fit; use types::Value as the field's type",
            value.bits()
        ))),
    }
}

/// NumPy's scalars are 0-d arrays on the wire.
fn visit_scalar<'de, V: Visitor<'de>>(tensor: &Tensor, visitor: V) -> Result<V::Value, TypedError> {
    match tensor.dtype() {
        // A complex number is the pair that num-complex deserialises from.
        Dtype::C64 => visitor.visit_seq(Elements::parts_of_complex(tensor, Dtype::F32)),
        Dtype::C128 => visitor.visit_seq(Elements::parts_of_complex(tensor, Dtype::F64)),
        dtype => {
            let value = nested_list(tensor)
                .ok_or_else(|| TypedError::new(format!("an array of {dtype} without elements")))?;
            FromValue { value, key: false }.deserialize_any(visitor)
        }
    }
}

macro_rules! numbers {
    ($($method:ident)*) => {$(
        fn $method<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, TypedError> {
            self.number_of_key().deserialize_any(visitor)
        }
    )*};
}

impl<'de> Deserializer<'de> for FromValue {
    type Error = TypedError;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, TypedError> {
        match self.value {
            Value::Null => visitor.visit_unit(),
            Value::Bool(value) => visitor.visit_bool(value),
            Value::Int(value) => visitor.visit_i64(value),
            Value::BigInt(value) => visit_big(&value, visitor),
            Value::Float(value) => visitor.visit_f64(value),
            Value::Str(text) | Value::DateTime64(text) => visitor.visit_string(text),
            Value::DateTime(when) => visitor.visit_string(when.to_string()),
            Value::Bytes(bytes) => visitor.visit_byte_buf(bytes.into()),
            Value::List(items) | Value::Tuple(items) | Value::Set(items) => {
                visitor.visit_seq(Elements::of_items(items))
            }
            Value::Map(map) => visitor.visit_map(Pairs::new(map)),
            Value::Tensor(tensor) if tensor.shape().is_empty() => visit_scalar(&tensor, visitor),
            Value::Tensor(tensor) => visitor.visit_seq(Elements::of_tensor(tensor)),
            Value::Quantity(_)
            | Value::Table(_)
            | Value::Picture(_)
            | Value::Labelled(_)
            | Value::Object(_)
            | Value::Tagged(_)
            | Value::Array(_)
            | Value::Utf16(_) => {
                Err(self.unfit("a plain value; use types::Value as the field's type"))
            }
        }
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, TypedError> {
        match self.value {
            Value::Null => visitor.visit_none(),
            _ => visitor.visit_some(self),
        }
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        name: &'static str,
        visitor: V,
    ) -> Result<V::Value, TypedError> {
        if name == exact::NAME {
            return exact::lend(self.value, || {
                visitor.visit_newtype_struct(Self { value: Value::Null, key: false })
            });
        }
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _name: &'static str,
        _variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, TypedError> {
        match self.value {
            Value::Str(variant) => visitor.visit_enum(StringDeserializer::new(variant)),
            Value::Map(map) if map.len() == 1 => {
                visitor.visit_enum(MapAccessDeserializer::new(Pairs::new(map)))
            }
            Value::Map(map) => Err(TypedError::new(format!(
                "a dict of {} members where one should be: {{variant: content}}",
                map.len()
            ))),
            _ => Err(self.unfit("the name of a variant, or a dict {variant: content},")),
        }
    }

    fn deserialize_bytes<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, TypedError> {
        match self.value {
            Value::Tensor(tensor) if tensor.dtype() == Dtype::U8 => {
                visitor.visit_bytes(tensor.data())
            }
            _ => self.deserialize_any(visitor),
        }
    }

    fn deserialize_byte_buf<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, TypedError> {
        self.deserialize_bytes(visitor)
    }

    fn deserialize_ignored_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, TypedError> {
        visitor.visit_unit()
    }

    numbers! {
        deserialize_bool deserialize_i8 deserialize_i16 deserialize_i32 deserialize_i64
        deserialize_i128 deserialize_u8 deserialize_u16 deserialize_u32 deserialize_u64
        deserialize_u128 deserialize_f32 deserialize_f64
    }

    forward_to_deserialize_any! {
        char str string unit unit_struct seq tuple tuple_struct map struct identifier
    }
}
