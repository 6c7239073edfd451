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
//! A list has `offsets` into its `items`, which are a column, or a `size`; a struct has `fields`,
//! which are columns; binary data has `offsets` into its bytes:
//!
//! ```text
//!   {"name": "l", "type": "list", "offsets": tensor 4, "items": {"name": "item", "type": "int64", …}}
//!   {"name": "p", "type": "struct", "fields": [{"name": "x", …}, {"name": "y", …}], "valid": tensor 5}
//! ```
//!
//! Decimals are text: `{"type": "decimal128(5, 2)", "data": ["1.50", null]}`. A map is a list whose items are structs of
//! key and value. Columns of objects have the JSON of each as text, with the `dtype` `object(json)`; intervals are structs
//! of `left` and `right`, and their `dtype` says which sides belong to them: `interval[int64, right]`.
//!
//! A table with columns that this has no form for (unions, views) travels in the form of its plug-in.

use std::collections::HashMap;
use std::sync::Arc;

use arrow_array::cast::AsArray as _;
use arrow_array::types::{Decimal128Type, DecimalType as _};
use arrow_array::{
    Array as _, ArrayRef, BinaryArray, Decimal128Array, FixedSizeListArray, LargeListArray,
    LargeStringArray, ListArray, MapArray, NullArray, OffsetSizeTrait, StringArray, StructArray,
    make_array,
};
use arrow_buffer::{ArrowNativeType as _, Buffer, NullBuffer, OffsetBuffer};
use arrow_data::ArrayData;
use arrow_schema::{ArrowError, DataType, Field, Schema};
use bytes::Bytes;

use super::{origin_body, read_origin, text};
use crate::types::arrow::{self, unit_name};
use crate::types::{Dtype, Element, Map, Table, Tensor, Value};

/// Between the type of categories and what they are.
const OF: &str = " of ";
/// Types of columns by the names that pandas's plug-in gives them.
const OBJECTS: &str = "object(json)";
const INTERVALS: &str = "interval[";
/// Deepest nesting of categories, lists and structs.
const MAX_DEPTH: usize = 16;

/// The body of a table; `None` where a column has no form here.
pub(super) fn write(table: &Table) -> Option<Value> {
    let schema = table.batch.schema_ref();
    let columns = schema.fields().iter().zip(table.batch.columns());
    let columns: Option<Vec<Value>> =
        columns.map(|(field, array)| column(field, array, 0).map(Value::from)).collect();
    let Value::Map(mut body) = origin_body(&table.origin) else { return None };
    body.insert("rows", table.batch.num_rows() as u64);
    body.insert("columns", columns?);
    if !schema.metadata().is_empty() {
        let mut metadata: Vec<_> = schema.metadata().iter().collect();
        metadata.sort();
        let metadata =
            metadata.into_iter().map(|(key, text)| (key.as_str(), Value::from(text.as_str())));
        body.insert("metadata", Map::from_iter(metadata));
    }
    Some(body.into())
}

