//! `dict`, with unique keys, and the uniqueness of set members.

use std::collections::HashMap;
use std::hash::{Hash, Hasher};

use super::Value;

/// `dict`: pairs in insertion order with unique keys.
///
/// A key that is given twice keeps its first place and takes its last value, as in Python. Keys are
/// equal when type and content are: unlike in Python, `1`, `1.0` and `True` are three keys.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::types; }
/// use wrapyfi_core::types::{Map, Value};
/// let map = Map::from_iter([("a", 1), ("b", 2), ("a", 3)]);
/// assert_eq!(map.get("a"), Some(&Value::Int(3)));
/// assert_eq!(map.len(), 2);
/// ```
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Map(pub(crate) Vec<(Value, Value)>);

impl Map {
    /// An empty map.
    pub fn new() -> Self {
        Self::default()
    }

    /// Value under the text `key`.
    pub fn get(&self, key: &str) -> Option<&Value> {
        self.iter().find(|(k, _)| k.as_str() == Some(key)).map(|(_, value)| value)
    }

    /// Sets the value of `key`, and returns its value before. It compares every key: to set many,
    /// collect from pairs.
    pub fn insert(&mut self, key: impl Into<Value>, value: impl Into<Value>) -> Option<Value> {
        let (key, value) = (key.into(), value.into());
        match self.0.iter_mut().find(|(k, _)| *k == key) {
            Some((_, old)) => Some(std::mem::replace(old, value)),
            None => {
                self.0.push((key, value));
                None
            }
        }
    }

    /// Pairs in insertion order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (&Value, &Value)> + DoubleEndedIterator {
        self.0.iter().map(|(key, value)| (key, value))
    }

    /// Number of pairs.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// True when there are no pairs.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

impl<K: Into<Value>, V: Into<Value>> FromIterator<(K, V)> for Map {
    fn from_iter<I: IntoIterator<Item = (K, V)>>(pairs: I) -> Self {
        let pairs: Vec<_> = pairs.into_iter().map(|(k, v)| (k.into(), v.into())).collect();
        Self(last_wins(pairs))
    }
}

impl<K: Into<Value>, V: Into<Value>, const N: usize> From<[(K, V); N]> for Map {
    fn from(pairs: [(K, V); N]) -> Self {
        pairs.into_iter().collect()
    }
}

impl IntoIterator for Map {
    type Item = (Value, Value);
    type IntoIter = std::vec::IntoIter<(Value, Value)>;

    fn into_iter(self) -> Self::IntoIter {
        self.0.into_iter()
    }
}

/// Makes the keys of `pairs` unique.
fn last_wins(pairs: Vec<(Value, Value)>) -> Vec<(Value, Value)> {
    let Some(firsts) = first_of_equals(pairs.iter().map(|(key, _)| key)) else {
        return pairs;
    };
    let mut places: Vec<usize> = Vec::with_capacity(pairs.len());
    let mut unique: Vec<(Value, Value)> = Vec::with_capacity(pairs.len());
    for ((key, value), first) in pairs.into_iter().zip(firsts) {
        let place = places.get(first).copied().unwrap_or(unique.len());
        places.push(place);
        match unique.get_mut(place) {
            Some((_, old)) => *old = value,
            None => unique.push((key, value)),
        }
    }
    unique
}

/// Makes `members` unique.
pub(crate) fn unique_members(members: Vec<Value>) -> Vec<Value> {
    let Some(firsts) = first_of_equals(members.iter()) else {
        return members;
    };
    members
        .into_iter()
        .zip(firsts)
        .enumerate()
        .filter_map(|(index, (member, first))| (index == first).then_some(member))
        .collect()
}

/// Number of values up to which comparing all with each other is faster than hashing them.
const SMALL: usize = 8;

/// Index of the first equal value, for each value; `None` when all differ. It takes linear time,
/// because the values come from foreign messages.
fn first_of_equals<'a>(
    values: impl ExactSizeIterator<Item = &'a Value> + Clone,
) -> Option<Vec<usize>> {
    let count = values.len();
    let pair_differs =
        |(index, value)| values.clone().take(index).all(|before| !same(before, value));
    if count <= SMALL && values.clone().enumerate().all(pair_differs) {
        return None;
    }
    let mut seen = HashMap::with_capacity(count);
    let firsts: Vec<usize> = values
        .enumerate()
        .map(|(index, value)| *seen.entry(Hashed(value)).or_insert(index))
        .collect();
    (seen.len() < count).then_some(firsts)
}

/// A value as a key of a hash map. Containers that Python cannot hash all get the same hash.
struct Hashed<'a>(&'a Value);

impl PartialEq for Hashed<'_> {
    fn eq(&self, other: &Self) -> bool {
        same(self.0, other.0)
    }
}

impl Eq for Hashed<'_> {}

/// Equality of Python's containers, in which the same object is equal to itself; Python's JSON
/// reader makes one object of all NaNs. Otherwise each NaN of a set would be compared with all
/// others.
fn same(a: &Value, b: &Value) -> bool {
    match (a, b) {
        (Value::Float(a), Value::Float(b)) => a == b || (a.is_nan() && b.is_nan()),
        (Value::Tuple(a), Value::Tuple(b)) => {
            a.len() == b.len() && a.iter().zip(b).all(|(a, b)| same(a, b))
        }
        _ => a == b,
    }
}

impl Hash for Hashed<'_> {
    fn hash<H: Hasher>(&self, state: &mut H) {
        std::mem::discriminant(self.0).hash(state);
        match self.0 {
            Value::Bool(value) => value.hash(state),
            Value::Int(value) => value.hash(state),
            Value::BigInt(value) => value.hash(state),
            // 0.0 and -0.0 are equal.
            Value::Float(value) if value.is_nan() => f64::NAN.to_bits().hash(state),
            Value::Float(value) => (value + 0.0).to_bits().hash(state),
            Value::Str(value) | Value::DateTime64(value) => value.hash(state),
            Value::Utf16(value) => value.hash(state),
            Value::Bytes(value) => value.hash(state),
            Value::DateTime(value) => value.hash(state),
            Value::Tuple(items) => items.iter().for_each(|item| Hashed(item).hash(state)),
            Value::Tagged(tagged) => tagged.json.hash(state),
            Value::Quantity(quantity) => {
                Hashed(&quantity.magnitude).hash(state);
                quantity.units.hash(state);
            }
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_value_takes_the_first_place() {
        let pairs = [("a", 1), ("b", 2), ("a", 3), ("c", 4), ("b", 5)];
        let collected = Map::from(pairs);
        let mut inserted = Map::new();
        for (key, value) in pairs {
            inserted.insert(key, value);
        }
        assert_eq!(collected, inserted);
        let keys: Vec<_> =
            collected.iter().map(|(k, v)| (k.as_str().unwrap(), v.as_i64().unwrap())).collect();
        assert_eq!(keys, [("a", 3), ("b", 5), ("c", 4)]);
    }

    #[test]
    fn zero_is_zero_and_types_differ() {
        let members =
            vec![0.0.into(), (-0.0).into(), 0.into(), false.into(), Value::Null, 0.into()];
        assert_eq!(unique_members(members), [0.0.into(), 0.into(), false.into(), Value::Null]);
    }
}
