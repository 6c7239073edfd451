//! Tables in the graph: columns of numbers as tensors, text as lists.
//!
//! ```text
//!   ["table", {"key": "PandasData", "kind": "DataFrame", "rows": 2, "columns": [
//!       {"name": "a", "type": "int64",  "data": tensor 0},
//!       {"name": "s", "type": "utf8",   "data": ["x", null]},
//!       {"name": "t", "type": "timestamp[ns]", "data": tensor 1, "valid": tensor 2},
//!       {"name": "c", "type": "dictionary", "data": tensor 3, "categories": {…}}]}]
//! ```
//!
//! A table with columns that this has no form for (lists, structs, decimals) travels in the form of
//! its plug-in.

use std::sync::Arc;

use arrow_array::builder::{LargeStringBuilder, StringBuilder};
use arrow_array::cast::AsArray as _;
use arrow_array::{
    Array as _, ArrayRef, BooleanArray, RecordBatch, RecordBatchOptions, make_array,
};
use arrow_buffer::{BooleanBuffer, Buffer, NullBuffer};
use arrow_data::ArrayData;
use arrow_schema::{DataType, Field, Schema, TimeUnit};
use bytes::Bytes;

use super::{origin_body, read_origin, text};
use crate::types::{Dtype, Map, Table, Tensor, Value};

/// Types whose values are plain numbers: name, Arrow's type, what a tensor holds.
const NUMBERS: [(&str, DataType, Dtype); 13] = [
    ("int8", DataType::Int8, Dtype::I8),
    ("int16", DataType::Int16, Dtype::I16),
    ("int32", DataType::Int32, Dtype::I32),
    ("int64", DataType::Int64, Dtype::I64),
    ("uint8", DataType::UInt8, Dtype::U8),
    ("uint16", DataType::UInt16, Dtype::U16),
    ("uint32", DataType::UInt32, Dtype::U32),
    ("uint64", DataType::UInt64, Dtype::U64),
    ("float16", DataType::Float16, Dtype::F16),
    ("float32", DataType::Float32, Dtype::F32),
    ("float64", DataType::Float64, Dtype::F64),
    ("date32", DataType::Date32, Dtype::I32),
    ("date64", DataType::Date64, Dtype::I64),
];

/// Deepest nesting of categories.
const MAX_DEPTH: usize = 8;

/// The body of a table; `None` where a column has no form here.
pub(super) fn write(table: &Table) -> Option<Value> {
    let schema = table.batch.schema_ref();
    let columns = schema.fields().iter().zip(table.batch.columns());
    let columns: Option<Vec<Value>> =
        columns.map(|(field, array)| column(field, array, 0).map(Value::from)).collect();
    if !schema.metadata().is_empty() {
        return None;
    }
    let Value::Map(mut body) = origin_body(&table.origin) else { return None };
    body.insert("rows", table.batch.num_rows() as u64);
    body.insert("columns", columns?);
    Some(body.into())
}

fn column(field: &Field, array: &ArrayRef, depth: usize) -> Option<Map> {
    if depth > MAX_DEPTH {
        return None;
    }
    let mut column = Map::new();
    column.insert("name", field.name().as_str());
    for (key, value) in field.metadata() {
        // The one thing that plug-ins note of a column.
        if key != "dtype" {
            return None;
        }
        column.insert("dtype", value.as_str());
    }
    let name = type_name(array.data_type())?;
    column.insert("type", name);
    match array.data_type() {
        DataType::Utf8 => {
            column.insert("data", Value::from_iter(array.as_string::<i32>()));
            return Some(column);
        }
        DataType::LargeUtf8 => {
            column.insert("data", Value::from_iter(array.as_string::<i64>()));
            return Some(column);
        }
        DataType::Boolean => {
            let bytes: Vec<u8> =
                array.as_boolean().iter().map(|value| u8::from(value == Some(true))).collect();
            column.insert("data", Tensor::new(Dtype::Bool, [array.len()], bytes).ok()?);
        }
        DataType::Dictionary(..) => {
            let dictionary = array.as_any_dictionary();
            let keys = make_array(dictionary.keys().to_data());
            column.insert("data", numbers(&keys, depth)?);
            column.insert("codes", type_name(keys.data_type())?);
            let values = Field::new("", dictionary.values().data_type().clone(), true);
            let categories = self::column(&values, dictionary.values(), depth + 1)?;
            column.insert("categories", categories);
        }
        _ => _ = column.insert("data", numbers(array, depth)?),
    }
    if array.null_count() > 0 {
        let valid: Vec<u8> = (0..array.len()).map(|row| u8::from(array.is_valid(row))).collect();
        column.insert("valid", Tensor::new(Dtype::Bool, [array.len()], valid).ok()?);
    }
    Some(column)
}

