//! Named parameters: the parameters of a ROS 2 node, or the settings of a script.
//!
//! ```text
//!   {"gain": 2.5, "camera": {"rate": 30}}   ◀──▶   gain = 2.5        DOUBLE
//!         Value                                    camera.rate = 30  INTEGER
//! ```

use std::collections::HashMap;

use super::nested::exact_float;
use super::{Dtype, Map, ParameterValue, Tensor, Value};

/// Deepest nesting of groups that is read.
const MAX_DEPTH: usize = 64;
/// Largest number of a text's characters that an error shows.
const SHOWN: usize = 60;

/// Named parameters in order, each name once.
///
/// In changes of a node's parameters, [`ParameterValue::NotSet`] deletes one.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::types; }
/// use wrapyfi_core::types::{Map, ParameterValue, Properties, Value};
/// let nested = Value::from(Map::from([
///     ("gain", Value::from(2.5)),
///     ("camera", Value::from(Map::from([("rate", 30)]))),
/// ]));
/// let properties = Properties::from_value(&nested)?;
/// assert_eq!(properties.get("camera.rate"), Some(&ParameterValue::Integer(30)));
/// let flat = Map::from([("gain", Value::from(2.5)), ("camera.rate", Value::from(30))]);
/// assert_eq!(properties.to_value(), Value::from(flat));
/// # Ok::<(), wrapyfi_data::types::PropertiesError>(())
/// ```
#[derive(Debug, Clone, Default)]
pub struct Properties {
    entries: Vec<(String, ParameterValue)>,
    /// Place of each name.
    places: HashMap<String, usize>,
}

/// Error of reading named parameters from a native object.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::types; }
/// use wrapyfi_core::types::{Map, Properties, Value};
/// let mixed = Value::from(vec![Value::from(1), Value::from("two")]);
/// let error = Properties::from_value(&Map::from([("gains", mixed)]).into()).unwrap_err();
/// assert_eq!(error.to_string(), "parameter \"gains\": a list holds values of one type, and here int and str");
/// ```
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum PropertiesError {
    /// The value is no `dict`.
    #[error("properties are a dict of names and values, not {0}")]
    NoMap(&'static str),
    /// A key of a `dict` is no text, or empty.
    #[error("{path:?}: the name of a parameter is a text that is not empty, not {found}")]
    Key {
        /// Group in which the key stands; empty for the outermost.
        path: String,
        /// Kind of the key, or the empty text.
        found: String,
    },
    /// The value is of a kind that no parameter can have.
    #[error(
        "parameter {name:?} cannot be {found}: a parameter is None, bool, int of 64 bits, float, str, \
         bytes, a list of one of them, or an array with one dimension"
    )]
    Value {
        /// Name of the parameter.
        name: String,
        /// Kind of the value that was given.
        found: String,
    },
    /// A list holds values of several types.
    #[error("parameter {name:?}: a list holds values of one type, and here {first} and {other}")]
    Mixed {
        /// Name of the parameter.
        name: String,
        /// Type of the first member.
        first: &'static str,
        /// Type of the first member that differs.
        other: &'static str,
    },
    /// One name is written in two ways: `{"a": {"b": 1}, "a.b": 2}`.
    #[error("parameter {0:?} is given twice: give it once")]
    Twice(String),
    /// Groups are nested too deep.
    #[error("parameter {0:?}: groups nest deeper than {MAX_DEPTH}")]
    TooDeep(String),
}

impl Properties {
    /// An empty set.
    pub fn new() -> Self {
        Self::default()
    }

    /// Sets the value of a parameter, and returns its value before. A new parameter is last.
    pub fn insert(
        &mut self,
        name: impl Into<String>,
        value: impl Into<ParameterValue>,
    ) -> Option<ParameterValue> {
        let (name, value) = (name.into(), value.into());
        if let Some((_, old)) = self.places.get(&name).and_then(|&at| self.entries.get_mut(at)) {
            return Some(std::mem::replace(old, value));
        }
        self.places.insert(name.clone(), self.entries.len());
        self.entries.push((name, value));
        None
    }

    /// Value of a parameter.
    pub fn get(&self, name: &str) -> Option<&ParameterValue> {
        self.places.get(name).and_then(|&at| self.entries.get(at)).map(|(_, value)| value)
    }

