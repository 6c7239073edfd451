//! Sequences, maps and variants on their way out of a [`Value`].

use bytes::Bytes;
use serde::de::{
    DeserializeSeed, Deserializer, EnumAccess, MapAccess, SeqAccess, VariantAccess, Visitor,
};

use super::TypedError;
use super::de::FromValue;
use crate::types::{Dtype, Map, Tensor, Value};

fn plain(value: Value) -> FromValue {
    FromValue { value, key: false }
}

/// Members of a list, or the slices of an array along its first axis.
pub(super) struct Elements {
    source: Source,
    next: usize,
}

enum Source {
    Items(std::vec::IntoIter<Value>),
    Slices { dtype: Dtype, shape: Vec<usize>, count: usize, size: usize, data: Bytes },
}

impl Elements {
    pub(super) fn of_items(items: Vec<Value>) -> Self {
        Self { source: Source::Items(items.into_iter()), next: 0 }
    }

    pub(super) fn of_tensor(tensor: Tensor) -> Self {
        let count = tensor.shape().first().copied().unwrap_or_default();
        let shape = tensor.shape().get(1..).unwrap_or_default().to_vec();
        let size = tensor.data().len().checked_div(count).unwrap_or_default();
        let (dtype, data) = (tensor.dtype(), tensor.data);
        Self { source: Source::Slices { dtype, shape, count, size, data }, next: 0 }
    }

    /// Real and imaginary part of a single complex number.
    pub(super) fn parts_of_complex(tensor: &Tensor, part: Dtype) -> Self {
        let (data, size) = (tensor.data.clone(), part.size());
        let source = Source::Slices { dtype: part, shape: Vec::new(), count: 2, size, data };
        Self { source, next: 0 }
    }
}

impl<'de> SeqAccess<'de> for Elements {
    type Error = TypedError;

    fn next_element_seed<T: DeserializeSeed<'de>>(
        &mut self,
        seed: T,
    ) -> Result<Option<T::Value>, TypedError> {
        let index = self.next;
        let element = match &mut self.source {
            Source::Items(items) => items.next(),
            Source::Slices { dtype, shape, count, size, data } => {
                let range = index * *size..(index + 1) * *size;
                (index < *count)
                    .then(|| Tensor::new(*dtype, shape.clone(), data.slice(range)))
                    .transpose()
                    .map_err(TypedError::new)?
                    .map(Value::Tensor)
            }
        };
        let Some(element) = element else { return Ok(None) };
        self.next += 1;
        let element = seed.deserialize(plain(element));
        element.map(Some).map_err(|error| error.below(format_args!("[{index}]")))
    }

    fn size_hint(&self) -> Option<usize> {
        Some(match &self.source {
            Source::Items(items) => items.len(),
            Source::Slices { count, .. } => count - self.next,
        })
    }
}

/// Members of a dict.
pub(super) struct Pairs {
    pairs: <Map as IntoIterator>::IntoIter,
    waiting: Option<(String, Value)>,
}

impl Pairs {
    pub(super) fn new(map: Map) -> Self {
        Self { pairs: map.into_iter(), waiting: None }
    }
}

impl<'de> MapAccess<'de> for Pairs {
    type Error = TypedError;

    fn next_key_seed<K: DeserializeSeed<'de>>(
        &mut self,
        seed: K,
    ) -> Result<Option<K::Value>, TypedError> {
        let Some((key, value)) = self.pairs.next() else { return Ok(None) };
        let shown = match &key {
            Value::Str(key) => format!(".{key}"),
            other => format!("[{other:?}]"),
        };
        self.waiting = Some((shown, value));
        seed.deserialize(FromValue { value: key, key: true }).map(Some)
    }

    fn next_value_seed<V: DeserializeSeed<'de>>(
        &mut self,
        seed: V,
    ) -> Result<V::Value, TypedError> {
        let (key, value) = self.waiting.take().unwrap_or_default();
        seed.deserialize(plain(value)).map_err(|error| error.below(key))
    }

    fn size_hint(&self) -> Option<usize> {
        self.pairs.size_hint().1
    }
}

/// A variant with what it holds.
pub(super) struct EnumContent {
    pub(super) variant: String,
    pub(super) content: Option<Value>,
}

impl<'de> EnumAccess<'de> for EnumContent {
    type Error = TypedError;
    type Variant = Content;

    fn variant_seed<V: DeserializeSeed<'de>>(
        self,
        seed: V,
    ) -> Result<(V::Value, Content), TypedError> {
        let variant = seed.deserialize(plain(Value::Str(self.variant.clone())))?;
        Ok((variant, Content(self)))
    }
}

/// Content of a variant.
pub(super) struct Content(EnumContent);

impl Content {
    fn below(self) -> Result<(FromValue, String), TypedError> {
        let EnumContent { variant, content } = self.0;
        match content {
            Some(content) => Ok((plain(content), format!(".{variant}"))),
            None => Err(TypedError::new(format!(
                "only the name of variant {variant:?} where its content should be as well"
            ))),
        }
    }
}

impl<'de> VariantAccess<'de> for Content {
    type Error = TypedError;

    fn unit_variant(self) -> Result<(), TypedError> {
        match self.0.content {
            None | Some(Value::Null) => Ok(()),
            Some(content) => Err(TypedError::new(format!(
                "{} as content of variant {:?}, which has none",
                content.kind(),
                self.0.variant
            ))),
        }
    }

    fn newtype_variant_seed<T: DeserializeSeed<'de>>(
        self,
        seed: T,
    ) -> Result<T::Value, TypedError> {
        let (content, step) = self.below()?;
        seed.deserialize(content).map_err(|error| error.below(step))
    }

    fn tuple_variant<V: Visitor<'de>>(
        self,
        length: usize,
        visitor: V,
    ) -> Result<V::Value, TypedError> {
        let (content, step) = self.below()?;
        content.deserialize_tuple(length, visitor).map_err(|error| error.below(step))
    }

    fn struct_variant<V: Visitor<'de>>(
        self,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, TypedError> {
        let (content, step) = self.below()?;
        content.deserialize_struct("", fields, visitor).map_err(|error| error.below(step))
    }
}