fn column(field: &Field, array: &ArrayRef, depth: usize) -> Option<Map> {
    if depth > MAX_DEPTH {
        return None;
    }
    let mut column = Map::new();
    column.insert("name", field.name().as_str());
    for (key, value) in field.metadata() {
        // `dtype` is the only metadata that plug-ins keep of a column.
        if key != "dtype" {
            return None;
        }
        column.insert("dtype", value.as_str());
    }
    column.insert("type", type_name(array.data_type())?);
    if !field.is_nullable() {
        column.insert("nullable", false);
    }
    match array.data_type() {
        DataType::Utf8 => {
            column.insert("data", Value::from_iter(array.as_string::<i32>()));
            return Some(column);
        }
        DataType::LargeUtf8 => {
            column.insert("data", Value::from_iter(array.as_string::<i64>()));
            return Some(column);
        }
        DataType::Decimal128(..) => {
            let numbers = array.as_primitive::<Decimal128Type>();
            let text = |row| numbers.is_valid(row).then(|| numbers.value_as_string(row));
            column.insert("data", Value::from_iter((0..numbers.len()).map(text)));
            return Some(column);
        }
        DataType::Dictionary(..) => {
            let dictionary = array.as_any_dictionary();
            let keys = make_array(dictionary.keys().to_data());
            column.insert("data", arrow::elements(&keys)?);
            column.insert("codes", type_name(keys.data_type())?);
            let mut values = Field::new("", dictionary.values().data_type().clone(), true);
            // What the categories are stands behind the type of the column.
            let dtype =
                column.get("dtype").and_then(Value::as_str).and_then(|it| it.split_once(OF));
            if let Some((name, of)) = dtype {
                let (name, of) = (name.to_owned(), of.to_owned());
                values = values.with_metadata([("dtype".to_owned(), of)]);
                column.insert("dtype", name);
            }
            let categories = self::column(&values, dictionary.values(), depth + 1)?;
            column.insert("categories", categories);
        }
        DataType::Null => {}
        DataType::List(item) => {
            let list = array.as_list::<i32>();
            let (offsets, items) = bounded(list.offsets(), list.values())?;
            column.insert("offsets", numbers(offsets)?);
            column.insert("items", self::column(item, &items, depth + 1)?);
        }
        DataType::Map(entries, false) => {
            let map = array.as_map();
            let items: ArrayRef = Arc::new(map.entries().clone());
            let (offsets, items) = bounded(map.offsets(), &items)?;
            column.insert("offsets", numbers(offsets)?);
            column.insert("items", self::column(entries, &items, depth + 1)?);
        }
        DataType::LargeList(item) => {
            let list = array.as_list::<i64>();
            let (offsets, items) = bounded(list.offsets(), list.values())?;
            column.insert("offsets", numbers(offsets)?);
            column.insert("items", self::column(item, &items, depth + 1)?);
        }
        DataType::FixedSizeList(item, size) => {
            column.insert("size", *size);
            let items = array.as_fixed_size_list().values();
            column.insert("items", self::column(item, items, depth + 1)?);
        }
        DataType::Struct(fields) => {
            let columns = fields.iter().zip(array.as_struct().columns());
            let columns = columns
                .map(|(field, array)| self::column(field, array, depth + 1).map(Value::from));
            column.insert("fields", columns.collect::<Option<Vec<Value>>>()?);
        }
        DataType::Binary => {
            let binary = array.as_binary::<i32>();
            let (first, last) = (binary.offsets().first(), binary.offsets().last());
            let offsets: Vec<i32> = binary.offsets().iter().map(|at| at - first).collect();
            column.insert("offsets", numbers(offsets)?);
            let bytes = binary.value_data().get(first.as_usize()..last.as_usize())?;
            let bytes = Bytes::copy_from_slice(bytes);
            column.insert("data", Tensor::new(Dtype::U8, [bytes.len()], bytes).ok()?);
        }
        _ => _ = column.insert("data", arrow::elements(array)?),
    }
    if array.null_count() > 0 && *array.data_type() != DataType::Null {
        let valid: Vec<u8> = (0..array.len()).map(|row| u8::from(array.is_valid(row))).collect();
        column.insert("valid", Tensor::new(Dtype::Bool, [array.len()], valid).ok()?);
    }
    Some(column)
}

/// Offsets from 0 on, and the part of the items that they mean.
fn bounded<O: OffsetSizeTrait>(
    offsets: &OffsetBuffer<O>,
    items: &ArrayRef,
) -> Option<(Vec<O>, ArrayRef)> {
    let (first, last) = (offsets.first(), offsets.last());
    let length = last.as_usize().checked_sub(first.as_usize())?;
    Some((offsets.iter().map(|at| *at - first).collect(), items.slice(first.as_usize(), length)))
}

fn numbers<O: Element>(offsets: Vec<O>) -> Option<Tensor> {
    Tensor::from_elements(&[offsets.len()], offsets).ok()
}

fn type_name(data_type: &DataType) -> Option<String> {
    Some(match data_type {
        DataType::Utf8 => "utf8".into(),
        DataType::LargeUtf8 => "large_utf8".into(),
        DataType::Dictionary(..) => "dictionary".into(),
        DataType::Null => "null".into(),
        DataType::List(_) => "list".into(),
        DataType::LargeList(_) => "large_list".into(),
        DataType::Map(..) => "map".into(),
        DataType::Decimal128(precision, scale) => format!("decimal128({precision}, {scale})"),
        DataType::FixedSizeList(..) => "fixed_size_list".into(),
        DataType::Struct(_) => "struct".into(),
        DataType::Binary => "binary".into(),
        DataType::Timestamp(of, None) => format!("timestamp[{}]", unit_name(*of)),
        DataType::Timestamp(of, Some(zone)) => format!("timestamp[{}, {zone}]", unit_name(*of)),
        DataType::Duration(of) => format!("duration[{}]", unit_name(*of)),
        other => arrow::number_name(other)?.to_owned(),
    })
}

