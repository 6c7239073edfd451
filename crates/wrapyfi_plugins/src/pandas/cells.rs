//! Columns of objects that are not of one kind, lists and arrays among them: the JSON of each, as text.
//!
//! ```text
//!   [1, "x", [2, None], {"a": nan}]  ◀─▶  ["1", "\"x\"", "[2, null]", "{\"a\": NaN}"]
//! ```

use std::sync::Arc;

use arrow_array::cast::AsArray as _;
use arrow_array::{Array as _, ArrayRef, StringArray};
use chrono::{Datelike as _, Timelike as _};

use super::super::budget::Budget;
use super::super::{PluginError, Plugins};
use crate::pickle::{Items, Node, PickleError, PickledArray, View, Writer};
use wrapyfi_data::Limits;
use wrapyfi_data::codec::json;
use wrapyfi_data::types::{DateTime, Map, Value};

/// Name of the type of such a column.
pub(super) const DTYPE: &str = "object(json)";

/// JSON of a value; an error says why it has none.
pub(super) fn to_text(value: &Value) -> Result<String, String> {
    let text = json::encode(value, &Plugins::none()).map_err(|error| error.to_string())?;
    Ok(String::from_utf8_lossy(&text).into_owned())
}

/// The value of which `text` is the JSON.
pub(super) fn from_text(text: &str) -> Result<Value, String> {
    json::decode(&text.to_owned().into(), &Limits::default(), &Plugins::none())
        .map_err(|error| error.to_string())
}

fn texts<E>(texts: impl Iterator<Item = Result<String, E>>) -> Result<ArrayRef, E> {
    Ok(Arc::new(StringArray::from_iter_values(texts.collect::<Result<Vec<_>, E>>()?)))
}

/// Reads objects as an array of their JSON.
pub(super) fn array(items: &[Node<'_>], budget: &Budget) -> Result<ArrayRef, PickleError> {
    texts(items.iter().map(|item| {
        let text = to_text(&value(item, budget)?).map_err(|error| item.unexpected(error))?;
        budget.take(item, text.len()).map(|()| text)
    }))
}

/// Objects as an array of their JSON.
///
/// # Errors
/// When one of them has no form in JSON.
pub(super) fn of(values: &[&Value]) -> Result<ArrayRef, PluginError> {
    let refused = |error| PluginError::unsupported("an object of a column", error);
    texts(values.iter().map(|value| to_text(value).map_err(refused)))
}

/// The objects of which an array has the JSON.
///
/// # Errors
/// When something else than JSON is in it.
pub(super) fn values(array: &ArrayRef) -> Result<Vec<Value>, PluginError> {
    let wrong = |why: String| {
        PluginError::unsupported(format!("a column {DTYPE}: {why}"), "leave out its dtype")
    };
    let texts = array.as_string_opt::<i32>().ok_or_else(|| wrong(array.data_type().to_string()))?;
    let value = |text: Option<&str>| text.map_or(Ok(Value::Null), from_text).map_err(wrong);
    texts.iter().map(value).collect()
}

/// A value of Python's own types, in which nothing changes in JSON.
fn value(node: &Node<'_>, budget: &Budget) -> Result<Value, PickleError> {
    budget.take(node, size_of::<Value>())?;
    let each = |items: Items<'_>| {
        budget.deeper(node, || items.iter().map(|item| value(&item, budget)).collect())
    };
    Ok(match node.view() {
        View::None => Value::Null,
        View::Bool(value) => value.into(),
        View::Int(value) => value.into(),
        View::BigInt(value) => Value::BigInt(value.clone()),
        View::Float(value) => value.into(),
        View::Str(text) => {
            budget.take(node, text.len())?;
            text.into()
        }
        View::List(items) => Value::List(each(items)?),
        View::Tuple(items) => Value::Tuple(each(items)?),
        View::Set(items) => Value::Set(each(items)?),
        View::Dict(pairs) => {
            let member = |(key, member): (Node<'_>, Node<'_>)| {
                budget.take(&key, key.str()?.len())?;
                Ok((key.str()?.to_owned(), value(&member, budget)?))
            };
            let members: Result<Vec<_>, _> =
                budget.deeper(node, || pairs.iter().map(member).collect());
            Value::Map(Map::from_iter(members?))
        }
        _ if node.is_array() => match node.array()? {
            PickledArray::Tensor(tensor) => {
                budget.take(node, tensor.data().len())?;
                Value::Tensor(tensor)
            }
            _ => return Err(node.unexpected("an array of numbers in a column")),
        },
        View::Call(call) if call.global().is("datetime.datetime") => {
            Value::DateTime(node.datetime()?)
        }
        _ => return Err(node.unexpected("an object of Python's own types in a column")),
    })
}

/// Writes an object that [`values`] has read.
///
/// # Errors
/// When it is of a type that is not written here.
pub(super) fn write(to: &mut Writer, value: &Value) -> Result<(), PluginError> {
    match value {
        Value::Null => _ = to.none(),
        Value::Bool(value) => _ = to.bool(*value),
        Value::Int(value) => _ = to.int(*value),
        Value::BigInt(value) => _ = to.big_int(value),
        Value::Float(value) => _ = to.float(*value),
        Value::Str(text) => _ = to.str(text),
        Value::List(items) => _ = to.list(items, write)?,
        Value::Tuple(items) => {
            to.mark();
            items.iter().try_for_each(|item| write(to, item))?;
            to.tuple_since_mark();
        }
        Value::Set(items) => {
            to.global("builtins", "set");
            to.list(items, write)?.tuple(1).reduce();
        }
        Value::Map(members) => {
            to.mark();
            for (key, member) in members.iter() {
                write(to, key)?;
                write(to, member)?;
            }
            to.dict_since_mark();
        }
        Value::DateTime(time) => datetime(to, time),
        Value::Tensor(tensor) if tensor.dtype().npy_descr().is_some() => {
            to.empty_array().reduce();
            to.array_state(tensor.dtype(), tensor.shape(), tensor.data()).build();
        }
        other => {
            return Err(PluginError::unsupported(
                format!("a {} in a column of objects", other.kind()),
                "cast the column",
            ));
        }
    }
    Ok(())
}

/// `datetime.datetime(bytes, timezone)`, as Python pickles it.
// The parts of a time fit their bytes.
fn datetime(to: &mut Writer, time: &DateTime) {
    let local = time.local;
    let [y, year] = u16::try_from(local.year()).unwrap_or(1).to_be_bytes();
    let [_, a, b, c] = (local.nanosecond() / 1000 % 1_000_000).to_be_bytes();
    let (month, day) = (local.month() as u8, local.day() as u8);
    let (hour, minute, second) = (local.hour() as u8, local.minute() as u8, local.second() as u8);
    to.global("datetime", "datetime");
    to.bytes(&[y, year, month, day, hour, minute, second, a, b, c]);
    match time.offset {
        None => to.tuple(1),
        Some(offset) => {
            let east = i64::from(offset.local_minus_utc());
            to.global("datetime", "timezone").global("datetime", "timedelta");
            to.int(east.div_euclid(86_400)).int(east.rem_euclid(86_400)).int(0).tuple(3).reduce();
            to.tuple(1).reduce().tuple(2)
        }
    };
    to.reduce();
}
