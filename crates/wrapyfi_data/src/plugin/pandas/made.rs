//! Frames that call pandas's constructors: what [`super::write`] writes, read back.

use std::sync::Arc;

use arrow_array::cast::AsArray as _;
use arrow_array::types::{
    Int64Type, TimestampMicrosecondType, TimestampMillisecondType, TimestampNanosecondType,
    TimestampSecondType,
};
use arrow_array::{Array as _, ArrayRef, PrimitiveArray};
use arrow_schema::DataType;

use super::super::budget::Budget;
use super::column::{Typed, column, not_a_time};
use super::frame::{Column, Frame, Index, Kind};
use super::read::index as read_index;
use super::{labels, objects};
use crate::codec::pickle::{Node, PickleCall, PickleError, View};

type Result<T> = std::result::Result<T, PickleError>;

/// `pandas.DataFrame({label: series, …}, index, columns)`.
pub(super) fn data_frame(node: &Node<'_>, call: &PickleCall<'_>, budget: &Budget) -> Result<Frame> {
    let [content, rows, columns] = call.args().exact()?;
    let (names, columns_name) = labels::axis(&columns, budget)?;
    let index = read_index(&rows, budget)?;
    let content = content.dict()?;
    if content.len() != names.len() {
        return Err(node.unexpected(format!("{} columns", names.len())));
    }
    let columns = names.into_iter().zip(content.iter()).map(|(label, (key, values))| {
        if labels::scalar(&key)? != label {
            return Err(key.unexpected("the label of the column in its place"));
        }
        let series = values.call("pandas.Series")?;
        let (array, dtype) = typed(&series.arg(0)?, &series.arg(2)?, budget)?;
        if array.len() != index.len() {
            return Err(values.unexpected(format!("a column of {} rows", index.len())));
        }
        Ok(Column { label, dtype, array })
    });
    let columns = columns.collect::<Result<Vec<_>>>()?;
    Ok(Frame { kind: Kind::Frame, index, columns, columns_name })
}

/// `pandas.Series(values, index, dtype, name)`.
pub(super) fn series(node: &Node<'_>, call: &PickleCall<'_>, budget: &Budget) -> Result<Frame> {
    let [values, rows, dtype, name] = call.args().exact()?;
    let index = read_index(&rows, budget)?;
    let (array, dtype) = typed(&values, &dtype, budget)?;
    if array.len() != index.len() {
        return Err(node.unexpected(format!("a series of {} rows", index.len())));
    }
    let columns = vec![Column { label: labels::scalar(&name)?, dtype, array }];
    let columns_name = crate::types::Value::Null;
    Ok(Frame { kind: Kind::Series, index, columns, columns_name })
}

/// `pandas.Index(values, dtype, copy, name)`, `pandas.RangeIndex(start, stop, step, …, name)`.
pub(super) fn index(node: &Node<'_>, call: &PickleCall<'_>, budget: &Budget) -> Result<Index> {
    if call.global().name == "RangeIndex" {
        let [start, stop, step, _, _, name] = call.args().exact()?;
        let (start, stop, step) = (start.int()?, stop.int()?, step.int()?);
        if step == 0 {
            return Err(node.unexpected("a range with a step other than 0"));
        }
        return Ok(Index::Range { start, stop, step, name: labels::scalar(&name)? });
    }
    let [values, dtype, _, name] = call.args().exact()?;
    let (array, dtype) = typed(&values, &dtype, budget)?;
    let column = Column { label: labels::scalar(&name)?, dtype, array };
    Ok(Index::Column(Box::new(column), None))
}

/// Values as a type that is asked for.
fn typed(values: &Node<'_>, dtype: &Node<'_>, budget: &Budget) -> Result<Typed> {
    let asked = dtype.option().map(|dtype| dtype.str()).transpose()?;
    if let View::List(items) = values.view() {
        let items: Vec<_> = items.iter().collect();
        let (array, _) = objects::array(values, &items, budget)?;
        return Ok((array, "object".into()));
    }
    let (array, found) = column(values, budget)?;
    match (asked, array.data_type()) {
        // Objects are asked for by name; text that is not has the type of pandas 3.
        (None, DataType::Utf8) if found.starts_with("object") => Ok((array, "str".into())),
        (Some("string"), DataType::Utf8) => Ok((array, "string".into())),
        (Some(zoned), DataType::Int64) if zoned.starts_with("datetime64[") => {
            let array =
                zone(&array, zoned).ok_or_else(|| dtype.unexpected("a time with a zone"))?;
            Ok((array, zoned.to_owned()))
        }
        _ => Ok((array, found)),
    }
}

/// Instants in UTC as times of a zone: `datetime64[ns, Europe/Berlin]`.
fn zone(array: &ArrayRef, dtype: &str) -> Option<ArrayRef> {
    let (unit, zone) = dtype.strip_prefix("datetime64[")?.strip_suffix(']')?.split_once(", ")?;
    let zone = zone.strip_prefix("UTC").filter(|offset| !offset.is_empty()).unwrap_or(zone);
    let counts = array.as_primitive::<Int64Type>().values().clone();
    let nulls = not_a_time(&counts);
    macro_rules! stamps {
        ($kind:ty) => {
            Arc::new(PrimitiveArray::<$kind>::new(counts, nulls).with_timezone(zone)) as ArrayRef
        };
    }
    Some(match unit {
        "s" => stamps!(TimestampSecondType),
        "ms" => stamps!(TimestampMillisecondType),
        "us" => stamps!(TimestampMicrosecondType),
        "ns" => stamps!(TimestampNanosecondType),
        _ => return None,
    })
}
