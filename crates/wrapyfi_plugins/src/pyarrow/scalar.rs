//! Scalars of PyArrow: a value of Python and its type, as an array of one element.
//!
//! ```text
//!   pyarrow.lib.scalar({'x': 1, 'y': [0.5]}, struct([field('x', …), field('y', …)]))  ◀─▶  one row
//! ```
//!
//! Times come as Python's own and go as counts of their unit, which PyArrow takes as well.

use std::sync::Arc;

use arrow_array::cast::AsArray as _;
use arrow_array::types::{
    ArrowPrimitiveType, Decimal128Type, Float16Type, Float32Type, Float64Type, Int32Type,
    Int64Type, UInt64Type,
};
use arrow_array::{
    Array as _, ArrayRef, BinaryArray, BooleanArray, FixedSizeBinaryArray, FixedSizeListArray,
    LargeBinaryArray, LargeListArray, LargeStringArray, ListArray, NullArray, PrimitiveArray,
    StringArray, StructArray, downcast_integer, make_array,
};
use arrow_buffer::{NullBuffer, OffsetBuffer};
use arrow_schema::{ArrowError, DataType, Fields, TimeUnit};

use super::super::PluginError;
use super::super::budget::Budget;
use super::types;
use crate::pickle::{Node, PickleCall, PickleError, View, Writer};
use wrapyfi_data::types::{Value, arrow, nested_list};

type Result<T> = std::result::Result<T, PickleError>;

/// Deepest nesting of a scalar.
const MAX_DEPTH: usize = 64;

/// Reads `pyarrow.lib.scalar(value, type)`.
pub(super) fn read(call: &PickleCall<'_>, budget: &Budget) -> Result<ArrayRef> {
    let data_type = types::data_type(&call.arg(1)?, budget)?;
    let value = call.arg(0)?;
    array(&value, &data_type, &[value.option()], budget, 0)
}

