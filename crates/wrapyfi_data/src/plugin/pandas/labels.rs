//! Labels of columns: values of an index, one by one.

use arrow_array::cast::AsArray as _;
use arrow_array::types::{
    ArrowPrimitiveType, Float32Type, Float64Type, Int8Type, Int16Type, Int32Type, Int64Type,
    UInt8Type, UInt16Type, UInt32Type, UInt64Type,
};
use arrow_array::{Array, ArrayRef};
use arrow_schema::DataType;

use crate::codec::pickle::{Node, PickleError, View};
use crate::types::Value;

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

/// True for a plain value, which may be a label.
pub(super) fn is_scalar(node: &Node<'_>) -> bool {
    matches!(node.view(), View::None | View::Bool(_) | View::Int(_) | View::Float(_) | View::Str(_))
}
