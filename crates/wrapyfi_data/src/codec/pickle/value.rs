//! Plain data in a pickle as a native object.

use super::super::DecodeError;
use super::items::{Items, Pairs};
use super::node::{Node, View};
use super::numpy::PickledArray;
use crate::Limits;
use crate::types::{Map, Value, unique_members};

type Result<T> = std::result::Result<T, DecodeError>;

impl Node<'_> {
    /// The object as a value: what Python's own types, dates and NumPy arrays can say. An object
    /// that is used twice is copied, so nesting and memory are limited.
    ///
    /// # Errors
    /// When something inside has no such form, or a limit is exceeded.
    pub fn to_value(&self, limits: &Limits) -> Result<Value> {
        let limit = limits.message_bytes.saturating_mul(4).max(64 << 10);
        Conversion { left: limit, limit, depth: limits.depth }.value(self, 0)
    }
}

struct Conversion {
    /// Memory that may still be taken.
    left: usize,
    limit: usize,
    depth: usize,
}

impl Conversion {
    fn charge(&mut self, node: &Node<'_>, bytes: usize) -> Result<()> {
        if let Some(left) = self.left.checked_sub(bytes) {
            self.left = left;
            return Ok(());
        }
        Err(DecodeError::TooLarge {
            what: "memory of the object",
            path: node.path(),
            actual: (self.limit - self.left).saturating_add(bytes) as u64,
            limit: self.limit as u64,
        })
    }

    fn value(&mut self, node: &Node<'_>, depth: usize) -> Result<Value> {
        if depth > self.depth {
            return Err(DecodeError::TooLarge {
                what: "nesting",
                path: node.path(),
                actual: depth as u64,
                limit: self.depth as u64,
            });
        }
        self.charge(node, size_of::<Value>())?;
        Ok(match node.view() {
            View::None => Value::Null,
            View::Bool(value) => Value::Bool(value),
            View::Int(value) => Value::Int(value),
            View::BigInt(value) => {
                self.charge(node, usize::try_from(value.bits() / 8).unwrap_or(usize::MAX))?;
                Value::BigInt(value.clone())
            }
            View::Float(value) => Value::Float(value),
            View::Str(text) => {
                self.charge(node, text.len())?;
                Value::Str(text.to_owned())
            }
            View::Utf16(units) => {
                self.charge(node, size_of_val(units))?;
                Value::Utf16(units.to_vec())
            }
            View::Bytes(_) | View::ByteArray(_) | View::Buffer { .. } => {
                Value::Bytes(node.bytes()?)
            }
            View::List(items) => Value::List(self.items(items, depth)?),
            View::Tuple(items) => Value::Tuple(self.items(items, depth)?),
            View::Set(items) | View::FrozenSet(items) => {
                let members = self.items(items, depth)?;
                if !members.iter().all(Value::is_hashable) {
                    return Err(node.unexpected("a set of what Python can hash").into());
                }
                Value::Set(unique_members(members))
            }
            View::Dict(pairs) => Value::Map(self.map(pairs, depth)?),
            View::Call(call) if call.global().is("collections.OrderedDict") => {
                if !call.args().is_empty() {
                    return Err(node
                        .unexpected("an OrderedDict whose pairs are set one by one")
                        .into());
                }
                Value::Map(self.map(call.pairs(), depth)?)
            }
            View::Call(call) if call.global().is("datetime.datetime") => {
                Value::DateTime(node.datetime()?)
            }
            View::Call(_) if node.is_array() => match node.array()? {
                PickledArray::Tensor(tensor) => {
                    // It may be a copy, because of its order.
                    self.charge(node, tensor.data.len())?;
                    Value::Tensor(tensor)
                }
                PickledArray::Array(array) => {
                    self.charge(node, array.data.len() + array.descr.len())?;
                    Value::Array(array)
                }
                PickledArray::Objects { .. } => {
                    return Err(node.unexpected("an array of elements with a size").into());
                }
            },
            _ => return Err(node.unexpected("plain data").into()),
        })
    }

    fn items(&mut self, items: Items<'_>, depth: usize) -> Result<Vec<Value>> {
        items.iter().map(|item| self.value(&item, depth + 1)).collect()
    }

    fn map(&mut self, pairs: Pairs<'_>, depth: usize) -> Result<Map> {
        let mut values = Vec::new();
        for (key, value) in pairs.iter() {
            let key_value = self.value(&key, depth + 1)?;
            if !key_value.is_hashable() {
                return Err(key.unexpected("a key that Python can hash").into());
            }
            values.push((key_value, self.value(&value, depth + 1)?));
        }
        Ok(values.into_iter().collect())
    }
}