fn type_of(name: &str) -> Option<DataType> {
    if let Some(found) = arrow::number_type(name) {
        return Some(found);
    }
    let (kind, rest) = name.split_once('[')?;
    let (unit, zone) = match rest.strip_suffix(']')?.split_once(", ") {
        Some((unit, zone)) => (unit, Some(Arc::from(zone))),
        None => (rest.strip_suffix(']')?, None),
    };
    let unit = arrow::unit(unit)?;
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
            read_column(column, rows, 0).map_err(|reason| format!("columns[{index}]: {reason}"))?;
        if array.len() != rows {
            return Err(format!("columns[{index}] has {} of {rows} rows", array.len()));
        }
        fields.push(field);
        arrays.push(array);
    }
    let metadata = match map.get("metadata") {
        None => HashMap::new(),
        Some(metadata) => {
            let metadata = metadata.as_map().ok_or("metadata is no dict")?.iter();
            let text = |value: &Value| value.as_str().map(str::to_owned);
            let metadata = metadata.map(|(key, value)| Some((text(key)?, text(value)?)));
            metadata.collect::<Option<_>>().ok_or("metadata is no dict of text")?
        }
    };
    let attributes = map
        .iter()
        .filter(|(key, _)| !matches!(key.as_str(), Some("rows" | "columns" | "metadata")));
    let attributes = attributes.map(|(key, value)| (key.clone(), value.clone()));
    let origin = read_origin(&Value::Map(Map::from_iter(attributes)))?;
    let batch = arrow::batch(Schema::new(fields).with_metadata(metadata), arrays, rows);
    Ok(Table { batch: batch.map_err(|error| error.to_string())?, origin })
}

/// A column; `rows` is the length of one that says nothing of its own.
fn read_column(body: &Value, rows: usize, depth: usize) -> Result<(Field, ArrayRef), String> {
    if depth > MAX_DEPTH {
        return Err(format!("columns nested deeper than {MAX_DEPTH}"));
    }
    let map = body.as_map().ok_or_else(|| format!("a {}, no dict", body.kind()))?;
    let (name, kind) = (text(map, "name")?, text(map, "type")?);
    let member = |key: &str| map.get(key).ok_or_else(|| format!("{key} is missing"));
    let valid = map.get("valid").map(validity).transpose()?;
    if let Some(array) = nested(&kind, &member, valid.clone(), rows, depth)? {
        return Ok((field(map, name, &array), array));
    }
    let data = member("data")?;
    let mut of = None;
    let array: ArrayRef = match kind.as_str() {
        "utf8" => Arc::new(StringArray::from(texts(data)?)),
        "large_utf8" => Arc::new(LargeStringArray::from(texts(data)?)),
        "dictionary" => {
            let codes = text(map, "codes")?;
            let codes = type_of(&codes).ok_or_else(|| format!("codes of type {codes:?}"))?;
            let categories = map.get("categories").ok_or("categories are missing")?;
            let (field, values) = read_column(categories, 0, depth + 1)?;
            of = field.metadata().get("dtype").cloned();
            let keys = fixed(data, &codes, valid)?;
            let whole = DataType::Dictionary(Box::new(codes), Box::new(field.data_type().clone()));
            let data = keys.into_builder().data_type(whole).add_child_data(values.to_data());
            make_array(data.build().map_err(|error| error.to_string())?)
        }
        decimal if decimal.starts_with("decimal128(") => {
            decimals(data, decimal).ok_or_else(|| format!("{decimal} with other data"))?
        }
        other => {
            let data_type = type_of(other).ok_or_else(|| format!("type {other:?} is not known"))?;
            make_array(fixed(data, &data_type, valid)?)
        }
    };
    let field = field(map, name, &array);
    let of = of.filter(|of| *of == OBJECTS || of.starts_with(INTERVALS));
    let Some((dtype, of)) = field.metadata().get("dtype").cloned().zip(of) else {
        return Ok((field, array));
    };
    Ok((field.with_metadata([("dtype".to_owned(), dtype + OF + &of)]), array))
}

/// Decimal numbers from their text.
fn decimals(data: &Value, kind: &str) -> Option<ArrayRef> {
    let (precision, scale) =
        kind.strip_prefix("decimal128(")?.strip_suffix(')')?.split_once(", ")?;
    let (precision, scale) = (precision.parse().ok()?, scale.parse().ok()?);
    let numbers = texts(data).ok()?.into_iter();
    let numbers =
        numbers.map(|text| text.map(|text| arrow::decimal(text, scale).ok_or(())).transpose());
    let numbers = numbers.collect::<Result<Decimal128Array, ()>>().ok()?;
    let numbers = numbers.with_precision_and_scale(precision, scale).ok()?;
    // Arrow's own check takes a negative scale for a large one.
    let fits = |number| Decimal128Type::is_valid_decimal_precision(number, precision);
    numbers.iter().flatten().all(fits).then(|| Arc::new(numbers) as ArrayRef)
}

fn field(map: &Map, name: String, array: &ArrayRef) -> Field {
    let nullable = map.get("nullable").and_then(Value::as_bool) != Some(false);
    let field = Field::new(name, array.data_type().clone(), nullable);
    match map.get("dtype").and_then(Value::as_str) {
        Some(dtype) => field.with_metadata([("dtype", dtype)]),
        None => field,
    }
}

