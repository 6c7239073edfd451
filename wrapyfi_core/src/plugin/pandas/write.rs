//! A [`Frame`] as a pickle that calls pandas's public constructors.
//!
//! ```text
//!   pandas.DataFrame({label: pandas.Series(values, index), …}, index, columns)
//!   pandas.Series(values, index, None, name)
//!   pandas.Index(values, None, False, name) · pandas.RangeIndex(start, stop, step, None, False, name)
//! ```
//!
//! The index is one object for all: pandas would align series with different ones.

use std::collections::HashSet;

use arrow_array::cast::AsArray as _;
use arrow_array::types::{
    ArrowDictionaryKeyType, Float16Type, Float32Type, Float64Type, Int8Type, Int16Type, Int32Type,
    Int64Type, UInt8Type, UInt16Type, UInt32Type, UInt64Type,
};
use arrow_array::{Array, ArrayRef, ArrowPrimitiveType};
use arrow_schema::{DataType, TimeUnit};
use bytes::Bytes;

use super::super::PluginError;
use super::super::stack::Stack;
use super::frame::{Column, Frame, Index, Kind};
use crate::codec::json;
use crate::codec::pickle::Writer;
use crate::types::Value;

type Result<T = ()> = std::result::Result<T, PluginError>;

/// Writes a data frame, a series or an index.
pub(super) fn frame(to: &mut Stack, frame: &Frame) -> Result {
    match (frame.kind, &frame.columns[..]) {
        (Kind::Index, _) => index(to, &frame.index),
        (Kind::Series, [only]) => {
            to.global("pandas", "Series").mark();
            values(to, only)?;
            index(to, &frame.index)?;
            dtype(to, only);
            label(to, &only.label)?;
            to.tuple_since_mark().reduce();
            Ok(())
        }
        (_, columns) => data_frame(to, frame, columns),
    }
}

fn data_frame(to: &mut Stack, frame: &Frame, columns: &[Column]) -> Result {
    let mut seen = HashSet::new();
    for column in columns {
        let key = json::encode(&column.label).unwrap_or_default();
        if !seen.insert(key) {
            return Err(PluginError::Unsupported {
                what: format!("a data frame with two columns labelled {:?}", column.label),
                remedy: "give the columns different labels".into(),
            });
        }
    }
    // The index is written first, remembered, and taken off again.
    index(to, &frame.index)?;
    let rows = to.remember();
    to.pop().global("pandas", "DataFrame").mark();
    to.mark();
    for column in columns {
        label(to, &column.label)?;
        to.global("pandas", "Series").mark();
        values(to, column)?;
        to.recall(rows);
        dtype(to, column);
        to.tuple_since_mark().reduce();
    }
    to.dict_since_mark();
    to.recall(rows);
    labels(to, frame, columns)?;
    to.tuple_since_mark().reduce();
    Ok(())
}

/// The row of labels: a range where it is one, as pandas itself makes it.
fn labels(to: &mut Stack, frame: &Frame, columns: &[Column]) -> Result {
    let counted = columns.iter().zip(0..).all(|(column, n)| column.label == Value::Int(n));
    if counted {
        let stop = i64::try_from(columns.len()).unwrap_or(i64::MAX);
        return range(to, 0, stop, 1, &frame.columns_name);
    }
    to.global("pandas", "Index").mark().mark();
    for column in columns {
        label(to, &column.label)?;
    }
    to.list_since_mark().none().bool(false);
    label(to, &frame.columns_name)?;
    to.tuple_since_mark().reduce();
    Ok(())
}

fn index(to: &mut Stack, index: &Index) -> Result {
    match index {
        Index::Range { start, stop, step, name } => range(to, *start, *stop, *step, name),
        Index::Column(column) => {
            to.global("pandas", "Index").mark();
            values(to, column)?;
            dtype(to, column);
            to.bool(false);
            label(to, &column.label)?;
            to.tuple_since_mark().reduce();
            Ok(())
        }
    }
}

fn range(to: &mut Stack, start: i64, stop: i64, step: i64, name: &Value) -> Result {
    to.global("pandas", "RangeIndex").mark().int(start).int(stop).int(step).none().bool(false);
    label(to, name)?;
    to.tuple_since_mark().reduce();
    Ok(())
}

