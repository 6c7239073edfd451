//! Values of blocks and indices: NumPy arrays and pandas's own arrays, into Arrow arrays.
//!
//! ```text
//!   ndarray ──────────────── one column, or one for each of its rows
//!   DatetimeArray, TimedeltaArray, Categorical, StringArray   an ndarray and a dtype
//!   IntegerArray, FloatingArray, BooleanArray                 values and a mask
//!   ArrowStringArray, ArrowExtensionArray                     an array of PyArrow
//!   PeriodArray                                               an ndarray of counts and a dtype
//!   IntervalArray                                             two arrays, of the ends
//! ```

use std::sync::Arc;

use arrow_array::cast::AsArray as _;
use arrow_array::types::Int64Type;
use arrow_array::{
    Array as _, ArrayRef, DictionaryArray, Int8Array, Int16Array, Int32Array, Int64Array,
    make_array,
};
use arrow_buffer::NullBuffer;
use arrow_schema::DataType;
use bytes::Bytes;

use super::super::budget::Budget;
use super::super::pyarrow;
use super::frame::{Column, Index, range_labels, range_length};
use super::index::index;
use super::{cells, intervals, objects};
use crate::pickle::{Node, PickleCall, PickleError, PickledArray, View};
use wrapyfi_data::types::{Dtype, NumpyArray, Tensor, arrow};

type Result<T> = std::result::Result<T, PickleError>;

/// An array with pandas's name of its type.
pub(super) type Typed = (ArrayRef, String);

/// Reads the values of a block or an index: a column for each row of a two-dimensional array.
pub(super) fn columns(node: &Node<'_>, budget: &Budget) -> Result<Vec<Typed>> {
    if node.is_array() {
        return from_numpy(node, budget, None);
    }
    let call = node.any_call()?;
    match call.global().name {
        "__pyx_unpickle_NDArrayBacked" => backed(node, &call, budget),
        "IntegerArray" | "FloatingArray" | "BooleanArray" => {
            masked(node, &call, budget).map(|one| vec![one])
        }
        "Categorical.from_codes" => from_codes(&call, budget).map(|one| vec![one]),
        "ArrowStringArray" => {
            let array = pyarrow::array(&arrow_values(&call)?, budget)?;
            let state = call.state()?.dict()?;
            let dtype = string_dtype(state.find("_dtype").or_else(|| state.find("dtype")));
            Ok(vec![(array, dtype)])
        }
        "ArrowExtensionArray" => {
            let array = pyarrow::array(&arrow_values(&call)?, budget)?;
            let dtype = format!("{}{ARROW}", pyarrow::type_name(array.data_type()));
            Ok(vec![(array, dtype)])
        }
        "__pyx_unpickle_IntervalMixin" | "IntervalArray.from_arrays" => {
            intervals::read(node, &call, budget).map(|one| vec![one])
        }
        "PeriodArray" => periods(&call.arg(0)?, &call.arg(1)?, budget),
        _ => Err(node.unexpected("an array of pandas that is read here")),
    }
}

/// Exactly one column.
pub(super) fn column(node: &Node<'_>, budget: &Budget) -> Result<Typed> {
    let one = <[Typed; 1]>::try_from(columns(node, budget)?);
    one.map(|[one]| one).map_err(|_rows| node.unexpected("an array of one dimension"))
}

/// Values as a type that is asked for.
pub(super) fn typed(values: &Node<'_>, dtype: &Node<'_>, budget: &Budget) -> Result<Typed> {
    let asked = dtype.option().map(|dtype| dtype.str()).transpose()?;
    if let View::List(items) = values.view() {
        let items: Vec<_> = items.iter().collect();
        let (array, dtype) = objects::array(values, &items, budget)?;
        let dtype = if dtype == cells::DTYPE { dtype } else { "object" };
        return Ok((array, dtype.into()));
    }
    let (array, found) = column(values, budget)?;
    match (asked, array.data_type()) {
        // Objects are asked for by name; text that is not has the type of pandas 3.
        (None, DataType::Utf8) if found.starts_with("object") => Ok((array, "str".into())),
        (Some("string"), DataType::Utf8) => Ok((array, "string".into())),
        (Some(zoned), DataType::Int64) if zoned.starts_with("datetime64[") => {
            let array =
                in_zone(&array, zoned).ok_or_else(|| dtype.unexpected("a time with a zone"))?;
            Ok((array, zoned.to_owned()))
        }
        _ => Ok((array, found)),
    }
}