/// A column made of others, or without elements; nothing for any other.
fn nested<'a>(
    kind: &str,
    member: &dyn Fn(&str) -> Result<&'a Value, String>,
    valid: Option<NullBuffer>,
    rows: usize,
    depth: usize,
) -> Result<Option<ArrayRef>, String> {
    let items = |rows| read_column(member("items")?, rows, depth + 1);
    let length = |what: &str| {
        let valid = valid.as_ref().map_or(rows, NullBuffer::len);
        if valid == rows { Ok(rows) } else { Err(format!("valid has {valid} of {rows} {what}")) }
    };
    let wrong = |error: ArrowError| error.to_string();
    Ok(Some(match kind {
        "null" => Arc::new(NullArray::new(rows)),
        "list" => {
            let offsets = offsets::<i32>(member("offsets")?)?;
            let (field, items) = items(offsets.last().as_usize())?;
            Arc::new(ListArray::try_new(field.into(), offsets, items, valid).map_err(wrong)?)
        }
        "large_list" => {
            let offsets = offsets::<i64>(member("offsets")?)?;
            let (field, items) = items(offsets.last().as_usize())?;
            Arc::new(LargeListArray::try_new(field.into(), offsets, items, valid).map_err(wrong)?)
        }
        "map" => {
            let offsets = offsets::<i32>(member("offsets")?)?;
            let (field, items) = items(offsets.last().as_usize())?;
            let entries =
                items.as_struct_opt().ok_or("items of a map that are no structs")?.clone();
            let field = field.with_nullable(false);
            let array = MapArray::try_new(field.into(), offsets, entries, valid, false);
            Arc::new(array.map_err(wrong)?)
        }
        "fixed_size_list" => {
            let size = member("size")?.as_i64().and_then(|size| i32::try_from(size).ok());
            let size = size.filter(|size| *size >= 0).ok_or("size is no number from 0 on")?;
            let rows = length("lists")?;
            let (field, items) = items(rows.saturating_mul(size.as_usize()))?;
            let array =
                FixedSizeListArray::try_new_with_length(field.into(), size, items, valid, rows);
            Arc::new(array.map_err(wrong)?)
        }
        "struct" => {
            let columns = member("fields")?.as_items().ok_or("fields is no list")?;
            let columns = columns.iter().map(|column| read_column(column, rows, depth + 1));
            let (fields, arrays): (Vec<_>, Vec<_>) =
                columns.collect::<Result<Vec<_>, _>>()?.into_iter().unzip();
            // Categories have as many rows as their fields have.
            let rows = arrays.first().map_or(rows, |array: &ArrayRef| array.len());
            let array = StructArray::try_new_with_length(fields.into(), arrays, valid, rows);
            Arc::new(array.map_err(wrong)?)
        }
        "binary" => {
            let offsets = offsets::<i32>(member("offsets")?)?;
            let bytes = Buffer::from(tensor(member("data")?, Dtype::U8)?.data().clone());
            Arc::new(BinaryArray::try_new(offsets, bytes, valid).map_err(wrong)?)
        }
        _ => return Ok(None),
    }))
}

/// Offsets that are not negative and never fall.
fn offsets<O: OffsetSizeTrait + Element>(value: &Value) -> Result<OffsetBuffer<O>, String> {
    let offsets: Vec<O> = tensor(value, O::DTYPE)?.to_vec().unwrap_or_default();
    let rising = offsets.windows(2).all(|pair| pair.first() <= pair.last());
    if !rising || offsets.first().is_none_or(|first| *first < O::usize_as(0)) {
        return Err("offsets are no numbers from 0 on that never fall".into());
    }
    Ok(OffsetBuffer::new(offsets.into()))
}

fn texts(data: &Value) -> Result<Vec<Option<&str>>, String> {
    let items = data.as_items().ok_or("data is no list of text")?.iter();
    let texts = items.map(|item| match item {
        Value::Str(text) => Ok(Some(text.as_str())),
        Value::Null => Ok(None),
        other => Err(format!("data has a {} among its text", other.kind())),
    });
    texts.collect()
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
    let dtype = arrow::dtype_of(data_type).ok_or_else(|| format!("{data_type} is no number"))?;
    let tensor = tensor(data, dtype)?;
    if valid.as_ref().is_some_and(|valid| valid.len() != tensor.element_count()) {
        return Err("valid has another length than data".into());
    }
    arrow::fixed(data_type.clone(), tensor.element_count(), tensor.data().clone(), valid)
        .map_err(|error| error.to_string())
}
