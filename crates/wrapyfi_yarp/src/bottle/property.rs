//! Values by name: YARP's `Property`.

use bytes::Bytes;

use super::{Bottle, BottleError, EncodeError, Value};
use crate::{Dialect, Limits};

/// Values by name. As data it is a bottle of lists, each a key and what belongs to it:
/// `(speed 3) (limits 0 10)`.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Property {
    groups: Vec<Bottle>,
}

impl Property {
    /// Without values.
    #[must_use]
    pub const fn new() -> Self {
        Self { groups: Vec::new() }
    }

    /// The lists of a bottle. Elements that are no lists, or empty ones, name nothing: they come
    /// back beside it, counted.
    #[must_use]
    pub fn from_bottle(bottle: Bottle) -> (Self, usize) {
        let given = bottle.len();
        let groups: Vec<Bottle> = bottle
            .into_iter()
            .filter_map(|value| match value {
                Value::List(list) if !list.is_empty() => Some(list),
                _ => None,
            })
            .collect();
        let left_out = given - groups.len();
        (Self { groups }, left_out)
    }

    /// The bottle of its lists.
    #[must_use]
    pub fn to_bottle(&self) -> Bottle {
        self.groups.iter().cloned().map(Value::List).collect()
    }

    /// Reads a property that was sent as data, with the number of elements that name nothing.
    ///
    /// # Errors
    /// As [`Bottle::decode`].
    pub fn decode(
        bytes: &Bytes,
        dialect: Dialect,
        limits: &Limits,
    ) -> Result<(Self, usize), BottleError> {
        let (bottle, _) = Bottle::decode(bytes, dialect, limits)?;
        Ok(Self::from_bottle(bottle))
    }

    /// The property as data.
    ///
    /// # Errors
    /// As [`Bottle::encode`].
    pub fn encode(&self, dialect: Dialect) -> Result<Vec<u8>, EncodeError> {
        self.to_bottle().encode(dialect)
    }

    /// The value of `key`: the first, where there are several.
    #[must_use]
    pub fn get(&self, key: &str) -> Option<&Value> {
        self.group(key)?.values.get(1)
    }

    /// The whole list of `key`, the key included.
    #[must_use]
    pub fn group(&self, key: &str) -> Option<&Bottle> {
        self.groups.iter().find(|group| is(group, key))
    }

    /// Gives `key` a value, in place of what it had.
    pub fn set(&mut self, key: &str, value: impl Into<Value>) {
        let group = Bottle::from(vec![Value::string(key), value.into()]);
        match self.groups.iter_mut().find(|group| is(group, key)) {
            Some(old) => *old = group,
            None => self.groups.push(group),
        }
    }

    /// Removes what belongs to `key`, and returns whether there was something.
    pub fn remove(&mut self, key: &str) -> bool {
        let before = self.groups.len();
        self.groups.retain(|group| !is(group, key));
        self.groups.len() < before
    }

    /// All lists, in the order in which their keys came.
    pub fn groups(&self) -> impl Iterator<Item = &Bottle> {
        self.groups.iter()
    }
}

fn is(group: &Bottle, key: &str) -> bool {
    group.values.first().is_some_and(|first| super::is_key(first, key))
}
