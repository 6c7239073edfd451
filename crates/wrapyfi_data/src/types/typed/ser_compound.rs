//! Sequences and maps on their way into a [`Value`].

use serde::Serialize;
use serde::ser::{
    SerializeMap, SerializeSeq, SerializeStruct, SerializeStructVariant, SerializeTuple,
    SerializeTupleStruct, SerializeTupleVariant,
};

use super::TypedError;
use super::ser::{ToValue, variant_of};
use crate::types::{Map, Value};

/// Room made beforehand at most: a length is what a stranger's `Serialize` claims.
const MAX_RESERVED: usize = 4096;

/// A list or a tuple that is being filled.
pub(super) struct Items {
    pub(super) of: ToValue,
    pub(super) items: Vec<Value>,
    pub(super) whole: fn(Vec<Value>) -> Value,
    pub(super) variant: Option<&'static str>,
}

impl Items {
    pub(super) fn new(of: ToValue, length: Option<usize>, whole: fn(Vec<Value>) -> Value) -> Self {
        let items = Vec::with_capacity(length.unwrap_or_default().min(MAX_RESERVED));
        Self { of, items, whole, variant: None }
    }

    fn push<T: Serialize + ?Sized>(&mut self, item: &T) -> Result<(), TypedError> {
        let index = self.items.len();
        let item = item.serialize(self.of).map_err(|error| error.below(format_args!("[{index}]")));
        item.map(|item| self.items.push(item))
    }

    fn finish(self) -> Value {
        in_variant(self.variant, (self.whole)(self.items))
    }
}

/// A dict that is being filled.
pub(super) struct Fields {
    pub(super) of: ToValue,
    pub(super) pairs: Vec<(Value, Value)>,
    pub(super) key: Value,
    pub(super) variant: Option<&'static str>,
}

impl Fields {
    pub(super) fn new(of: ToValue, length: Option<usize>) -> Self {
        let pairs = Vec::with_capacity(length.unwrap_or_default().min(MAX_RESERVED));
        Self { of, pairs, key: Value::Null, variant: None }
    }

    fn push<T: Serialize + ?Sized>(&mut self, key: Value, value: &T) -> Result<(), TypedError> {
        let value = value.serialize(self.of).map_err(|error| match key.as_str() {
            Some(key) => error.below(format_args!(".{key}")),
            None => error.below(format_args!("[{key:?}]")),
        })?;
        self.pairs.push((key, value));
        Ok(())
    }

    fn finish(self) -> Value {
        in_variant(self.variant, Map::from_iter(self.pairs).into())
    }
}

fn in_variant(variant: Option<&'static str>, content: Value) -> Value {
    match variant {
        Some(variant) => variant_of(variant, content),
        None => content,
    }
}

macro_rules! items {
    ($($compound:ident::$push:ident),*) => {$(
        impl $compound for Items {
            type Ok = Value;
            type Error = TypedError;

            fn $push<T: Serialize + ?Sized>(&mut self, item: &T) -> Result<(), TypedError> {
                self.push(item)
            }

            fn end(self) -> Result<Value, TypedError> {
                Ok(self.finish())
            }
        }
    )*};
}

items!(
    SerializeSeq::serialize_element,
    SerializeTuple::serialize_element,
    SerializeTupleStruct::serialize_field,
    SerializeTupleVariant::serialize_field
);

macro_rules! fields {
    ($($compound:ident),*) => {$(
        impl $compound for Fields {
            type Ok = Value;
            type Error = TypedError;

            fn serialize_field<T: Serialize + ?Sized>(
                &mut self,
                key: &'static str,
                value: &T,
            ) -> Result<(), TypedError> {
                self.push(key.into(), value)
            }

            fn end(self) -> Result<Value, TypedError> {
                Ok(self.finish())
            }
        }
    )*};
}

fields!(SerializeStruct, SerializeStructVariant);

impl SerializeMap for Fields {
    type Ok = Value;
    type Error = TypedError;

    fn serialize_key<T: Serialize + ?Sized>(&mut self, key: &T) -> Result<(), TypedError> {
        self.key = key.serialize(self.of)?;
        if self.key.is_hashable() {
            return Ok(());
        }
        Err(TypedError::new(format!(
            "a {} as key of a dict; use text, a number, a bool or a tuple of these",
            self.key.kind()
        )))
    }

    fn serialize_value<T: Serialize + ?Sized>(&mut self, value: &T) -> Result<(), TypedError> {
        let key = std::mem::take(&mut self.key);
        self.push(key, value)
    }

    fn end(self) -> Result<Value, TypedError> {
        Ok(self.finish())
    }
}