fn label(to: &mut Stack, label: &Value) -> Result {
    match label {
        Value::Null => to.none(),
        Value::Bool(value) => to.bool(*value),
        Value::Int(value) => to.int(*value),
        Value::BigInt(value) => to.big_int(value),
        Value::Float(value) => to.float(*value),
        Value::Str(text) => to.str(text),
        other => {
            return Err(PluginError::Unsupported {
                what: format!("a label of type {}", other.kind()),
                remedy: "use text, a number or None".into(),
            });
        }
    };
    Ok(())
}

/// The type to ask for, where pandas would not find it in the values.
fn dtype(to: &mut Stack, column: &Column) {
    let own = match column.array.data_type() {
        DataType::Timestamp(unit, Some(zone)) => {
            Some(format!("datetime64[{}, {zone}]", unit_name(*unit)))
        }
        _ if column.dtype.starts_with("object") => Some("object".to_owned()),
        // `str` is what pandas 3 takes text for, and pandas 2 has no better than objects.
        DataType::Utf8 | DataType::LargeUtf8 if column.dtype == "string" => {
            Some("string".to_owned())
        }
        _ => None,
    };
    match own {
        Some(name) => to.str(&name),
        None => to.none(),
    };
}

/// pandas's array with a mask: the column has its type, or needs it because a value is missing.
fn masked_class(column: &Column) -> Option<&'static str> {
    let class = match column.array.data_type() {
        DataType::Boolean => "BooleanArray",
        DataType::Float32 | DataType::Float64 => "FloatingArray",
        integer if integer.is_integer() => "IntegerArray",
        _ => return None,
    };
    let has_mask = column.dtype == "boolean" || column.dtype.starts_with(['I', 'U', 'F']);
    (has_mask || column.array.null_count() > 0).then_some(class)
}

fn unit_name(unit: TimeUnit) -> &'static str {
    match unit {
        TimeUnit::Second => "s",
        TimeUnit::Millisecond => "ms",
        TimeUnit::Microsecond => "us",
        TimeUnit::Nanosecond => "ns",
    }
}

/// The values of a column as something that pandas takes.
fn values(to: &mut Stack, column: &Column) -> Result {
    let array = &column.array;
    if column.dtype.starts_with("object") {
        return objects(to, column);
    }
    if let Some(class) = masked_class(column) {
        to.global("pandas.arrays", class);
        plain(to, column)?;
        let mask: Vec<u8> = (0..array.len()).map(|row| u8::from(array.is_null(row))).collect();
        to.array("|b1", array.len(), mask.into()).tuple(2).reduce();
        return Ok(());
    }
    plain(to, column)
}

/// The values where none is missing, whatever stands there.
fn plain(to: &mut Stack, column: &Column) -> Result {
    let array = &column.array;
    match array.data_type() {
        DataType::Utf8 | DataType::LargeUtf8 | DataType::Binary | DataType::LargeBinary => {
            return objects(to, column);
        }
        DataType::Boolean => {
            let bytes: Vec<u8> =
                array.as_boolean().iter().map(|value| u8::from(value == Some(true))).collect();
            to.array("|b1", array.len(), bytes.into());
        }
        DataType::Int8 => numbers::<Int8Type>(to, array, "|i1"),
        DataType::Int16 => numbers::<Int16Type>(to, array, "<i2"),
        DataType::Int32 => numbers::<Int32Type>(to, array, "<i4"),
        DataType::Int64 => numbers::<Int64Type>(to, array, "<i8"),
        DataType::UInt8 => numbers::<UInt8Type>(to, array, "|u1"),
        DataType::UInt16 => numbers::<UInt16Type>(to, array, "<u2"),
        DataType::UInt32 => numbers::<UInt32Type>(to, array, "<u4"),
        DataType::UInt64 => numbers::<UInt64Type>(to, array, "<u8"),
        DataType::Float16 => numbers::<Float16Type>(to, array, "<f2"),
        DataType::Float32 => numbers::<Float32Type>(to, array, "<f4"),
        DataType::Float64 => numbers::<Float64Type>(to, array, "<f8"),
        // With a zone the numbers are what pandas takes for instants; times would be local.
        DataType::Timestamp(_, Some(_)) => times(to, array, "<i8"),
        DataType::Timestamp(unit, None) => {
            times(to, array, &format!("<M8[{}]", unit_name(*unit)));
        }
        DataType::Duration(unit) => times(to, array, &format!("<m8[{}]", unit_name(*unit))),
        DataType::Dictionary(key, _) => return categories(to, column, key),
        other => {
            return Err(PluginError::Unsupported {
                what: format!("a column {:?} of type {other}", column.label),
                remedy: "cast it to numbers, text, times or categories".into(),
            });
        }
    }
    Ok(())
}

