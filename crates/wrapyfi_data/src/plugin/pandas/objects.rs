//! Columns of Python objects: text, or plain values of one kind.

use std::sync::Arc;

use arrow_array::ArrayRef;
use arrow_array::builder::{
    BinaryBuilder, BooleanBuilder, Float64Builder, Int64Builder, StringBuilder,
};

use super::super::budget::Budget;
use crate::codec::pickle::{Node, PickleError, View};

/// Object that stands for a missing value in a column of objects.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Missing {
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

/// Reads objects as an array; how missing ones were spelled, where there are any.
pub(super) fn array(
    owner: &Node<'_>,
    items: &[Node<'_>],
    budget: &Budget,
) -> Result<(ArrayRef, Option<Missing>), PickleError> {
    let (content, missing) = survey(owner, items)?;
    budget.take(owner, items.len().saturating_mul(8))?;
    let array: ArrayRef = match content {
        Content::Text => {
            let mut builder = StringBuilder::new();
            for item in items {
                match item.view() {
                    View::Str(text) => {
                        budget.take(item, text.len())?;
                        builder.append_value(text);
                    }
                    _ => builder.append_null(),
                }
            }
            Arc::new(builder.finish())
        }
        Content::Bytes => {
            let mut builder = BinaryBuilder::new();
            for item in items {
                match item.bytes() {
                    Ok(bytes) => {
                        budget.take(item, bytes.len())?;
                        builder.append_value(bytes);
                    }
                    Err(_missing) => builder.append_null(),
                }
            }
            Arc::new(builder.finish())
        }
        Content::Bool => {
            let mut builder = BooleanBuilder::new();
            items.iter().for_each(|item| builder.append_option(item.bool().ok()));
            Arc::new(builder.finish())
        }
        Content::Int => {
            let mut builder = Int64Builder::new();
            items.iter().for_each(|item| builder.append_option(item.int().ok()));
            Arc::new(builder.finish())
        }
        Content::Float => {
            let mut builder = Float64Builder::new();
            items.iter().for_each(|item| builder.append_option(item.float().ok()));
            Arc::new(builder.finish())
        }
    };
    Ok((array, missing))
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
