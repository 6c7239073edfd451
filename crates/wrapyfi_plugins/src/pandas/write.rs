//! A [`Frame`] as a pickle that calls pandas's public constructors.
//!
//! ```text
//!   pandas.DataFrame({label: pandas.Series(values, index), …}, index, columns)
//!   pandas.DataFrame({0: …, 1: …}, index, range) and state {_typ, columns}, where two labels are equal
//!   pandas.Series(values, index, None, name)
//!   pandas.Index(values, None, False, name) · pandas.RangeIndex(start, stop, step, None, False, name)
//!   pandas.MultiIndex.from_tuples(labels of columns, None, names)
//! ```
//!
//! An index of several levels, or of times that are regular, has constructors that differ from
//! release to release: those are applied by name, as pandas does for its own,
//! `_new_Index(pandas.DatetimeIndex, {data, freq, name})`.
//!
//! The index is one object for all: pandas would align series with different ones.

use std::collections::HashSet;

use arrow_array::cast::AsArray as _;
use arrow_array::types::{Float64Type, Int64Type};
use arrow_array::{Array, ArrayRef};
use arrow_schema::DataType;

use super::super::{PluginError, pyarrow};
use super::column::{ARROW, PERIOD, zoned};
use super::frame::{Column, Frame, Index, Kind};
use super::{cells, intervals, offsets};
use crate::pickle::Writer;
use wrapyfi_data::types::arrow::{self, unit_name};
use wrapyfi_data::types::{Value, into_bytes};

type Result<T = ()> = std::result::Result<T, PluginError>;

