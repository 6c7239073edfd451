//! Labels of columns: values of an index, one by one.

use arrow_array::cast::AsArray as _;
use arrow_array::{Array, ArrayRef};
use arrow_schema::DataType;

use crate::pickle::{Node, PickleError, View};
use wrapyfi_data::types::{Value, arrow, nested_list};

/// Levels that labels may have.
const MAX_LEVELS: usize = 64;

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
    Ok(match node.view() {
        View::None => Value::Null,
        View::Bool(value) => value.into(),
        View::Int(value) => value.into(),
        View::Float(value) => value.into(),
        View::Str(text) => text.into(),
        _ => return Err(node.unexpected("a name that is text, a number or None")),
    })
}

/// The elements of an array of text, numbers or bools; missing ones are null.
pub(super) fn values(array: &ArrayRef) -> Option<Vec<Value>> {
    Some(match array.data_type() {
        DataType::Utf8 => array.as_string::<i32>().iter().map(Value::from).collect(),
        DataType::LargeUtf8 => array.as_string::<i64>().iter().map(Value::from).collect(),
        number
            if number.is_integer()
                || matches!(number, DataType::Boolean | DataType::Float32 | DataType::Float64) =>
        {
            let Value::List(mut labels) = nested_list(&arrow::elements(array)?)? else {
                return None;
            };
            for (row, label) in labels.iter_mut().enumerate() {
                if array.is_null(row) {
                    *label = Value::Null;
                }
            }
            labels
        }
        _ => return None,
    })
}