/// The elements of an array of fixed width, missing ones included.
fn numbers(array: &ArrayRef, _depth: usize) -> Option<Tensor> {
    let dtype = dtype_of(array.data_type())?;
    let data = array.to_data();
    let begin = data.offset().checked_mul(dtype.size())?;
    let length = array.len().checked_mul(dtype.size())?;
    let bytes = data.buffers().first()?.as_slice().get(begin..begin.checked_add(length)?)?;
    Tensor::new(dtype, [array.len()], Bytes::copy_from_slice(bytes)).ok()
}

fn dtype_of(data_type: &DataType) -> Option<Dtype> {
    match data_type {
        DataType::Timestamp(..) | DataType::Duration(_) => Some(Dtype::I64),
        other => NUMBERS.iter().find(|(_, known, _)| known == other).map(|(.., dtype)| *dtype),
    }
}

fn type_name(data_type: &DataType) -> Option<String> {
    let unit = |unit: &TimeUnit| match unit {
        TimeUnit::Second => "s",
        TimeUnit::Millisecond => "ms",
        TimeUnit::Microsecond => "us",
        TimeUnit::Nanosecond => "ns",
    };
    Some(match data_type {
        DataType::Utf8 => "utf8".into(),
        DataType::LargeUtf8 => "large_utf8".into(),
        DataType::Boolean => "bool".into(),
        DataType::Dictionary(..) => "dictionary".into(),
        DataType::Timestamp(of, None) => format!("timestamp[{}]", unit(of)),
        DataType::Timestamp(of, Some(zone)) => format!("timestamp[{}, {zone}]", unit(of)),
        DataType::Duration(of) => format!("duration[{}]", unit(of)),
        other => NUMBERS.iter().find(|(_, known, _)| known == other)?.0.to_owned(),
    })
}

fn type_of(name: &str) -> Option<DataType> {
    if let Some((_, found, _)) = NUMBERS.iter().find(|(known, ..)| *known == name) {
        return Some(found.clone());
    }
    let (kind, rest) = name.split_once('[')?;
    let (unit, zone) = match rest.strip_suffix(']')?.split_once(", ") {
        Some((unit, zone)) => (unit, Some(Arc::from(zone))),
        None => (rest.strip_suffix(']')?, None),
    };
    let unit = match unit {
        "s" => TimeUnit::Second,
        "ms" => TimeUnit::Millisecond,
        "us" => TimeUnit::Microsecond,
        "ns" => TimeUnit::Nanosecond,
        _ => return None,
    };
    match (kind, zone) {
        ("timestamp", zone) => Some(DataType::Timestamp(unit, zone)),
        ("duration", None) => Some(DataType::Duration(unit)),
        _ => None,
    }
}

/// The table that a body describes.
pub(super) fn read(body: &Value) -> Result<Table, String> {
    let map = body.as_map().ok_or_else(|| format!("a {}, no dict", body.kind()))?;
    let rows = map.get("rows").and_then(Value::as_i64).and_then(|rows| usize::try_from(rows).ok());
    let rows = rows.ok_or("rows is no number of rows")?;
    let columns = map.get("columns").and_then(Value::as_items).ok_or("columns is no list")?;
    let (mut fields, mut arrays) = (Vec::new(), Vec::new());
    for (index, column) in columns.iter().enumerate() {
        let (field, array) =
            read_column(column, 0).map_err(|reason| format!("columns[{index}]: {reason}"))?;
        if array.len() != rows {
            return Err(format!("columns[{index}] has {} of {rows} rows", array.len()));
        }
        fields.push(field);
        arrays.push(array);
    }
    let attributes =
        map.iter().filter(|(key, _)| !matches!(key.as_str(), Some("rows" | "columns")));
    let attributes = attributes.map(|(key, value)| (key.clone(), value.clone()));
    let origin = read_origin(&Value::Map(Map::from_iter(attributes)))?;
    let options = RecordBatchOptions::new().with_row_count(Some(rows));
    let batch = RecordBatch::try_new_with_options(Arc::new(Schema::new(fields)), arrays, &options);
    Ok(Table { batch: batch.map_err(|error| error.to_string())?, origin })
}