/// Writes a data frame, a series or an index.
pub(super) fn frame(to: &mut Writer, frame: &Frame) -> Result {
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

fn data_frame(to: &mut Writer, frame: &Frame, columns: &[Column]) -> Result {
    let mut seen = HashSet::new();
    let is_dict =
        columns.iter().all(|it| seen.insert(cells::to_text(&it.label).unwrap_or_default()));
    // The index is written first, put into the memo, and popped.
    index(to, &frame.index)?;
    let rows = to.remember();
    to.pop().global("pandas", "DataFrame").mark();
    to.mark();
    for (column, number) in columns.iter().zip(0..) {
        match is_dict {
            true => label(to, &column.label)?,
            false => _ = to.int(number),
        }
        to.global("pandas", "Series").mark();
        values(to, column)?;
        to.recall(rows);
        dtype(to, column);
        to.tuple_since_mark().reduce();
    }
    to.dict_since_mark();
    to.recall(rows);
    if is_dict {
        labels(to, frame, columns)?;
        to.tuple_since_mark().reduce();
        return Ok(());
    }
    // A dict has no key twice: the columns are numbered, and are given their labels by the state.
    range(to, 0, i64::try_from(columns.len()).unwrap_or(i64::MAX), 1, &Value::Null)?;
    to.tuple_since_mark().reduce().mark();
    to.str("_typ").str("dataframe").str("columns");
    labels(to, frame, columns)?;
    to.dict_since_mark().build();
    Ok(())
}

/// The row of labels: a range where it is one, as pandas itself makes it.
fn labels(to: &mut Writer, frame: &Frame, columns: &[Column]) -> Result {
    let counted = columns.iter().zip(0..).all(|(column, n)| column.label == Value::Int(n));
    if counted {
        let stop = i64::try_from(columns.len()).unwrap_or(i64::MAX);
        return range(to, 0, stop, 1, &frame.columns_name);
    }
    let levels = |column: &Column| match &column.label {
        Value::Tuple(levels) => levels.len(),
        _ => 0,
    };
    let count = columns.first().map_or(0, levels);
    if count > 0 && columns.iter().all(|column| levels(column) == count) {
        to.global("pandas", "MultiIndex.from_tuples").mark();
        to.list(columns, |to, column| label(to, &column.label))?.none();
        label(to, &frame.columns_name)?;
        to.tuple_since_mark().reduce();
        return Ok(());
    }
    to.global("pandas", "Index").mark();
    to.list(columns, |to, column| label(to, &column.label))?.none().bool(false);
    label(to, &frame.columns_name)?;
    to.tuple_since_mark().reduce();
    Ok(())
}

fn index(to: &mut Writer, index: &Index) -> Result {
    match index {
        Index::Range { start, stop, step, name } => range(to, *start, *stop, *step, name),
        Index::Column(column, None) => labelled(to, column, &column.label),
        Index::Column(column, Some(freq)) => {
            let class = match column.array.data_type() {
                DataType::Duration(_) => "TimedeltaIndex",
                _ => "DatetimeIndex",
            };
            made_by_name(to, class, |to| {
                to.str("data");
                labelled(to, column, &Value::Null)?;
                to.str("freq");
                offsets::write(to, freq)?;
                to.str("name");
                label(to, &column.label)
            })
        }
        Index::Levels(levels) => made_by_name(to, "MultiIndex", |to| {
            let dictionaries = levels.iter().map(|level| {
                codes(&level.array).ok_or_else(|| {
                    PluginError::unsupported(
                        format!("a level of an index of type {}", level.array.data_type()),
                        "make it a dictionary of its labels",
                    )
                })
            });
            let dictionaries = dictionaries.collect::<Result<Vec<_>>>()?;
            to.str("levels").mark();
            for (level, (_, labels)) in levels.iter().zip(&dictionaries) {
                let (dtype, array) = (level.dtype.clone(), ArrayRef::clone(labels));
                labelled(to, &Column { label: Value::Null, dtype, array }, &level.label)?;
            }
            to.list_since_mark().str("codes").mark();
            for (level, (codes, _)) in levels.iter().zip(&dictionaries) {
                write_codes(to, level.array.data_type(), codes);
            }
            to.list_since_mark().str("names");
            to.list(levels, |to, level| label(to, &level.label)).map(drop)
        }),
    }
}

/// `pandas.Index(values, dtype, copy, name)`.
fn labelled(to: &mut Writer, column: &Column, name: &Value) -> Result {
    to.global("pandas", "Index").mark();
    values(to, column)?;
    dtype(to, column);
    to.bool(false);
    label(to, name)?;
    to.tuple_since_mark().reduce();
    Ok(())
}

/// `_new_Index(class, {argument: value, …})`.
fn made_by_name(
    to: &mut Writer,
    class: &'static str,
    arguments: impl FnOnce(&mut Writer) -> Result,
) -> Result {
    to.global("pandas.core.indexes.base", "_new_Index").global("pandas", class).mark();
    arguments(to)?;
    to.dict_since_mark().tuple(2).reduce();
    Ok(())
}

fn range(to: &mut Writer, start: i64, stop: i64, step: i64, name: &Value) -> Result {
    to.global("pandas", "RangeIndex").mark().int(start).int(stop).int(step).none().bool(false);
    label(to, name)?;
    to.tuple_since_mark().reduce();
    Ok(())
}

fn label(to: &mut Writer, named: &Value) -> Result {
    let levels = match named {
        Value::Tuple(levels) => levels,
        one => std::slice::from_ref(one),
    };
    let is_label = |level: &Value| {
        use Value::{BigInt, Bool, Float, Int, Null, Str};
        matches!(level, Null | Bool(_) | Int(_) | BigInt(_) | Float(_) | Str(_))
    };
    match levels.iter().find(|level| !is_label(level)) {
        None => cells::write(to, named),
        Some(wrong) => Err(PluginError::unsupported(
            format!("a label of type {}", wrong.kind()),
            "use text, a number, None, or a tuple of these",
        )),
    }
}

/// The type to ask for, where pandas would not find it in the values.
fn dtype(to: &mut Writer, column: &Column) {
    let own = match column.array.data_type() {
        _ if column.dtype.ends_with(ARROW) => None,
        DataType::Timestamp(unit, Some(zone)) => Some(zoned(unit_name(*unit), zone)),
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

/// The values of a column as something that pandas takes.
fn values(to: &mut Writer, column: &Column) -> Result {
    let array = &column.array;
    if column.dtype.ends_with(ARROW) {
        return of_pyarrow(to, array);
    }
    if column.dtype.starts_with(PERIOD) && *array.data_type() == DataType::Int64 {
        to.global("pandas.arrays", "PeriodArray");
        times(to, array, "<i8");
        to.global("pandas", "PeriodDtype").str(&column.dtype).tuple(1).reduce().tuple(2).reduce();
        return Ok(());
    }
    if column.dtype.starts_with("object") {
        return objects(to, column);
    }
    if let Some((ends, sides)) = intervals::ends(column) {
        to.global("pandas.arrays", "IntervalArray.from_arrays");
        ends.iter().try_for_each(|end| labelled(to, end, &Value::Null))?;
        to.str(sides).tuple(3).reduce();
        return Ok(());
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
fn plain(to: &mut Writer, column: &Column) -> Result {
    let array = &column.array;
    match array.data_type() {
        DataType::Utf8 | DataType::LargeUtf8 | DataType::Binary | DataType::LargeBinary => {
            return objects(to, column);
        }
        // With a zone the numbers are what pandas takes for instants; times would be local.
        DataType::Timestamp(_, Some(_)) => times(to, array, "<i8"),
        DataType::Timestamp(unit, None) => {
            times(to, array, &format!("<M8[{}]", unit_name(*unit)));
        }
        DataType::Duration(unit) => times(to, array, &format!("<m8[{}]", unit_name(*unit))),
        DataType::Dictionary(..) => return categories(to, column),
        number if matches!(number, DataType::Boolean) || number.is_numeric() => {
            let elements = arrow::elements(array);
            let descr = elements.as_ref().and_then(|elements| elements.dtype().npy_descr());
            let (Some(elements), Some(descr)) = (elements, descr) else {
                return of_pyarrow(to, array);
            };
            to.array(descr, array.len(), elements.data().clone());
        }
        // Types that NumPy has not: lists, structs, decimals, days.
        _ => return of_pyarrow(to, array),
    }
    Ok(())
}

/// pandas's array over one of PyArrow.
fn of_pyarrow(to: &mut Writer, array: &ArrayRef) -> Result {
    to.global("pandas.arrays", "ArrowExtensionArray");
    pyarrow::write_array(to, &array.to_data())?;
    to.tuple(1).reduce();
    Ok(())
}

/// Counts of a unit of time; missing ones are NaT.
fn times(to: &mut Writer, array: &ArrayRef, descr: &str) {
    let counts = arrow::elements(array).and_then(|counts| counts.to_vec()).unwrap_or_default();
    let counts = counts.into_iter().enumerate();
    let counts = counts.map(|(row, count)| if array.is_null(row) { i64::MIN } else { count });
    to.array(descr, array.len(), into_bytes(counts.collect()));
}

/// Python objects, one each.
fn objects(to: &mut Writer, column: &Column) -> Result {
    let array = &column.array;
    if column.dtype == cells::DTYPE {
        let (values, mut written) = (cells::values(array)?, Ok(()));
        to.objects(values.len(), |to| {
            written = values.iter().try_for_each(|value| cells::write(to, value));
        });
        return written;
    }
    let missing = |to: &mut Writer| {
        match column.dtype.as_str() {
            "object(nan)" | "str" => to.float(f64::NAN),
            "object(NA)" => to.global("pandas", "NA"),
            _ => to.none(),
        };
    };
    macro_rules! each {
        ($values:expr, |$to:ident, $value:ident| $write:expr) => {{
            let values = $values;
            to.objects(array.len(), |$to| {
                for value in values.iter() {
                    match value {
                        Some($value) => _ = $write,
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
            return Err(PluginError::unsupported(
                format!("a column {:?} of objects of type {other}", column.label),
                "leave out its dtype, or cast it",
            ));
        }
    }
    Ok(())
}

/// `pandas.Categorical.from_codes(codes, categories, ordered)`.
fn categories(to: &mut Writer, column: &Column) -> Result {
    let data_type = column.array.data_type();
    let (codes, values) = codes(&column.array).ok_or_else(|| {
        PluginError::unsupported(
            format!("categories of type {data_type}"),
            "use codes of int8 to int64",
        )
    })?;
    to.global("pandas", "Categorical.from_codes");
    write_codes(to, data_type, &codes);
    let (name, dtype) = column.dtype.split_once(" of ").unwrap_or((&column.dtype, ""));
    let categories = Column { label: Value::Null, dtype: dtype.to_owned(), array: values };
    labelled(to, &categories, &Value::Null)?;
    to.bool(name == "category(ordered)").tuple(3).reduce();
    Ok(())
}

/// The codes of a dictionary of this type, as wide as they were; unsigned ones have room for -1.
fn write_codes(to: &mut Writer, data_type: &DataType, codes: &[i64]) {
    let key = match data_type {
        DataType::Dictionary(key, _) => &**key,
        other => other,
    };
    let (descr, width) = match key {
        DataType::Int8 => ("|i1", 1),
        DataType::Int16 => ("<i2", 2),
        DataType::Int32 => ("<i4", 4),
        _ => ("<i8", 8),
    };
    let bytes = codes.iter().flat_map(|code| code.to_le_bytes().into_iter().take(width));
    to.array(descr, codes.len(), bytes.collect::<Vec<u8>>().into());
}

/// The codes of a dictionary, -1 where one is missing, and its labels.
fn codes(array: &ArrayRef) -> Option<(Vec<i64>, ArrayRef)> {
    let dictionary = array.as_any_dictionary_opt()?;
    let labels = dictionary.values();
    // No code is valid where there are no labels.
    let codes = if labels.is_empty() { vec![0; array.len()] } else { dictionary.normalized_keys() };
    let codes = codes.into_iter().enumerate().map(|(row, code)| match i64::try_from(code) {
        Ok(code) if array.is_valid(row) => code,
        _ => -1,
    });
    Some((codes.collect(), ArrayRef::clone(labels)))
}
