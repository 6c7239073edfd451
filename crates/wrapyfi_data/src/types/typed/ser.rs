//! `Serialize` to [`Value`].

use num_bigint::BigInt;
use serde::Serialize;
use serde::ser::Serializer;

use super::ser_compound::{Fields, Items};
use super::{TypedError, exact};
use crate::types::{Map, Value};

/// Deepest nesting that [`to_value`](super::to_value) follows: Python's decoder raises beyond about three times this.
pub const MAX_DEPTH: usize = 300;

/// Makes a value of whatever is serialised.
#[derive(Debug, Clone, Copy)]
pub(super) struct ToValue {
    pub(super) depth: usize,
}

impl ToValue {
    pub(super) fn deeper(self) -> Result<Self, TypedError> {
        if self.depth >= MAX_DEPTH {
            return Err(TypedError::new(format!("nested deeper than {MAX_DEPTH}; nest it less")));
        }
        Ok(Self { depth: self.depth + 1 })
    }
}

/// `{variant: content}`.
pub(super) fn variant_of(variant: &'static str, content: Value) -> Value {
    Map::from([(variant, content)]).into()
}

/// Methods of plain values, some of which become a value through another type.
macro_rules! plain {
    ($($method:ident($kind:ty $(as $through:ty)?))*) => {$(
        fn $method(self, value: $kind) -> Result<Value, TypedError> {
            Ok($(<$through>::from)?(value).into())
        }
    )*};
}

impl Serializer for ToValue {
    type Ok = Value;
    type Error = TypedError;
    type SerializeSeq = Items;
    type SerializeTuple = Items;
    type SerializeTupleStruct = Items;
    type SerializeTupleVariant = Items;
    type SerializeMap = Fields;
    type SerializeStruct = Fields;
    type SerializeStructVariant = Fields;

    plain! {
        serialize_bool(bool) serialize_i8(i8) serialize_i16(i16) serialize_i32(i32)
        serialize_i64(i64) serialize_i128(i128 as BigInt) serialize_u8(u8) serialize_u16(u16)
        serialize_u32(u32) serialize_u64(u64) serialize_u128(u128 as BigInt) serialize_f32(f32)
        serialize_f64(f64) serialize_char(char as String) serialize_str(&str)
    }

    fn serialize_bytes(self, value: &[u8]) -> Result<Value, TypedError> {
        Ok(bytes::Bytes::copy_from_slice(value).into())
    }

    fn serialize_none(self) -> Result<Value, TypedError> {
        Ok(Value::Null)
    }

    fn serialize_some<T: Serialize + ?Sized>(self, value: &T) -> Result<Value, TypedError> {
        value.serialize(self)
    }

    fn serialize_unit(self) -> Result<Value, TypedError> {
        Ok(Value::Null)
    }

    fn serialize_unit_struct(self, _name: &'static str) -> Result<Value, TypedError> {
        Ok(Value::Null)
    }

    fn serialize_unit_variant(
        self,
        _name: &'static str,
        _index: u32,
        variant: &'static str,
    ) -> Result<Value, TypedError> {
        Ok(variant.into())
    }

    fn serialize_newtype_struct<T: Serialize + ?Sized>(
        self,
        name: &'static str,
        value: &T,
    ) -> Result<Value, TypedError> {
        if name == exact::NAME {
            return exact::ask(|| value.serialize(self));
        }
        value.serialize(self)
    }

    fn serialize_newtype_variant<T: Serialize + ?Sized>(
        self,
        _name: &'static str,
        _index: u32,
        variant: &'static str,
        value: &T,
    ) -> Result<Value, TypedError> {
        let content = value.serialize(self.deeper()?);
        content
            .map(|content| variant_of(variant, content))
            .map_err(|error| error.below(format_args!(".{variant}")))
    }

    fn serialize_seq(self, length: Option<usize>) -> Result<Items, TypedError> {
        Ok(Items::new(self.deeper()?, length, Value::List))
    }

    fn serialize_tuple(self, length: usize) -> Result<Items, TypedError> {
        Ok(Items::new(self.deeper()?, Some(length), Value::Tuple))
    }

    fn serialize_tuple_struct(
        self,
        _name: &'static str,
        length: usize,
    ) -> Result<Items, TypedError> {
        self.serialize_tuple(length)
    }

    fn serialize_tuple_variant(
        self,
        _name: &'static str,
        _index: u32,
        variant: &'static str,
        length: usize,
    ) -> Result<Items, TypedError> {
        Ok(Items { variant: Some(variant), ..self.serialize_tuple(length)? })
    }

    fn serialize_map(self, length: Option<usize>) -> Result<Fields, TypedError> {
        Ok(Fields::new(self.deeper()?, length))
    }

    fn serialize_struct(self, _name: &'static str, length: usize) -> Result<Fields, TypedError> {
        self.serialize_map(Some(length))
    }

    fn serialize_struct_variant(
        self,
        _name: &'static str,
        _index: u32,
        variant: &'static str,
        length: usize,
    ) -> Result<Fields, TypedError> {
        Ok(Fields { variant: Some(variant), ..self.serialize_map(Some(length))? })
    }
}
