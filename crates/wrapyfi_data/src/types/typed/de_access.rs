//! Sequences and maps on their way out of a [`Value`].

use bytes::Bytes;
use serde::de::{DeserializeSeed, MapAccess, SeqAccess};

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

/// Members of a dict, one of which may be a variant with its content.
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