    /// Names and values in order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (&str, &ParameterValue)> {
        self.entries.iter().map(|(name, value)| (name.as_str(), value))
    }

    /// Names in order.
    pub fn names(&self) -> impl ExactSizeIterator<Item = &str> {
        self.entries.iter().map(|(name, _)| name.as_str())
    }

    /// Number of parameters.
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// True when there are no parameters.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// Applies `changes`: sets new values, and deletes parameters without one.
    pub fn apply(&mut self, changes: &Self) {
        for (name, value) in changes.iter() {
            if *value != ParameterValue::NotSet {
                self.insert(name, value.clone());
            }
        }
        if changes.entries.iter().any(|(_, value)| *value == ParameterValue::NotSet) {
            let gone = |name: &str| changes.get(name) == Some(&ParameterValue::NotSet);
            *self = std::mem::take(self).into_iter().filter(|(name, _)| !gone(name)).collect();
        }
    }

    /// Changes that turn these parameters into `newer`: parameters that differ, and those that are
    /// not in `newer`, without a value.
    #[must_use]
    pub fn changes_to(&self, newer: &Self) -> Self {
        let differs = |(name, value): &(&str, &ParameterValue)| self.get(name) != Some(*value);
        let gone = self.names().filter(|name| newer.get(name).is_none());
        newer
            .iter()
            .filter(differs)
            .map(|(name, value)| (name.to_owned(), value.clone()))
            .chain(gone.map(|name| (name.to_owned(), ParameterValue::NotSet)))
            .collect()
    }

    /// Size of the parameters in a message in bytes, about.
    pub fn size(&self) -> usize {
        self.entries.iter().fold(0, |sum: usize, (name, value)| {
            sum.saturating_add(name.len()).saturating_add(value.size())
        })
    }

    /// Converts the parameters to a `dict` of full names: `{"camera.rate": 30}`. Bytes are an array
    /// of `uint8`, which Wrapyfi's JSON can write; a parameter without a value is `None`.
    pub fn to_value(&self) -> Value {
        let pairs = self.entries.iter().map(|(name, value)| (name.clone(), native(value)));
        Value::Map(pairs.collect::<Map>())
    }

    /// Reads the parameters of a `dict`. The keys of a `dict` inside follow the name of their group
    /// and a dot, as in ROS 2's parameter files. A list is one of `bool`, `int`, `float` or `str`;
    /// of `int` and `float` together it is one of `float`. So are arrays with one dimension, of
    /// which `uint8` are bytes. An empty list has no type, and becomes one of `str`.
    ///
    /// # Errors
    /// When the value is no `dict`, or holds a value that no parameter can have.
    pub fn from_value(value: &Value) -> Result<Self, PropertiesError> {
        let Value::Map(map) = value else {
            return Err(PropertiesError::NoMap(value.kind()));
        };
        let mut properties = Self::new();
        properties.read(map, "", 1)?;
        Ok(properties)
    }

    fn read(&mut self, map: &Map, group: &str, depth: usize) -> Result<(), PropertiesError> {
        if depth > MAX_DEPTH {
            let name = group.chars().take(SHOWN).collect();
            return Err(PropertiesError::TooDeep(name));
        }
        for (key, value) in map.iter() {
            let key = match key {
                Value::Str(key) if !key.is_empty() => key,
                Value::Str(_) => return Err(key_error(group, "an empty one")),
                other => return Err(key_error(group, other.kind())),
            };
            let name = if group.is_empty() { key.clone() } else { format!("{group}.{key}") };
            if let Value::Map(inner) = value {
                self.read(inner, &name, depth + 1)?;
                continue;
            }
            let value = parameter(&name, value)?;
            if self.insert(name.clone(), value).is_some() {
                return Err(PropertiesError::Twice(name));
            }
        }
        Ok(())
    }
}

fn key_error(group: &str, found: &str) -> PropertiesError {
    PropertiesError::Key { path: group.to_owned(), found: found.to_owned() }
}

/// Equal when names, values and order are.
impl PartialEq for Properties {
    fn eq(&self, other: &Self) -> bool {
        self.entries == other.entries
    }
}

impl<N: Into<String>, V: Into<ParameterValue>> FromIterator<(N, V)> for Properties {
    /// Collects parameters; the last value of a name that comes twice counts.
    fn from_iter<I: IntoIterator<Item = (N, V)>>(pairs: I) -> Self {
        let mut properties = Self::new();
        properties.extend(pairs);
        properties
    }
}

impl<N: Into<String>, V: Into<ParameterValue>> Extend<(N, V)> for Properties {
    fn extend<I: IntoIterator<Item = (N, V)>>(&mut self, pairs: I) {
        for (name, value) in pairs {
            self.insert(name, value);
        }
    }
}

impl<N: Into<String>, V: Into<ParameterValue>, const L: usize> From<[(N, V); L]> for Properties {
    fn from(pairs: [(N, V); L]) -> Self {
        pairs.into_iter().collect()
    }
}

impl IntoIterator for Properties {
    type Item = (String, ParameterValue);
    type IntoIter = std::vec::IntoIter<Self::Item>;

    fn into_iter(self) -> Self::IntoIter {
        self.entries.into_iter()
    }
}

