//! Default values of fields.

use super::scalar::{Scalar, with_scalar};
use super::shape::ElementShape;
use super::{DynamicValue, Primitives};
use crate::parser::{DefaultValue, Literal};

/// The value that the definition states; `None` where it is of another type, which the parser does not
/// let through.
pub(super) fn default_value(
    element: &ElementShape,
    default: &DefaultValue,
) -> Option<DynamicValue> {
    match default {
        DefaultValue::One(literal) => one(element, literal),
        DefaultValue::Many(literals) => many(element, literals),
    }
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
