//! Fields of a type description to their types and default values.

use super::scalar::{Scalar, with_scalar};
use super::shape::ElementShape;
use super::{DynamicValue, PlanError, Primitives};
use crate::description::FieldDescription;
use crate::parser::{Container, DefaultValue, Literal, Primitive};

/// Type of one element, unless it is a message.
pub(super) fn element(message: &str, field: &FieldDescription) -> Result<ElementShape, PlanError> {
    let text = |wide| {
        let bound = size(message, field, field.string_capacity)?;
        Ok(ElementShape::Text { wide, bound: Some(bound) })
    };
    let primitive = match field.type_id % 48 {
        2 => Primitive::Int8,
        3 => Primitive::Uint8,
        4 => Primitive::Int16,
        5 => Primitive::Uint16,
        6 => Primitive::Int32,
        7 => Primitive::Uint32,
        8 => Primitive::Int64,
        9 => Primitive::Uint64,
        10 => Primitive::Float32,
        11 => Primitive::Float64,
        13 => Primitive::Char,
        15 => Primitive::Bool,
        16 => Primitive::Byte,
        17 => return Ok(ElementShape::Text { wide: false, bound: None }),
        18 => return Ok(ElementShape::Text { wide: true, bound: None }),
        21 => return text(false),
        22 => return text(true),
        _ => {
            return Err(PlanError::TypeId {
                message: message.to_owned(),
                field: field.name.clone(),
                type_id: field.type_id,
            });
        }
    };
    Ok(ElementShape::Primitive(primitive))
}

/// Number of elements of a field.
pub(super) fn elements_of(message: &str, field: &FieldDescription) -> Result<Container, PlanError> {
    Ok(match field.type_id / 48 {
        0 => Container::Single,
        1 => Container::Array(size(message, field, field.capacity)?),
        2 => Container::Sequence { bound: Some(size(message, field, field.capacity)?) },
        3 => Container::Sequence { bound: None },
        _ => {
            return Err(PlanError::TypeId {
                message: message.to_owned(),
                field: field.name.clone(),
                type_id: field.type_id,
            });
        }
    })
}

fn size(message: &str, field: &FieldDescription, capacity: u64) -> Result<u32, PlanError> {
    u32::try_from(capacity).ok().filter(|size| *size > 0).ok_or_else(|| PlanError::Capacity {
        message: message.to_owned(),
        field: field.name.clone(),
        capacity,
    })
}

/// The value that the definition states.
pub(super) fn default_value(
    message: &str,
    field: &FieldDescription,
    element: &ElementShape,
    container: Container,
) -> Result<Option<DynamicValue>, PlanError> {
    let Some(default) = &field.default else { return Ok(None) };
    let value = match (default, container) {
        (DefaultValue::One(literal), Container::Single) => one(element, literal),
        (DefaultValue::Many(literals), Container::Array(size)) => {
            many(element, literals).filter(|_| literals.len() == size as usize)
        }
        (DefaultValue::Many(literals), Container::Sequence { .. }) => many(element, literals),
        _ => None,
    };
    value.map(Some).ok_or_else(|| PlanError::Default {
        message: message.to_owned(),
        field: field.name.clone(),
    })
}

fn one(element: &ElementShape, literal: &Literal) -> Option<DynamicValue> {
    match (element, literal) {
        (ElementShape::Primitive(primitive), literal) => {
            with_scalar!(*primitive, T => T::from_literal(literal).map(DynamicValue::from))
        }
        (ElementShape::Text { .. }, Literal::Text(text)) => Some(DynamicValue::Text(text.clone())),
        _ => None,
    }
}

fn many(element: &ElementShape, literals: &[Literal]) -> Option<DynamicValue> {
    match element {
        ElementShape::Primitive(primitive) => with_scalar!(*primitive, T => {
            let values: Option<Vec<T>> = literals.iter().map(T::from_literal).collect();
            values.map(Primitives::from)
        })
        .map(DynamicValue::Primitives),
        ElementShape::Text { .. } => {
            let text = |literal: &Literal| match literal {
                Literal::Text(text) => Some(text.clone()),
                _ => None,
            };
            literals.iter().map(text).collect::<Option<Vec<_>>>().map(DynamicValue::Texts)
        }
        ElementShape::Message(_) => None,
    }
}