/// Instants in UTC as times of a zone: `datetime64[ns, Europe/Berlin]`.
fn in_zone(array: &ArrayRef, dtype: &str) -> Option<ArrayRef> {
    let (unit, zone) = dtype.strip_prefix("datetime64[")?.strip_suffix(']')?.split_once(", ")?;
    let zone = zone.strip_prefix("UTC").filter(|offset| !offset.is_empty()).unwrap_or(zone);
    let nulls = not_a_time(array.as_primitive::<Int64Type>().values().iter().copied());
    let zoned = DataType::Timestamp(arrow::unit(unit)?, Some(zone.into()));
    array.to_data().into_builder().data_type(zoned).nulls(nulls).build().ok().map(make_array)
}

/// `__pyx_unpickle_NDArrayBacked(class, checksum, None)`, state `(dtype, ndarray, …)`.
fn backed(node: &Node<'_>, call: &PickleCall<'_>, budget: &Budget) -> Result<Vec<Typed>> {
    let class = call.arg(0)?.global()?;
    let state = call.state()?.tuple()?;
    // Both orders were written: (dtype, array) and (array, dtype).
    let (first, second) = (state.get(0)?, state.get(1)?);
    let (dtype, values) = if first.is_array() { (second, first) } else { (first, second) };
    match class.name {
        "DatetimeArray" => from_numpy(&values, budget, zone(&dtype)?.as_ref()),
        "TimedeltaArray" => from_numpy(&values, budget, None),
        "PeriodArray" => periods(&values, &dtype, budget),
        "StringArray" => {
            let found = from_numpy(&values, budget, None)?;
            let dtype = string_dtype(Some(dtype));
            Ok(found.into_iter().map(|(array, _)| (array, dtype.clone())).collect())
        }
        "Categorical" => categorical(&dtype, &values, budget).map(|one| vec![one]),
        _ => Err(node.unexpected("an array of pandas that is read here")),
    }
}

/// End of the names of types that pandas takes from PyArrow: `float[pyarrow]`.
pub(super) const ARROW: &str = "[pyarrow]";
/// Begin of the names of types of periods: `period[M]`.
pub(super) const PERIOD: &str = "period[";

/// The array of PyArrow in one of pandas, whose releases differ in the attribute's name.
fn arrow_values<'p>(call: &PickleCall<'p>) -> Result<Node<'p>> {
    let Some(state) = call.find_state() else { return call.arg(0) };
    let state = state.dict()?;
    state.find("_pa_array").map_or_else(|| state.get("_data"), Ok)
}

/// Numbers of periods since 1970; NaT is missing. Arrow has no type for them.
fn periods(values: &Node<'_>, dtype: &Node<'_>, budget: &Budget) -> Result<Vec<Typed>> {
    let name = dtype.any_call()?.arg(0)?;
    let name = name.str()?;
    if !name.starts_with(PERIOD) {
        return Err(dtype.unexpected("a type of periods by its name: period[M]"));
    }
    let counted = from_numpy(values, budget, None)?.into_iter().map(|(array, _)| {
        let counts = array.as_primitive_opt::<Int64Type>();
        let counts = counts.ok_or_else(|| values.unexpected("periods as int64"))?.values().clone();
        let nulls = not_a_time(counts.iter().copied());
        Ok((Arc::new(Int64Array::new(counts, nulls)) as ArrayRef, name.to_owned()))
    });
    counted.collect()
}