fn read_column(body: &Value, depth: usize) -> Result<(Field, ArrayRef), String> {
    if depth > MAX_DEPTH {
        return Err(format!("categories nested deeper than {MAX_DEPTH}"));
    }
    let map = body.as_map().ok_or_else(|| format!("a {}, no dict", body.kind()))?;
    let (name, kind) = (text(map, "name")?, text(map, "type")?);
    let data = map.get("data").ok_or("data is missing")?;
    let valid = map.get("valid").map(validity).transpose()?;
    let array: ArrayRef = match kind.as_str() {
        "utf8" => {
            let mut builder = StringBuilder::new();
            texts(data, |text| builder.append_option(text))?;
            Arc::new(builder.finish())
        }
        "large_utf8" => {
            let mut builder = LargeStringBuilder::new();
            texts(data, |text| builder.append_option(text))?;
            Arc::new(builder.finish())
        }
        "bool" => {
            let bits = tensor(data, Dtype::Bool)?.data().iter().map(|&byte| byte != 0);
            let bits: BooleanBuffer = bits.collect();
            if valid.as_ref().is_some_and(|valid| valid.len() != bits.len()) {
                return Err("valid has another length than data".into());
            }
            Arc::new(BooleanArray::new(bits, valid))
        }
        "dictionary" => {
            let codes = text(map, "codes")?;
            let codes = type_of(&codes).ok_or_else(|| format!("codes of type {codes:?}"))?;
            let categories = map.get("categories").ok_or("categories are missing")?;
            let (field, values) = read_column(categories, depth + 1)?;
            let keys = fixed(data, &codes, valid)?;
            let whole = DataType::Dictionary(Box::new(codes), Box::new(field.data_type().clone()));
            let data = keys.into_builder().data_type(whole).add_child_data(values.to_data());
            make_array(data.build().map_err(|error| error.to_string())?)
        }
        other => {
            let data_type = type_of(other).ok_or_else(|| format!("type {other:?} is not known"))?;
            make_array(fixed(data, &data_type, valid)?)
        }
    };
    let field = Field::new(name, array.data_type().clone(), true);
    Ok(match map.get("dtype").and_then(Value::as_str) {
        Some(dtype) => (field.with_metadata([("dtype", dtype)]), array),
        None => (field, array),
    })
}

fn texts(data: &Value, mut append: impl FnMut(Option<&str>)) -> Result<(), String> {
    for item in data.as_items().ok_or("data is no list of text")? {
        match item {
            Value::Str(text) => append(Some(text)),
            Value::Null => append(None),
            other => return Err(format!("data has a {} among its text", other.kind())),
        }
    }
    Ok(())
}

fn tensor(data: &Value, dtype: Dtype) -> Result<&Tensor, String> {
    let tensor = data.as_tensor().filter(|tensor| tensor.dtype() == dtype);
    let tensor = tensor.filter(|tensor| tensor.shape().len() == 1);
    tensor.ok_or_else(|| format!("data is no list of {dtype}"))
}

fn validity(valid: &Value) -> Result<NullBuffer, String> {
    Ok(NullBuffer::from_iter(tensor(valid, Dtype::Bool)?.data().iter().map(|&byte| byte != 0)))
}

/// An array of fixed width over the bytes of a tensor.
fn fixed(
    data: &Value,
    data_type: &DataType,
    valid: Option<NullBuffer>,
) -> Result<ArrayData, String> {
    let dtype = dtype_of(data_type).ok_or_else(|| format!("{data_type} is no number"))?;
    let tensor = tensor(data, dtype)?;
    if valid.as_ref().is_some_and(|valid| valid.len() != tensor.element_count()) {
        return Err("valid has another length than data".into());
    }
    ArrayData::builder(data_type.clone())
        .len(tensor.element_count())
        .add_buffer(Buffer::from(tensor.data().clone()))
        .nulls(valid)
        .align_buffers(true)
        .build()
        .map_err(|error| error.to_string())
}
