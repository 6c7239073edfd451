//! Frames as pandas's JSON: `PandasLegacyData` and the frames of dask.
//!
//! ```text
//!   split    {"columns": ["a"], "index": [0, 1], "data": [[1], [2]]}     legacy
//!   records  [{"index": 0, "a": 1}, {"index": 1, "a": 2}]                dask
//! ```
//!
//! JSON has no types of columns: numbers, bools and text are found again, anything else is refused.
//! Times are written as pandas writes them by default, milliseconds since 1970, and come back as
//! numbers; missing numbers make a column of floats.

use std::sync::Arc;

use arrow_array::{ArrayRef, BooleanArray, Float64Array, Int64Array, StringArray};

use super::super::{Body, Part, PluginError, Plugins, Unpacking};
use super::frame::{Column, Frame, Index, Kind, range_labels};
use super::{cells, labels};
use crate::malformed;
use wrapyfi_data::codec::json;
use wrapyfi_data::types::{Map, Value};

type Result<T> = std::result::Result<T, PluginError>;

/// Reads parts `text, "DataFrame" or "Series"`.
pub(super) fn read_split(body: &Body<'_>, context: &Unpacking<'_>) -> Result<Frame> {
    let value =
        json::decode(&body.base64(0)?, context.limits, &Plugins::none()).map_err(malformed)?;
    let text = body.text(1)?;
    let kind = Kind::from_name(&text).filter(|&kind| kind != Kind::Index);
    let kind = kind.ok_or_else(|| malformed(format!("{text:?} is no DataFrame and no Series")))?;
    let list = |key: &str| {
        let found = value.get(key).and_then(Value::as_items);
        found.ok_or_else(|| malformed(format!("{key} is missing or no list")))
    };
    let (names, rows) = (list("columns")?, list("data")?);
    let mut cells: Vec<Vec<&Value>> = vec![Vec::new(); names.len()];
    for row in rows {
        let row = row.as_items().filter(|row| row.len() == names.len());
        let row = row.ok_or_else(|| malformed("data has a row of another length than columns"))?;
        for (column, cell) in cells.iter_mut().zip(row) {
            column.push(cell);
        }
    }
    let columns = names.iter().zip(&cells).map(|(name, cells)| column(name.clone(), cells));
    let columns = columns.collect::<Result<Vec<_>>>()?;
    let index = index(list("index")?)?;
    if index.len() != rows.len() {
        return Err(malformed(format!("{} labels for {} rows", index.len(), rows.len())));
    }
    frame(kind, index, columns)
}

/// Writes what [`read_split`] reads.
pub(super) fn write_split(frame: &Frame) -> Result<Vec<Part>> {
    let columns = cells(&frame.columns)?;
    let rows = (0..frame.index.len()).map(|row| {
        Value::from_iter(columns.iter().map(|cells| cells.get(row).cloned().unwrap_or_default()))
    });
    let names = frame.columns.iter().map(|column| column.label.clone());
    let value = Value::Map(Map::from_iter([
        ("columns", Value::from_iter(names)),
        ("index", Value::List(index_values(&frame.index)?)),
        ("data", Value::from_iter(rows)),
    ]));
    if frame.kind == Kind::Index {
        return Err(only_frames());
    }
    Ok(vec![Part::base64(encode(&value)?), Part::Text(frame.kind.name().into())])
}

/// Reads records whose first member is the index.
pub(crate) fn read_records(
    file: &bytes::Bytes,
    is_series: bool,
    context: &Unpacking<'_>,
) -> Result<wrapyfi_data::types::Table> {
    let value = json::decode(file, context.limits, &Plugins::none()).map_err(malformed)?;
    let records = value.as_items().ok_or_else(|| malformed("no list of records"))?;
    let names: Vec<Value> = match records.first().map(Value::as_map) {
        Some(Some(first)) => first.iter().map(|(name, _)| name.clone()).collect(),
        Some(None) => return Err(malformed("a record that is no dict")),
        None => Vec::new(),
    };
    let mut cells: Vec<Vec<&Value>> = vec![Vec::new(); names.len()];
    for record in records {
        let record = record.as_map().filter(|record| record.len() == names.len());
        let record = record.ok_or_else(|| malformed("records with different members"))?;
        for ((column, name), (key, cell)) in cells.iter_mut().zip(&names).zip(record.iter()) {
            if key != name {
                return Err(malformed("records with different members"));
            }
            column.push(cell);
        }
    }
    let (index_name, index_cells) = match (names.first(), cells.first()) {
        (Some(name), Some(cells)) => (name.clone(), cells.clone()),
        _ => (Value::Null, Vec::new()),
    };
    let owned: Vec<Value> = index_cells.into_iter().cloned().collect();
    let mut index = index(&owned)?;
    // `index` is what pandas calls an index without a name.
    let name = if index_name.as_str() == Some("index") { Value::Null } else { index_name };
    match &mut index {
        Index::Range { name: unnamed, .. } => *unnamed = name,
        Index::Column(column, _) => column.label = name,
        Index::Levels(_) => {}
    }
    let columns = names.iter().zip(&cells).skip(1);
    let columns = columns.map(|(name, cells)| column(name.clone(), cells));
    let kind = if is_series { Kind::Series } else { Kind::Frame };
    frame(kind, index, columns.collect::<Result<_>>()?)?.into_table("DaskData")
}

