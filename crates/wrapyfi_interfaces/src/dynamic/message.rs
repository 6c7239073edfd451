//! Messages of any type.

use std::fmt;
use std::sync::Arc;

use super::shape::{Shape, same};
use super::{DynamicValue, ValueError};

/// A message of a type that became known while running: named fields in order. Its values are
/// always of the types that the definition gives the fields.
#[derive(Clone)]
pub struct DynamicMessage {
    pub(super) shape: Arc<Shape>,
    /// One for each field of the shape.
    pub(super) values: Vec<DynamicValue>,
}

/// Writes a struct of the type's name; the compiled type is left out.
impl fmt::Debug for DynamicMessage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut debug = f.debug_struct(self.type_name());
        for (name, value) in self.fields() {
            debug.field(name, value);
        }
        debug.finish()
    }
}

impl PartialEq for DynamicMessage {
    fn eq(&self, other: &Self) -> bool {
        same(&self.shape, &other.shape) && self.values == other.values
    }
}

impl DynamicMessage {
    /// ROS name of the type, for instance `sensor_msgs/msg/JointState`.
    pub fn type_name(&self) -> &str {
        &self.shape.name
    }

    /// Names and values in order.
    pub fn fields(&self) -> impl ExactSizeIterator<Item = (&str, &DynamicValue)> {
        self.shape.fields.iter().map(|field| field.name.as_str()).zip(&self.values)
    }

    /// Value of a field, also of a nested one: `header.stamp.sec`.
    pub fn get(&self, path: &str) -> Option<&DynamicValue> {
        let (name, inner) = first_of(path);
        let (position, _) = self.shape.field(name)?;
        let value = self.values.get(position)?;
        match inner {
            None => Some(value),
            Some(inner) => value.as_message()?.get(inner),
        }
    }

    /// Changes a field, also a nested one.
    ///
    /// # Errors
    /// When there is no such field, or the value is not of its type.
    pub fn set(&mut self, path: &str, value: impl Into<DynamicValue>) -> Result<(), ValueError> {
        self.set_value(path, value.into())
    }

    fn set_value(&mut self, path: &str, value: DynamicValue) -> Result<(), ValueError> {
        let (name, inner) = first_of(path);
        let shape = Arc::clone(&self.shape);
        let unknown = || shape.unknown(name);
        let (position, field) = shape.field(name).ok_or_else(unknown)?;
        let place = self.values.get_mut(position).ok_or_else(unknown)?;
        match (inner, place) {
            (None, place) => {
                field.check(&value).map_err(|error| error.in_field(name))?;
                *place = value;
                Ok(())
            }
            (Some(inner), DynamicValue::Message(message)) => {
                message.set_value(inner, value).map_err(|error| error.in_field(name))
            }
            (Some(inner), place) => Err(ValueError::Kind {
                path: path.to_owned(),
                expected: format!("a message with the field {inner:?}"),
                found: place.kind_name(),
            }),
        }
    }
}

/// Name of the first field of a path, and the path inside that field.
fn first_of(path: &str) -> (&str, Option<&str>) {
    path.split_once('.').map_or((path, None), |(name, inner)| (name, Some(inner)))
}
