//! JSON to messages.

use std::sync::Arc;

use serde_json::Value;

use super::error::kind;
use super::scalar::{Scalar, with_scalar};
use super::shape::{ElementShape, FieldShape, Shape};
use super::{DynamicMessage, DynamicValue, Primitives, TypePlan, ValueError};
use crate::parser::Container;

impl TypePlan {
    /// Reads a message from JSON: an object with fields by name. Fields that are missing have
    /// their default value. The serialised message must not exceed `max_bytes`.
    ///
    /// # Errors
    /// When a field is unknown, or a value is not of its field's type; the error names the path.
    pub fn from_json(&self, json: &Value, max_bytes: usize) -> Result<DynamicMessage, ValueError> {
        let mut budget = Budget { left: max_bytes, limit: max_bytes };
        budget.take(self.shape.default_size)?;
        message(&self.shape, json, &mut budget)
    }
}

/// Bytes that the message may still take. Short texts can blow up: `{}` stands for a message with
/// all its fixed arrays.
struct Budget {
    left: usize,
    limit: usize,
}

impl Budget {
    fn take(&mut self, size: usize) -> Result<(), ValueError> {
        match self.left.checked_sub(size) {
            Some(left) => {
                self.left = left;
                Ok(())
            }
            None => Err(ValueError::TooLarge { path: String::new(), limit: self.limit }),
        }
    }
}

/// Bytes of a default value that the definition states.
pub(super) fn stated_size(value: &DynamicValue) -> usize {
    match value {
        DynamicValue::Text(text) => text.len(),
        DynamicValue::Texts(texts) => {
            texts.iter().fold(0_usize, |size, text| size.saturating_add(text.len() + 4))
        }
        DynamicValue::Primitives(values) => values.byte_count(),
        _ => 0,
    }
}

fn message(
    shape: &Arc<Shape>,
    json: &Value,
    budget: &mut Budget,
) -> Result<DynamicMessage, ValueError> {
    let Value::Object(object) = json else {
        return Err(kind(format!("an object with the fields of {}", shape.name), json));
    };
    if let Some(name) = object.keys().find(|name| shape.field(name).is_none()) {
        return Err(shape.unknown(name));
    }
    let values = shape.fields.iter().map(|field| match object.get(&field.name) {
        None => Ok(field.default_value()),
        Some(json) => value(field, json, budget).map_err(|error| error.in_field(&field.name)),
    });
    Ok(DynamicMessage { shape: Arc::clone(shape), values: values.collect::<Result<_, _>>()? })
}

/// A value of a field whose fixed part the budget has already covered.
fn value(
    field: &FieldShape,
    json: &Value,
    budget: &mut Budget,
) -> Result<DynamicValue, ValueError> {
    if field.container == Container::Single {
        return match &field.element {
            ElementShape::Primitive(primitive) => {
                with_scalar!(*primitive, T => T::from_json(*primitive, json).map(DynamicValue::from))
            }
            ElementShape::Text { .. } => text(field, json, budget).map(DynamicValue::Text),
            ElementShape::Message(shape) => message(shape, json, budget).map(DynamicValue::Message),
        };
    }
    let Value::Array(elements) = json else {
        return Err(kind(format!("an array for {}", field.type_name()), json));
    };
    field.check_count(elements.len())?;
    if let Container::Sequence { .. } = field.container {
        let size = match &field.element {
            ElementShape::Message(shape) => shape.default_size,
            other => other.min_size(),
        };
        budget.take(size.saturating_mul(elements.len()))?;
    }
    Ok(match &field.element {
        ElementShape::Primitive(primitive) => {
            DynamicValue::Primitives(with_scalar!(*primitive, T => {
                Primitives::from(each(elements, |json| T::from_json(*primitive, json))?)
            }))
        }
        ElementShape::Text { .. } => {
            DynamicValue::Texts(each(elements, |json| text(field, json, budget))?)
        }
        ElementShape::Message(shape) => {
            DynamicValue::Messages(each(elements, |json| message(shape, json, budget))?)
        }
    })
}

fn each<T>(
    elements: &[Value],
    mut read: impl FnMut(&Value) -> Result<T, ValueError>,
) -> Result<Vec<T>, ValueError> {
    let elements = elements.iter().enumerate();
    elements.map(|(index, json)| read(json).map_err(|error| error.in_element(index))).collect()
}

fn text(field: &FieldShape, json: &Value, budget: &mut Budget) -> Result<String, ValueError> {
    let Value::String(text) = json else {
        return Err(kind(field.element.name().to_owned(), json));
    };
    field.check_text(text)?;
    budget.take(text.len())?;
    Ok(text.clone())
}
