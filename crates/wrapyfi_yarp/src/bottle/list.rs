//! A list of values.

use super::value::Value;

/// A list of values: what YARP sends unless it sends an image, a sound or a vector.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Bottle {
    /// The elements in order.
    pub values: Vec<Value>,
}

impl Bottle {
    /// A bottle without elements.
    pub const fn new() -> Self {
        Self { values: Vec::new() }
    }

    /// Number of elements.
    pub fn len(&self) -> usize {
        self.values.len()
    }

    /// True when the bottle has no elements.
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// The element at `index`, from 0.
    pub fn get(&self, index: usize) -> Option<&Value> {
        self.values.get(index)
    }

    /// Appends an element.
    pub fn push(&mut self, value: impl Into<Value>) {
        self.values.push(value.into());
    }
}

impl From<Vec<Value>> for Bottle {
    fn from(values: Vec<Value>) -> Self {
        Self { values }
    }
}

impl FromIterator<Value> for Bottle {
    fn from_iter<T: IntoIterator<Item = Value>>(values: T) -> Self {
        Self { values: values.into_iter().collect() }
    }
}

impl Extend<Value> for Bottle {
    fn extend<T: IntoIterator<Item = Value>>(&mut self, values: T) {
        self.values.extend(values);
    }
}

impl IntoIterator for Bottle {
    type Item = Value;
    type IntoIter = std::vec::IntoIter<Value>;

    fn into_iter(self) -> Self::IntoIter {
        self.values.into_iter()
    }
}

impl<'a> IntoIterator for &'a Bottle {
    type Item = &'a Value;
    type IntoIter = std::slice::Iter<'a, Value>;

    fn into_iter(self) -> Self::IntoIter {
        self.values.iter()
    }
}