/// An array of `data_type` of Python's values, nothing for `None`. Nested types collect what is in
/// all of their elements.
fn array(
    owner: &Node<'_>,
    data_type: &DataType,
    items: &[Option<Node<'_>>],
    budget: &Budget,
    depth: usize,
) -> Result<ArrayRef> {
    if depth > MAX_DEPTH {
        return Err(owner.unexpected(format!("a scalar nested at most {MAX_DEPTH} deep")));
    }
    budget.take(owner, items.len().saturating_mul(32))?;
    let wrong = |error: ArrowError| owner.unexpected(format!("a {data_type}: {error}"));
    let valid = || NullBuffer::from_iter(items.iter().map(Option::is_some));
    macro_rules! integers {
        ($number:ty) => {
            numbers::<$number>(items, int)?
        };
    }
    Ok(downcast_integer!(data_type => (integers),
        DataType::Null => Arc::new(NullArray::new(items.len())),
        DataType::Boolean => {
            let values = items.iter().map(|item| item.as_ref().map(Node::bool).transpose());
            Arc::new(BooleanArray::from(values.collect::<Result<Vec<_>>>()?))
        }
        DataType::Float16 => numbers::<Float16Type>(items, |n| n.float().map(half::f16::from_f64))?,
        DataType::Float32 => {
            // Python has it as a double.
            let narrow = |n: &Node<'_>| n.float().map(|value| value as f32);
            numbers::<Float32Type>(items, narrow)?
        }
        DataType::Float64 => numbers::<Float64Type>(items, Node::float)?,
        DataType::Utf8 => Arc::new(StringArray::from_iter(sized(items, budget, Node::str)?)),
        DataType::LargeUtf8 => {
            Arc::new(LargeStringArray::from_iter(sized(items, budget, Node::str)?))
        }
        DataType::Binary => Arc::new(BinaryArray::from_iter(sized(items, budget, Node::bytes)?)),
        DataType::LargeBinary => {
            Arc::new(LargeBinaryArray::from_iter(sized(items, budget, Node::bytes)?))
        }
        DataType::FixedSizeBinary(size) => {
            let values = sized(items, budget, Node::bytes)?.into_iter();
            let made = FixedSizeBinaryArray::try_from_sparse_iter_with_size(values, *size);
            Arc::new(made.map_err(wrong)?)
        }
        DataType::Decimal128(precision, scale) => {
            let values = numbers::<Decimal128Type>(items, |n| decimal(n, *scale))?;
            let values = values.as_primitive::<Decimal128Type>().clone();
            Arc::new(values.with_precision_and_scale(*precision, *scale).map_err(wrong)?)
        }
        DataType::Date32 | DataType::Time32(_) => {
            let narrow = |n: &Node<'_>| count(n, data_type)?.try_into().map_err(|_wide| wide(n));
            let counts = numbers::<Int32Type>(items, narrow)?;
            retyped(&counts, data_type).map_err(wrong)?
        }
        DataType::Date64
        | DataType::Time64(_)
        | DataType::Timestamp(..)
        | DataType::Duration(_) => {
            let counts = numbers::<Int64Type>(items, |n| count(n, data_type))?;
            retyped(&counts, data_type).map_err(wrong)?
        }
        DataType::List(field) => {
            let (offsets, found) = children(owner, items, budget)?;
            let lengths = OffsetBuffer::from_lengths(offsets.lengths());
            let values = array(owner, field.data_type(), &found, budget, depth + 1)?;
            Arc::new(
                ListArray::try_new(field.clone(), lengths, values, Some(valid())).map_err(wrong)?,
            )
        }
        DataType::LargeList(field) => {
            let (offsets, found) = children(owner, items, budget)?;
            let values = array(owner, field.data_type(), &found, budget, depth + 1)?;
            Arc::new(
                LargeListArray::try_new(field.clone(), offsets, values, Some(valid()))
                    .map_err(wrong)?,
            )
        }
        DataType::FixedSizeList(field, size) => {
            let (offsets, mut found) = children(owner, items, budget)?;
            let length = usize::try_from(*size).unwrap_or(0);
            if items.iter().zip(offsets.lengths()).any(|(item, it)| item.is_some() && it != length)
            {
                return Err(owner.unexpected(format!("lists of {size}")));
            }
            // A missing list of fixed size takes as many elements as the others.
            let wanted = items.len().saturating_mul(length);
            budget.take(owner, wanted.saturating_mul(32))?;
            if found.len() != wanted {
                let mut rest = found.into_iter();
                found = items
                    .iter()
                    .flat_map(|item| {
                        let all = item.map_or(0, |_| length);
                        let there: Vec<_> = rest.by_ref().take(all).collect();
                        let missing = std::iter::repeat_n(None, length - there.len());
                        there.into_iter().chain(missing)
                    })
                    .collect();
            }
            let values = array(owner, field.data_type(), &found, budget, depth + 1)?;
            Arc::new(
                FixedSizeListArray::try_new(field.clone(), *size, values, Some(valid()))
                    .map_err(wrong)?,
            )
        }
        DataType::Struct(fields) => {
            let rows = items.iter().map(|item| item.map(|item| members(&item, fields)).transpose());
            let rows = rows.collect::<Result<Vec<_>>>()?;
            let columns = fields.iter().enumerate().map(|(place, field)| {
                let column = rows.iter().map(|row| row.as_ref()?.get(place)?.option());
                let column: Vec<_> = column.collect();
                array(owner, field.data_type(), &column, budget, depth + 1)
            });
            let columns = columns.collect::<Result<Vec<_>>>()?;
            let length = items.len();
            let made =
                StructArray::try_new_with_length(fields.clone(), columns, Some(valid()), length);
            Arc::new(made.map_err(wrong)?)
        }
        _ => return Err(owner.unexpected(format!("a scalar that is read here, not a {data_type}"))),
    ))
}

/// Offsets at which the elements of each list end, and the elements of all lists.
fn children<'p>(
    owner: &Node<'p>,
    items: &[Option<Node<'p>>],
    budget: &Budget,
) -> Result<(OffsetBuffer<i64>, Vec<Option<Node<'p>>>)> {
    let mut found = Vec::new();
    let mut lengths = Vec::with_capacity(items.len());
    for list in items {
        let before = found.len();
        if let Some(list) = list {
            let list = list.sequence()?;
            budget.take(owner, list.len().saturating_mul(size_of::<Node<'_>>()))?;
            found.extend(list.iter().map(Node::option));
        }
        lengths.push(found.len() - before);
    }
    Ok((OffsetBuffer::from_lengths(lengths), found))
}

/// The members of a struct in the order of its type: of a dict, or of a list of pairs where a name
/// comes twice.
fn members<'p>(item: &Node<'p>, fields: &Fields) -> Result<Vec<Node<'p>>> {
    let pairs: Vec<(Node<'p>, Node<'p>)> = match item.view() {
        View::Dict(members) => members.iter().collect(),
        _ => {
            let pairs = item.sequence()?;
            let pairs =
                pairs.iter().map(|pair| pair.sequence()?.exact().map(|[key, it]| (key, it)));
            pairs.collect::<Result<_>>()?
        }
    };
    let mut named = pairs.iter().zip(fields);
    if pairs.len() != fields.len() || !named.all(|((key, _), it)| key.str() == Ok(it.name())) {
        return Err(item.unexpected("the members of its type, in their order"));
    }
    Ok(pairs.into_iter().map(|(_, member)| member).collect())
}

fn int<N: TryFrom<i128>>(node: &Node<'_>) -> Result<N> {
    let value = match node.view() {
        View::BigInt(value) => i128::try_from(value).ok(),
        _ => Some(node.int()?.into()),
    };
    value.and_then(|value| value.try_into().ok()).ok_or_else(|| wide(node))
}

fn wide(node: &Node<'_>) -> PickleError {
    node.unexpected("a number that its type holds")
}

/// Values whose bytes are booked before they are copied.
fn sized<'p, T: AsRef<[u8]>>(
    items: &[Option<Node<'p>>],
    budget: &Budget,
    read: fn(&Node<'p>) -> Result<T>,
) -> Result<Vec<Option<T>>> {
    let booked = |item: &Node<'p>| {
        let value = read(item)?;
        budget.take(item, value.as_ref().len()).map(|()| value)
    };
    items.iter().map(|item| item.as_ref().map(booked).transpose()).collect()
}

fn numbers<'p, T: ArrowPrimitiveType>(
    items: &[Option<Node<'p>>],
    read: impl Fn(&Node<'p>) -> Result<T::Native>,
) -> Result<ArrayRef> {
    let values = items.iter().map(|item| item.as_ref().map(&read).transpose());
    let values = values.collect::<Result<Vec<Option<T::Native>>>>()?;
    Ok(Arc::new(PrimitiveArray::<T>::from_iter(values)))
}

/// The same numbers as counts of a unit of time.
fn retyped(counts: &ArrayRef, data_type: &DataType) -> std::result::Result<ArrayRef, ArrowError> {
    counts.to_data().into_builder().data_type(data_type.clone()).build().map(make_array)
}

/// A time as a count of the unit of its type.
fn count(node: &Node<'_>, data_type: &DataType) -> Result<i64> {
    if let View::Int(count) = node.view() {
        return Ok(count);
    }
    let micros = match data_type {
        DataType::Date32 | DataType::Date64 => {
            let days = node.date()?.signed_duration_since(chrono::NaiveDate::default()).num_days();
            return Ok(if *data_type == DataType::Date32 { days } else { days * 86_400_000 });
        }
        DataType::Time32(_) | DataType::Time64(_) => {
            let (time, _) = node.time()?;
            time.signed_duration_since(chrono::NaiveTime::MIN).num_microseconds()
        }
        DataType::Duration(_) => node.timedelta()?.num_microseconds(),
        _ => {
            let time = node.datetime()?;
            let offset = time.offset.map_or(0, |offset| i64::from(offset.local_minus_utc()));
            Some(time.local.and_utc().timestamp_micros() - offset * 1_000_000)
        }
    };
    let unit = match data_type {
        DataType::Time32(unit)
        | DataType::Time64(unit)
        | DataType::Duration(unit)
        | DataType::Timestamp(unit, _) => *unit,
        _ => TimeUnit::Microsecond,
    };
    let count = micros.and_then(|micros| match unit {
        TimeUnit::Second => Some(micros.div_euclid(1_000_000)),
        TimeUnit::Millisecond => Some(micros.div_euclid(1000)),
        TimeUnit::Microsecond => Some(micros),
        TimeUnit::Nanosecond => micros.checked_mul(1000),
    });
    count.ok_or_else(|| wide(node))
}

/// `Decimal('1.50')` in units of `10^-scale`.
fn decimal(node: &Node<'_>, scale: i8) -> Result<i128> {
    arrow::decimal(node.decimal()?, scale)
        .ok_or_else(|| node.unexpected(format!("a decimal of {scale} digits behind the point")))
}

/// Writes the one element of `array`.
pub(super) fn write(to: &mut Writer, array: &ArrayRef) -> std::result::Result<(), PluginError> {
    to.global("pyarrow.lib", "scalar");
    value(to, array, 0)?;
    types::write_type(to, array.data_type())?;
    to.tuple(2).reduce();
    Ok(())
}

/// Element `row` as Python has it.
fn value(to: &mut Writer, array: &ArrayRef, row: usize) -> std::result::Result<(), PluginError> {
    if array.is_null(row) || *array.data_type() == DataType::Null {
        to.none();
        return Ok(());
    }
    match array.data_type() {
        DataType::Boolean => _ = to.bool(array.as_boolean().value(row)),
        DataType::UInt64 => _ = to.big_int(&array.as_primitive::<UInt64Type>().value(row).into()),
        DataType::Utf8 => _ = to.str(array.as_string::<i32>().value(row)),
        DataType::LargeUtf8 => _ = to.str(array.as_string::<i64>().value(row)),
        DataType::Binary => _ = to.bytes(array.as_binary::<i32>().value(row)),
        DataType::LargeBinary => _ = to.bytes(array.as_binary::<i64>().value(row)),
        DataType::FixedSizeBinary(_) => _ = to.bytes(array.as_fixed_size_binary().value(row)),
        DataType::Decimal128(..) => {
            let text = array.as_primitive::<Decimal128Type>().value_as_string(row);
            to.global("decimal", "Decimal").str(&text).tuple(1).reduce();
        }
        DataType::List(_) => list(to, &array.as_list::<i32>().value(row))?,
        DataType::LargeList(_) => list(to, &array.as_list::<i64>().value(row))?,
        DataType::FixedSizeList(..) => list(to, &array.as_fixed_size_list().value(row))?,
        DataType::Struct(fields) => {
            to.mark();
            for (field, column) in fields.iter().zip(array.as_struct().columns()) {
                to.str(field.name());
                value(to, column, row)?;
            }
            to.dict_since_mark();
        }
        // Plain numbers, and times as counts of their unit.
        other => match arrow::elements(&array.slice(row, 1)).as_ref().and_then(nested_list) {
            Some(Value::List(number)) => match number[..] {
                [Value::Int(value)] => _ = to.int(value),
                [Value::Float(value)] => _ = to.float(value),
                _ => return Err(no_scalar(other)),
            },
            _ => return Err(no_scalar(other)),
        },
    }
    Ok(())
}

fn no_scalar(data_type: &DataType) -> PluginError {
    PluginError::unsupported(
        format!("a scalar of type {data_type}"),
        "send an array of one element",
    )
}

fn list(to: &mut Writer, elements: &ArrayRef) -> std::result::Result<(), PluginError> {
    to.list(0..elements.len(), |to, row| value(to, elements, row)).map(drop)
}