/// Writes what [`read_records`] reads; and whether it is a series.
pub(crate) fn write_records(table: &wrapyfi_data::types::Table) -> Result<(Vec<u8>, bool)> {
    let frame = Frame::from_table(table)?;
    if frame.kind == Kind::Index {
        return Err(only_frames());
    }
    let columns = cells(&frame.columns)?;
    let index = index_values(&frame.index)?;
    let name = match &frame.index {
        Index::Range { name, .. } => name.clone(),
        Index::Column(column, _) => column.label.clone(),
        Index::Levels(_) => return Err(only_one_level()),
    };
    let name = if name == Value::Null { "index".into() } else { name };
    let records = index.into_iter().enumerate().map(|(row, label)| {
        let cells = columns.iter().map(|cells| cells.get(row).cloned().unwrap_or_default());
        let pairs = frame.columns.iter().map(|column| column.label.clone()).zip(cells);
        Map::from_iter(std::iter::once((name.clone(), label)).chain(pairs))
    });
    Ok((encode(&Value::from_iter(records))?, frame.kind == Kind::Series))
}

fn frame(kind: Kind, index: Index, columns: Vec<Column>) -> Result<Frame> {
    if kind == Kind::Series && columns.len() != 1 {
        return Err(malformed(format!("a series of {} columns", columns.len())));
    }
    Ok(Frame { kind, index, columns, columns_name: Value::Null })
}

fn only_frames() -> PluginError {
    PluginError::unsupported("an index on its own", "make a series or a data frame of it")
}

fn only_one_level() -> PluginError {
    PluginError::unsupported(
        "an index of several levels in JSON",
        "make columns of it with reset_index()",
    )
}

/// JSON without NaN, which pandas writes as null.
fn encode(value: &Value) -> Result<Vec<u8>> {
    json::encode(value, &Plugins::none())
        .map_err(|error| PluginError::unsupported("a label or value", error.to_string()))
}

/// The cells of every column.
fn cells(columns: &[Column]) -> Result<Vec<Vec<Value>>> {
    columns
        .iter()
        .map(|column| {
            if column.dtype == cells::DTYPE {
                return cells::values(&column.array);
            }
            let cells = labels::values(&column.array).ok_or_else(|| {
                PluginError::unsupported(
                    format!("a column of type {} in JSON", column.array.data_type()),
                    "cast it to numbers, bools or text",
                )
            })?;
            let nan_is_null = |cell| match cell {
                Value::Float(float) if !float.is_finite() => Value::Null,
                other => other,
            };
            Ok(cells.into_iter().map(nan_is_null).collect())
        })
        .collect()
}

fn index_values(index: &Index) -> Result<Vec<Value>> {
    match index {
        Index::Range { start, stop, step, .. } => {
            Ok(range_labels(*start, *stop, *step).map(Value::Int).collect())
        }
        Index::Levels(_) => Err(only_one_level()),
        Index::Column(column, _) => {
            let only = std::slice::from_ref(&**column);
            Ok(cells(only)?.pop().unwrap_or_default())
        }
    }
}

/// Labels 0, 1, 2, … are a range, anything else a column.
fn index(labels: &[Value]) -> Result<Index> {
    let rows = i64::try_from(labels.len()).unwrap_or(i64::MAX);
    if labels.iter().zip(0..rows).all(|(label, n)| *label == Value::Int(n)) {
        return Ok(Index::Range { start: 0, stop: rows, step: 1, name: Value::Null });
    }
    let labels: Vec<&Value> = labels.iter().collect();
    column(Value::Null, &labels).map(|column| Index::Column(Box::new(column), None))
}

/// A column of what its cells are: integers, numbers, bools or text.
fn column(label: Value, cells: &[&Value]) -> Result<Column> {
    let all = |fits: fn(&Value) -> bool| cells.iter().all(|cell| fits(cell));
    let (array, dtype): (ArrayRef, _) = if all(|cell| matches!(cell, Value::Int(_)))
        && !cells.is_empty()
    {
        (Arc::new(cells.iter().filter_map(|cell| cell.as_i64()).collect::<Int64Array>()), "int64")
    } else if all(|cell| matches!(cell, Value::Int(_) | Value::Float(_) | Value::Null)) {
        let numbers = cells.iter().map(|cell| cell.as_f64().unwrap_or(f64::NAN));
        (Arc::new(Float64Array::from_iter_values(numbers)), "float64")
    } else if all(|cell| matches!(cell, Value::Bool(_))) {
        (Arc::new(cells.iter().map(|cell| cell.as_bool()).collect::<BooleanArray>()), "bool")
    } else if all(|cell| matches!(cell, Value::Str(_) | Value::Null)) {
        (Arc::new(cells.iter().map(|cell| cell.as_str()).collect::<StringArray>()), "object")
    } else {
        (cells::of(cells)?, cells::DTYPE)
    };
    Ok(Column { label, dtype: dtype.into(), array })
}
