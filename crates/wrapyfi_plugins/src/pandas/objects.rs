//! Columns of Python objects: text, or plain values of one kind; else the JSON of each.

use std::sync::Arc;

use arrow_array::{ArrayRef, BinaryArray, BooleanArray, Float64Array, Int64Array, StringArray};

use super::super::budget::Budget;
use super::cells;
use crate::pickle::{Node, PickleError, View};

/// Object that stands for a missing value in a column of objects.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Missing {
    None,
    Nan,
    Na,
}

/// Type of the values in a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Content {
    Text,
    Bool,
    Int,
    Float,
    Bytes,
}

/// Reads objects as an array, with the name of its type.
pub(super) fn array(
    owner: &Node<'_>,
    items: &[Node<'_>],
    budget: &Budget,
) -> Result<(ArrayRef, &'static str), PickleError> {
    let Ok((content, missing)) = survey(owner, items) else {
        return Ok((cells::array(items, budget)?, cells::DTYPE));
    };
    budget.take(owner, items.len().saturating_mul(8))?;
    // Values of another kind are missing ones.
    let array: ArrayRef = match content {
        Content::Text => Arc::new(StringArray::from_iter(sized(items, budget, Node::str)?)),
        Content::Bytes => Arc::new(BinaryArray::from_iter(sized(items, budget, Node::bytes)?)),
        Content::Bool => Arc::new(BooleanArray::from_iter(items.iter().map(|it| it.bool().ok()))),
        Content::Int => Arc::new(Int64Array::from_iter(items.iter().map(|it| it.int().ok()))),
        Content::Float => Arc::new(Float64Array::from_iter(items.iter().map(|it| it.float().ok()))),
    };
    let dtype = match missing {
        None | Some(Missing::None) => "object",
        Some(Missing::Nan) => "object(nan)",
        Some(Missing::Na) => "object(NA)",
    };
    Ok((array, dtype))
}

/// The values whose bytes are booked before they are copied, nothing for missing ones.
fn sized<'p, T: AsRef<[u8]>>(
    items: &[Node<'p>],
    budget: &Budget,
    read: fn(&Node<'p>) -> Result<T, PickleError>,
) -> Result<Vec<Option<T>>, PickleError> {
    let booked = items.iter().map(|item| {
        let value = read(item).ok();
        budget.take(item, value.as_ref().map_or(0, |value| value.as_ref().len()))?;
        Ok(value)
    });
    booked.collect()
}

/// The one kind of content that all items have.
fn survey(owner: &Node<'_>, items: &[Node<'_>]) -> Result<(Content, Option<Missing>), PickleError> {
    let (mut content, mut missing, mut nans) = (None, None, false);
    for item in items {
        let found = match item.view() {
            View::None => {
                agree(owner, &mut missing, Missing::None)?;
                continue;
            }
            View::Global(global) if global.name == "NA" => {
                agree(owner, &mut missing, Missing::Na)?;
                continue;
            }
            View::Float(value) if value.is_nan() => {
                nans = true;
                continue;
            }
            View::Str(_) => Content::Text,
            View::Bool(_) => Content::Bool,
            View::Int(_) => Content::Int,
            View::Float(_) => Content::Float,
            View::Bytes(_) => Content::Bytes,
            _ => return Err(item.unexpected("text, a number, a bool, bytes or None in a column")),
        };
        if *content.get_or_insert(found) != found {
            return Err(item.unexpected("an object of the same type as those before in its column"));
        }
    }
    // Among floats NaN is a value like any other.
    if nans && content != Some(Content::Float) {
        if content.is_none() && missing.is_none() {
            return Ok((Content::Float, None));
        }
        agree(owner, &mut missing, Missing::Nan)?;
    }
    Ok((content.unwrap_or(Content::Text), missing))
}

fn agree(
    owner: &Node<'_>,
    missing: &mut Option<Missing>,
    found: Missing,
) -> Result<(), PickleError> {
    if *missing.get_or_insert(found) == found {
        return Ok(());
    }
    Err(owner.unexpected("a column that spells missing values in one way"))
}