/// Converts a parameter's value to a native object.
fn native(value: &ParameterValue) -> Value {
    match value {
        ParameterValue::NotSet => Value::Null,
        ParameterValue::Bool(value) => Value::Bool(*value),
        ParameterValue::Integer(value) => Value::Int(*value),
        ParameterValue::Double(value) => Value::Float(*value),
        ParameterValue::String(text) => Value::Str(text.clone()),
        ParameterValue::ByteArray(bytes) => {
            // The shape is the number of bytes, so the tensor always fits.
            let array = Tensor::new(Dtype::U8, [bytes.len()], bytes.clone());
            array.map_or(Value::Null, Value::Tensor)
        }
        ParameterValue::BoolArray(values) => values.iter().copied().collect(),
        ParameterValue::IntegerArray(values) => values.iter().copied().collect(),
        ParameterValue::DoubleArray(values) => values.iter().copied().collect(),
        ParameterValue::StringArray(texts) => texts.iter().map(String::as_str).collect(),
    }
}

/// Converts a native object to a parameter's value.
fn parameter(name: &str, value: &Value) -> Result<ParameterValue, PropertiesError> {
    Ok(match value {
        Value::Null => ParameterValue::NotSet,
        Value::Bool(value) => ParameterValue::Bool(*value),
        Value::Int(value) => ParameterValue::Integer(*value),
        Value::Float(value) => ParameterValue::Double(*value),
        Value::Str(text) => ParameterValue::String(text.clone()),
        Value::Bytes(bytes) => ParameterValue::ByteArray(bytes.to_vec()),
        Value::List(items) | Value::Tuple(items) => list(name, items)?,
        Value::Tensor(tensor) => array(name, tensor)?,
        Value::BigInt(number) => {
            let digits: String = number.to_string().chars().take(SHOWN).collect();
            return Err(value_error(name, &format!("{digits}, which has more than 64 bits")));
        }
        other => return Err(value_error(name, other.kind())),
    })
}

fn value_error(name: &str, found: &str) -> PropertiesError {
    PropertiesError::Value { name: name.to_owned(), found: found.to_owned() }
}

/// Converts a list whose members are of one type.
fn list(name: &str, items: &[Value]) -> Result<ParameterValue, PropertiesError> {
    let Some(first) = items.first() else {
        return Ok(ParameterValue::StringArray(Vec::new()));
    };
    let is_number = |item: &Value| matches!(item, Value::Int(_) | Value::Float(_));
    let floats = items.iter().any(|item| matches!(item, Value::Float(_)));
    let found = match first {
        Value::Bool(_) => all(items, Value::as_bool).map(ParameterValue::BoolArray),
        Value::Int(_) if !floats => all(items, Value::as_i64).map(ParameterValue::IntegerArray),
        Value::Int(_) | Value::Float(_) if items.iter().all(is_number) => {
            all(items, exact_float).map(ParameterValue::DoubleArray)
        }
        Value::Str(_) => {
            all(items, |item| item.as_str().map(str::to_owned)).map(ParameterValue::StringArray)
        }
        Value::Int(_) | Value::Float(_) => None,
        other => return Err(value_error(name, &format!("a list of {}", other.kind()))),
    };
    found.ok_or_else(|| {
        let differs = |item: &&Value| item.kind() != first.kind();
        match items.iter().find(differs).map(Value::kind) {
            Some(other) if !items.iter().all(is_number) => {
                PropertiesError::Mixed { name: name.to_owned(), first: first.kind(), other }
            }
            _ => value_error(name, "a list of floats and of ints that no float is equal to"),
        }
    })
}

fn all<T>(items: &[Value], read: impl Fn(&Value) -> Option<T>) -> Option<Vec<T>> {
    items.iter().map(read).collect()
}

/// Converts an array with one dimension.
fn array(name: &str, tensor: &Tensor) -> Result<ParameterValue, PropertiesError> {
    let refuse = |what: &str| value_error(name, &format!("an array {what}"));
    if tensor.shape.len() != 1 {
        return Err(refuse(&format!("with {} dimensions", tensor.shape.len())));
    }
    let data = &tensor.data;
    let Some(Value::List(numbers)) = super::nested_list(tensor) else {
        return Err(refuse(&format!("of {}", tensor.dtype)));
    };
    Ok(match tensor.dtype {
        Dtype::U8 => ParameterValue::ByteArray(data.to_vec()),
        Dtype::Bool => ParameterValue::BoolArray(data.iter().map(|&byte| byte != 0).collect()),
        Dtype::F32 | Dtype::F64 => {
            ParameterValue::DoubleArray(numbers.iter().filter_map(Value::as_f64).collect())
        }
        other @ (Dtype::F16 | Dtype::BF16) => return Err(refuse(&format!("of {other}"))),
        _ => all(&numbers, Value::as_i64)
            .map(ParameterValue::IntegerArray)
            .ok_or_else(|| refuse("with a number of more than 63 bits"))?,
    })
}

#[cfg(test)]
#[path = "properties_tests.rs"]
mod tests;