/// Validity of counts of a unit of time; `None` where no count is missing.
fn not_a_time(counts: impl Iterator<Item = i64>) -> Option<NullBuffer> {
    let valid = NullBuffer::from_iter(counts.map(|count| count != i64::MIN));
    (valid.null_count() > 0).then_some(valid)
}

/// `str` is pandas 3's text, whose missing values are NaN; `string` the older one with NA.
fn string_dtype(dtype: Option<Node<'_>>) -> String {
    let missing_is_nan = dtype
        .and_then(|dtype| dtype.any_call().ok())
        .and_then(|call| call.args().find(1))
        .is_some_and(|missing| missing.float().is_ok_and(f64::is_nan));
    if missing_is_nan { "str" } else { "string" }.to_owned()
}

/// The time zone of a `DatetimeTZDtype`; `None` for a NumPy type.
fn zone(dtype: &Node<'_>) -> Result<Option<Arc<str>>> {
    let call = dtype.any_call()?;
    if call.global().is("numpy.dtype") {
        return Ok(None);
    }
    // `DatetimeTZDtype(unit, tz)`, or an empty one with its state.
    let zone = match (call.args().find(1), call.find_state()) {
        (Some(zone), _) => zone,
        (None, Some(state)) => state.dict()?.get("tz")?,
        (None, None) => return Err(dtype.unexpected("a type with a time zone")),
    };
    let of = zone.any_call()?;
    let name = match (of.global().module, of.global().name) {
        ("pytz", "_UTC") => "UTC".into(),
        ("pytz", "_p") | ("zoneinfo", "ZoneInfo._unpickle") => of.arg(0)?.str()?.into(),
        ("pytz", "FixedOffset") => from_utc(&zone, of.arg(0)?.int()?)?,
        ("datetime", "timezone") => {
            let offset = of.arg(0)?.timedelta()?;
            if offset.num_seconds() % 60 != 0 || offset.subsec_nanos() != 0 {
                return Err(zone.unexpected("a time zone whose offset is whole minutes"));
            }
            from_utc(&zone, offset.num_minutes())?
        }
        _ => return Err(zone.unexpected("a time zone with a name or an offset")),
    };
    Ok(Some(name))
}

/// A zone without a name, by its minutes east of Greenwich, as Arrow writes it: `+02:00`.
fn from_utc(zone: &Node<'_>, minutes: i64) -> Result<Arc<str>> {
    let (hours, rest) = (minutes.unsigned_abs() / 60, minutes.unsigned_abs() % 60);
    match (minutes, hours) {
        (0, _) => Ok("UTC".into()),
        (_, ..24) => {
            let sign = if minutes < 0 { '-' } else { '+' };
            Ok(format!("{sign}{hours:02}:{rest:02}").into())
        }
        _ => Err(zone.unexpected("a time zone less than a day from Greenwich")),
    }
}

/// pandas's name of times in a zone: `datetime64[ns, Europe/Berlin]`, `datetime64[ns, UTC+02:00]`.
pub(super) fn zoned(unit: &str, zone: &str) -> String {
    let utc = if zone.starts_with(['+', '-']) { "UTC" } else { "" };
    format!("datetime64[{unit}, {utc}{zone}]")
}

