//! Labels of columns: values of an index, one by one.

use arrow_array::cast::AsArray as _;
use arrow_array::types::{
    ArrowPrimitiveType, Float32Type, Float64Type, Int8Type, Int16Type, Int32Type, Int64Type,
    UInt8Type, UInt16Type, UInt32Type, UInt64Type,
};
use arrow_array::{Array, ArrayRef};
use arrow_schema::DataType;

use super::super::budget::Budget;
use super::frame::{Index, range_length};
use super::read::{index as read_index, is_scalar};
use crate::codec::pickle::{Node, PickleError, PickledArray, View};
use crate::types::Value;

/// Labels that a frame may have.
const MAX_LABELS: usize = 1 << 20;

/// Levels that labels may have.
const MAX_LEVELS: usize = 64;

/// The row of labels at `node`, and its name. Labels may be of several types, a column may not.
pub(super) fn axis(node: &Node<'_>, budget: &Budget) -> Result<(Vec<Value>, Value), PickleError> {
    let call = node.any_call()?;
    let listed = match call.global().name {
        "_new_Index" => {
            let parts = call.arg(1)?.dict()?;
            let objects = match parts.find("data").filter(Node::is_array).map(|data| data.array()) {
                Some(Ok(PickledArray::Objects { items, .. })) => Some(items),
                _ => None,
            };
            objects.map(|items| (items, parts.find("name")))
        }
        "Index" => match call.arg(0)?.view() {
            View::List(items) => Some((items, call.args().find(3))),
            _ => None,
        },
        // Written here: (tuples, sortorder, names).
        "MultiIndex.from_tuples" => Some((call.arg(0)?.list()?, call.args().find(2))),
        _ => None,
    };
    let Some((items, name)) = listed else { return of(&read_index(node, budget)?, node, budget) };
    if items.len() > MAX_LABELS {
        return Err(node.unexpected(format!("at most {MAX_LABELS} columns")));
    }
    let name = name.map_or(Ok(Value::Null), |name| scalar(&name))?;
    let labels = items.iter().map(|label| {
        let label = scalar(&label)?;
        budget.take(node, label.size_hint())?;
        Ok(label)
    });
    Ok((labels.collect::<Result<_, PickleError>>()?, name))
}

/// The values of an index, and its name.
fn of(index: &Index, node: &Node<'_>, budget: &Budget) -> Result<(Vec<Value>, Value), PickleError> {
    if index.len() > MAX_LABELS {
        return Err(node.unexpected(format!("at most {MAX_LABELS} columns")));
    }
    match index {
        Index::Range { start, stop, step, name } => {
            let count = i64::try_from(range_length(*start, *stop, *step)).unwrap_or(0);
            let labels = (0..count).map(|n| Value::Int(start.wrapping_add(n.wrapping_mul(*step))));
            Ok((labels.collect(), name.clone()))
        }
        Index::Levels(levels) => {
            let names = levels.iter().map(|level| level.label.clone()).collect();
            let mut rows: Vec<Vec<Value>> = vec![Vec::new(); index.len()];
            for level in levels {
                let dictionary = level.array.as_any_dictionary_opt();
                let found = dictionary.and_then(|labels| Some((labels, values(labels.values())?)));
                let (dictionary, labels) = found
                    .ok_or_else(|| node.unexpected("labels that are text, numbers or bools"))?;
                // No key is valid where there are no labels.
                let keys = if labels.is_empty() { vec![] } else { dictionary.normalized_keys() };
                for (number, row) in rows.iter_mut().enumerate() {
                    let key = keys.get(number).filter(|_| level.array.is_valid(number));
                    let label = key.and_then(|&key| labels.get(key)).cloned().unwrap_or_default();
                    budget.take(node, label.size_hint())?;
                    row.push(label);
                }
            }
            Ok((rows.into_iter().map(Value::Tuple).collect(), Value::Tuple(names)))
        }
        Index::Column(column, _) => {
            let labels = values(&column.array);
            let labels =
                labels.ok_or_else(|| node.unexpected("labels that are text, numbers or bools"))?;
            Ok((labels, column.label.clone()))
        }
    }
}

/// A name or label of its own; where there are several levels, a tuple of one for each.
pub(super) fn scalar(node: &Node<'_>) -> Result<Value, PickleError> {
    if let View::Tuple(levels) = node.view()
        && levels.len() <= MAX_LEVELS
    {
        return levels
            .iter()
            .map(|level| of_one_level(&level))
            .collect::<Result<_, _>>()
            .map(Value::Tuple);
    }
    of_one_level(node)
}

fn of_one_level(node: &Node<'_>) -> Result<Value, PickleError> {
    if !is_scalar(node) {
        return Err(node.unexpected("a name that is text, a number or None"));
    }
    Ok(match node.view() {
        View::Bool(value) => value.into(),
        View::Int(value) => value.into(),
        View::Float(value) => value.into(),
        View::Str(text) => text.into(),
        _ => Value::Null,
    })
}

/// The elements of an array of text, numbers or bools; missing ones are null.
pub(super) fn values(array: &ArrayRef) -> Option<Vec<Value>> {
    fn numbers<T: ArrowPrimitiveType>(array: &ArrayRef) -> Vec<Value>
    where
        T::Native: Into<Value>,
    {
        array.as_primitive::<T>().iter().map(Value::from).collect()
    }
    Some(match array.data_type() {
        DataType::Utf8 => array.as_string::<i32>().iter().map(Value::from).collect(),
        DataType::LargeUtf8 => array.as_string::<i64>().iter().map(Value::from).collect(),
        DataType::Boolean => array.as_boolean().iter().map(Value::from).collect(),
        DataType::Int8 => numbers::<Int8Type>(array),
        DataType::Int16 => numbers::<Int16Type>(array),
        DataType::Int32 => numbers::<Int32Type>(array),
        DataType::Int64 => numbers::<Int64Type>(array),
        DataType::UInt8 => numbers::<UInt8Type>(array),
        DataType::UInt16 => numbers::<UInt16Type>(array),
        DataType::UInt32 => numbers::<UInt32Type>(array),
        DataType::UInt64 => numbers::<UInt64Type>(array),
        DataType::Float32 => numbers::<Float32Type>(array),
        DataType::Float64 => numbers::<Float64Type>(array),
        _ => return None,
    })
}