fn numbers<T: ArrowPrimitiveType>(to: &mut Stack, array: &ArrayRef, descr: &str) {
    let values = array.as_primitive::<T>().values();
    to.array(descr, array.len(), Bytes::copy_from_slice(values.inner().as_slice()));
}

/// Counts of a unit of time; missing ones are NaT.
fn times(to: &mut Stack, array: &ArrayRef, descr: &str) {
    let data = array.to_data();
    let all = data.buffers().first().map(arrow_buffer::Buffer::as_slice).unwrap_or_default();
    let (counts, _) = all.as_chunks::<8>();
    let counts = counts.iter().skip(data.offset()).take(array.len()).enumerate();
    let missing = i64::MIN.to_le_bytes();
    let bytes: Vec<u8> =
        counts.flat_map(|(row, count)| if array.is_null(row) { missing } else { *count }).collect();
    to.array(descr, array.len(), bytes.into());
}

/// Python objects, one each.
fn objects(to: &mut Stack, column: &Column) -> Result {
    let array = &column.array;
    let missing = |to: &mut Writer| match column.dtype.as_str() {
        "object(nan)" | "str" => to.float(f64::NAN),
        "object(NA)" => to.global("pandas", "NA"),
        _ => to.none(),
    };
    macro_rules! each {
        ($values:expr, |$to:ident, $value:ident| $write:expr) => {{
            let values = $values;
            to.objects(array.len(), |$to| {
                for value in values.iter() {
                    match value {
                        Some($value) => $write,
                        None => missing($to),
                    }
                }
            });
        }};
    }
    match array.data_type() {
        DataType::Utf8 => each!(array.as_string::<i32>(), |to, text| to.str(text)),
        DataType::LargeUtf8 => each!(array.as_string::<i64>(), |to, text| to.str(text)),
        DataType::Binary => each!(array.as_binary::<i32>(), |to, bytes| to.bytes(bytes)),
        DataType::LargeBinary => each!(array.as_binary::<i64>(), |to, bytes| to.bytes(bytes)),
        DataType::Boolean => each!(array.as_boolean(), |to, value| to.bool(value)),
        DataType::Float64 => {
            each!(array.as_primitive::<Float64Type>(), |to, value| to.float(value));
        }
        DataType::Int64 => each!(array.as_primitive::<Int64Type>(), |to, n| to.int(n)),
        other => {
            return Err(PluginError::Unsupported {
                what: format!("a column {:?} of objects of type {other}", column.label),
                remedy: "leave out its dtype, or cast it".into(),
            });
        }
    }
    Ok(())
}

/// `pandas.Categorical.from_codes(codes, categories, ordered)`.
fn categories(to: &mut Stack, column: &Column, key: &DataType) -> Result {
    fn codes<K: ArrowDictionaryKeyType>(array: &ArrayRef) -> (Vec<i64>, ArrayRef)
    where
        K::Native: Into<i64>,
    {
        let dictionary = array.as_dictionary::<K>();
        let codes = dictionary.keys().iter().map(|code| code.map_or(-1, Into::into));
        (codes.collect(), std::sync::Arc::clone(dictionary.values()))
    }
    let (codes, values) = match key {
        DataType::Int8 => codes::<Int8Type>(&column.array),
        DataType::Int16 => codes::<Int16Type>(&column.array),
        DataType::Int32 => codes::<Int32Type>(&column.array),
        DataType::Int64 => codes::<Int64Type>(&column.array),
        DataType::UInt8 => codes::<UInt8Type>(&column.array),
        DataType::UInt16 => codes::<UInt16Type>(&column.array),
        DataType::UInt32 => codes::<UInt32Type>(&column.array),
        other => {
            return Err(PluginError::Unsupported {
                what: format!("categories with codes of type {other}"),
                remedy: "use codes of int8 to int64".into(),
            });
        }
    };
    let (descr, width) = match key {
        DataType::Int8 => ("|i1", 1),
        DataType::Int16 => ("<i2", 2),
        DataType::Int32 => ("<i4", 4),
        _ => ("<i8", 8),
    };
    let bytes: Vec<u8> =
        codes.iter().flat_map(|code| code.to_le_bytes().into_iter().take(width)).collect();
    to.global("pandas", "Categorical.from_codes");
    to.array(descr, codes.len(), bytes.into());
    let categories = Column { label: Value::Null, dtype: String::new(), array: values };
    index(to, &Index::Column(Box::new(categories)))?;
    to.bool(column.dtype == "category(ordered)").tuple(3).reduce();
    Ok(())
}