fn from_numpy(node: &Node<'_>, budget: &Budget, zone: Option<&Arc<str>>) -> Result<Vec<Typed>> {
    match node.array()? {
        PickledArray::Tensor(tensor) => {
            let rows = rows(node, tensor.shape(), budget)?;
            (0..rows.count).map(|row| numbers(node, &tensor, &rows, row)).collect()
        }
        PickledArray::Array(array) => {
            let rows = rows(node, &array.shape, budget)?;
            (0..rows.count).map(|row| times(node, &array, &rows, row, zone)).collect()
        }
        PickledArray::Objects { shape, items } => {
            let rows = rows(node, &shape, budget)?;
            budget.take(node, items.len().saturating_mul(size_of::<Node<'_>>()))?;
            let items: Vec<_> = items.iter().collect();
            (0..rows.count)
                .map(|row| {
                    let begin = row * rows.length;
                    let part = items.get(begin..begin + rows.length).unwrap_or_default();
                    let (array, dtype) = objects::array(node, part, budget)?;
                    Ok((array, dtype.to_owned()))
                })
                .collect()
        }
    }
}

/// Rows of an array of one or two dimensions.
struct Rows {
    count: usize,
    length: usize,
}

fn rows(node: &Node<'_>, shape: &[usize], budget: &Budget) -> Result<Rows> {
    let rows = match *shape {
        [length] => Rows { count: 1, length },
        [count, length] => Rows { count, length },
        _ => return Err(node.unexpected("an array of one or two dimensions")),
    };
    // Rows without elements take memory too.
    budget.take(node, rows.count.saturating_mul(256))?;
    Ok(rows)
}

/// The bytes of a row.
fn row_of(data: &Bytes, rows: &Rows, row: usize, size: usize) -> Bytes {
    let begin = row * rows.length * size;
    data.slice(begin..begin + rows.length * size)
}

fn numbers(node: &Node<'_>, tensor: &Tensor, rows: &Rows, row: usize) -> Result<Typed> {
    let data = row_of(tensor.data(), rows, row, tensor.dtype().size());
    let number = arrow::number_type(tensor.dtype().name())
        .ok_or_else(|| node.unexpected("numbers that Arrow has, not complex ones"))?;
    let array = fixed(node, number, rows.length, data, None)?;
    Ok((array, tensor.dtype().name().to_owned()))
}

fn fixed(
    node: &Node<'_>,
    data_type: DataType,
    length: usize,
    data: Bytes,
    nulls: Option<NullBuffer>,
) -> Result<ArrayRef> {
    let array = arrow::fixed(data_type, length, data, nulls);
    array.map(make_array).map_err(|error| node.unexpected(error.to_string()))
}

/// `datetime64` and `timedelta64`; NaT is missing.
fn times(
    node: &Node<'_>,
    array: &NumpyArray,
    rows: &Rows,
    row: usize,
    zone: Option<&Arc<str>>,
) -> Result<Typed> {
    let data = row_of(&array.data, rows, row, array.itemsize);
    let descr = array.descr.trim_matches('\'');
    let unit = descr.split_once('[').and_then(|(_, unit)| unit.strip_suffix(']'));
    let wrong = || node.unexpected("times in s, ms, us or ns, little-endian");
    let name = unit.ok_or_else(wrong)?;
    let unit = arrow::unit(name).ok_or_else(wrong)?;
    let (data_type, dtype) = match (descr.get(..3), zone) {
        (Some("<M8"), None) => (DataType::Timestamp(unit, None), format!("datetime64[{name}]")),
        (Some("<M8"), Some(zone)) => {
            (DataType::Timestamp(unit, Some(Arc::clone(zone))), zoned(name, zone))
        }
        (Some("<m8"), _) => (DataType::Duration(unit), format!("timedelta64[{name}]")),
        _ => return Err(wrong()),
    };
    let (counts, _) = data.as_chunks::<8>();
    let nulls = not_a_time(counts.iter().map(|&count| i64::from_le_bytes(count)));
    Ok((fixed(node, data_type, rows.length, data, nulls)?, dtype))
}

/// Type of categories, which Arrow has no other place for where it says what the categories are.
pub(crate) fn category_of(name: &str, dtype: &str) -> String {
    let is_said = dtype == cells::DTYPE || dtype.starts_with(intervals::DTYPE);
    if is_said { format!("{name} of {dtype}") } else { name.to_owned() }
}

/// Values and a mask that is true where they are missing.
fn masked(node: &Node<'_>, call: &PickleCall<'_>, budget: &Budget) -> Result<Typed> {
    // Old releases apply the class to both, new ones set them.
    let (values, mask) = match call.find_state() {
        Some(state) => (state.dict()?.get("_data")?, state.dict()?.get("_mask")?),
        None => (call.arg(0)?, call.arg(1)?),
    };
    let (array, dtype) = column(&values, budget)?;
    let mask = match mask.array()? {
        PickledArray::Tensor(mask) if mask.dtype() == Dtype::Bool => mask,
        _ => return Err(mask.unexpected("a mask of bools")),
    };
    if mask.shape() != [array.len()] {
        return Err(node.unexpected(format!("a mask of {} bools", array.len())));
    }
    let nulls = NullBuffer::from_iter(mask.data().iter().map(|&missing| missing == 0));
    let data = array.to_data().into_builder().nulls(Some(nulls)).build();
    let data = data.map_err(|error| node.unexpected(format!("values with a mask: {error}")))?;
    let name = match dtype.as_str() {
        "bool" => "boolean".to_owned(),
        // int64 -> Int64, uint8 -> UInt8, float32 -> Float32
        lower => lower
            .replacen("uint", "UInt", 1)
            .replacen("int", "Int", 1)
            .replacen("float", "Float", 1),
    };
    Ok((make_array(data), name))
}

/// Codes into the categories of a `CategoricalDtype`; -1 is missing.
fn categorical(dtype: &Node<'_>, codes: &Node<'_>, budget: &Budget) -> Result<Typed> {
    let call = dtype.any_call()?;
    let (categories, ordered) = match call.find_state() {
        Some(state) => {
            let state = state.dict()?;
            (state.get("categories")?, state.find("ordered"))
        }
        None => (call.arg(0)?, call.args().find(1)),
    };
    let ordered = ordered.is_some_and(|ordered| ordered.bool().unwrap_or(false));
    coded(codes, &categories, ordered, budget)
}

/// `Categorical.from_codes(codes, categories, ordered)`, as this crate writes it.
fn from_codes(call: &PickleCall<'_>, budget: &Budget) -> Result<Typed> {
    let [codes, categories, ordered] = call.args().exact()?;
    coded(&codes, &categories, ordered.bool()?, budget)
}

fn coded(codes: &Node<'_>, categories: &Node<'_>, ordered: bool, budget: &Budget) -> Result<Typed> {
    let Column { array, dtype, .. } = listed(index(categories, budget)?, categories, budget)?;
    let name = if ordered { "category(ordered)" } else { "category" };
    Ok((dictionary(codes, array, budget)?, category_of(name, &dtype)))
}

/// The labels of an index of one level, also of a range.
pub(super) fn listed(index: Index, node: &Node<'_>, budget: &Budget) -> Result<Column> {
    match index {
        Index::Column(column, _) => Ok(*column),
        Index::Levels(_) => Err(node.unexpected("an index of one level")),
        Index::Range { start, stop, step, name } => {
            let length = range_length(start, stop, step);
            budget.take(node, length.saturating_mul(8))?;
            let labels = range_labels(start, stop, step);
            let array: ArrayRef = Arc::new(Int64Array::from_iter_values(labels));
            Ok(Column { label: name, dtype: "int64".into(), array })
        }
    }
}

/// Codes into `values`; -1 is missing.
pub(super) fn dictionary(codes: &Node<'_>, values: ArrayRef, budget: &Budget) -> Result<ArrayRef> {
    let (codes_array, _) = column(codes, budget)?;
    let any = codes_array.as_any();
    macro_rules! dictionary {
        ($($array:ty),*) => {$(
            if let Some(found) = any.downcast_ref::<$array>() {
                let valid = NullBuffer::from_iter(found.values().iter().map(|&code| code >= 0));
                let nulls = (valid.null_count() > 0).then_some(valid);
                let keys = <$array>::new(found.values().clone(), nulls);
                return DictionaryArray::try_new(keys, values)
                    .map(|array| Arc::new(array) as ArrayRef)
                    .map_err(|error| codes.unexpected(format!("codes of categories: {error}")));
            }
        )*};
    }
    dictionary!(Int8Array, Int16Array, Int32Array, Int64Array);
    Err(codes.unexpected("codes that are signed integers"))
}
