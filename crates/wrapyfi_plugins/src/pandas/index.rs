//! Indices of pandas, and the labels of columns, which are one.

use arrow_array::Array as _;
use arrow_array::cast::AsArray as _;

use super::super::budget::Budget;
use super::column::{column, dictionary, listed, typed};
use super::frame::{Column, Index, range_labels};
use super::{intervals, labels, offsets};
use crate::pickle::{Node, Pairs, PickleCall, PickleError, PickledArray, View};
use wrapyfi_data::types::Value;

type Result<T> = std::result::Result<T, PickleError>;

/// Labels that a frame may have.
const MAX_LABELS: usize = 1 << 20;

/// Reads an index.
pub(super) fn index(node: &Node<'_>, budget: &Budget) -> Result<Index> {
    // Categories are an index, which may have categories.
    budget.deeper(node, || read_index(node, budget))
}

fn read_index(node: &Node<'_>, budget: &Budget) -> Result<Index> {
    let call = node.any_call()?;
    if matches!(call.global().name, "Index" | "RangeIndex") {
        return constructed(node, &call, budget);
    }
    let makers = ["_new_Index", "_new_DatetimeIndex", "_new_TimedeltaIndex", "_new_IntervalIndex"];
    if !makers.contains(&call.global().name) {
        return Err(node.unexpected("an index"));
    }
    let (class, parts) = (call.arg(0)?.global()?, call.arg(1)?.dict()?);
    let name = parts.find("name").map_or(Ok(Value::Null), |name| labels::scalar(&name))?;
    match class.name {
        "RangeIndex" => {
            range(node, [parts.get("start")?, parts.get("stop")?, parts.get("step")?], name)
        }
        "MultiIndex" => levels(node, &parts, budget).map(Index::Levels),
        "IntervalIndex" => {
            let ends = [parts.get("left")?, parts.get("right")?];
            let (array, dtype) = intervals::of(node, ends, &parts.get("closed")?, budget)?;
            Ok(Index::Column(Box::new(Column { label: name, dtype, array }), None))
        }
        "Index" | "DatetimeIndex" | "TimedeltaIndex" | "CategoricalIndex" | "PeriodIndex" => {
            let data = parts.get("data")?;
            let freq = parts.find("freq").map_or(Ok(None), |freq| offsets::read(&freq))?;
            // `write` gives a regular index values that are an index themselves.
            let column = if data.any_call().is_ok_and(|call| call.global().is("pandas.Index")) {
                Column { label: name, ..listed(index(&data, budget)?, &data, budget)? }
            } else {
                let (array, dtype) = column(&data, budget)?;
                Column { label: name, dtype, array }
            };
            Ok(Index::Column(Box::new(column), freq))
        }
        _ => Err(node.unexpected("an index of labels, a range, times, periods or categories")),
    }
}

/// The levels of a `MultiIndex`: labels, codes into them, and a name each.
fn levels(node: &Node<'_>, parts: &Pairs<'_>, budget: &Budget) -> Result<Vec<Column>> {
    let (labels, codes) = (parts.get("levels")?.sequence()?, parts.get("codes")?.sequence()?);
    let names = parts.get("names")?.sequence()?;
    if labels.is_empty() || [codes.len(), names.len()] != [labels.len(); 2] {
        return Err(node.unexpected("as many codes and names as levels"));
    }
    let found = labels.iter().zip(codes.iter()).zip(names.iter()).map(|((labels, codes), name)| {
        let column = listed(index(&labels, budget)?, &labels, budget)?;
        let array = dictionary(&codes, column.array, budget)?;
        Ok(Column { label: labels::scalar(&name)?, dtype: column.dtype, array })
    });
    let found = found.collect::<Result<Vec<_>>>()?;
    let rows = found.first().map_or(0, |level| level.array.len());
    if found.iter().any(|level| level.array.len() != rows) {
        return Err(node.unexpected("levels of one length"));
    }
    Ok(found)
}

/// `pandas.Index(values, dtype, copy, name)`, `pandas.RangeIndex(start, stop, step, …, name)`.
fn constructed(node: &Node<'_>, call: &PickleCall<'_>, budget: &Budget) -> Result<Index> {
    if call.global().name == "RangeIndex" {
        let [start, stop, step, _, _, name] = call.args().exact()?;
        return range(node, [start, stop, step], labels::scalar(&name)?);
    }
    let [values, dtype, _, name] = call.args().exact()?;
    let (array, dtype) = typed(&values, &dtype, budget)?;
    let column = Column { label: labels::scalar(&name)?, dtype, array };
    Ok(Index::Column(Box::new(column), None))
}

fn range(node: &Node<'_>, [start, stop, step]: [Node<'_>; 3], name: Value) -> Result<Index> {
    let (start, stop, step) = (start.int()?, stop.int()?, step.int()?);
    if step == 0 {
        return Err(node.unexpected("a range with a step other than 0"));
    }
    Ok(Index::Range { start, stop, step, name })
}

/// The row of labels at `node`, and its name. Labels may be of several types, a column may not.
pub(super) fn axis(node: &Node<'_>, budget: &Budget) -> Result<(Vec<Value>, Value)> {
    let call = node.any_call()?;
    let listed = match call.global().name {
        "_new_Index" => {
            let parts = call.arg(1)?.dict()?;
            let objects = match parts.find("data").filter(Node::is_array).map(|data| data.array()) {
                Some(Ok(PickledArray::Objects { items, .. })) => Some(items),
                _ => None,
            };
            objects.map(|items| (items, parts.find("name")))
        }
        "Index" => match call.arg(0)?.view() {
            View::List(items) => Some((items, call.args().find(3))),
            _ => None,
        },
        // Written here: (tuples, sortorder, names).
        "MultiIndex.from_tuples" => Some((call.arg(0)?.list()?, call.args().find(2))),
        _ => None,
    };
    let Some((items, name)) = listed else { return labels_of(&index(node, budget)?, node, budget) };
    if items.len() > MAX_LABELS {
        return Err(node.unexpected(format!("at most {MAX_LABELS} columns")));
    }
    let name = name.map_or(Ok(Value::Null), |name| labels::scalar(&name))?;
    let labels = items.iter().map(|label| {
        let label = labels::scalar(&label)?;
        budget.take(node, label.size_hint())?;
        Ok(label)
    });
    Ok((labels.collect::<Result<_>>()?, name))
}

/// The values of an index, and its name.
fn labels_of(index: &Index, node: &Node<'_>, budget: &Budget) -> Result<(Vec<Value>, Value)> {
    if index.len() > MAX_LABELS {
        return Err(node.unexpected(format!("at most {MAX_LABELS} columns")));
    }
    match index {
        Index::Range { start, stop, step, name } => {
            Ok((range_labels(*start, *stop, *step).map(Value::Int).collect(), name.clone()))
        }
        Index::Levels(levels) => {
            let names = levels.iter().map(|level| level.label.clone()).collect();
            let mut rows: Vec<Vec<Value>> = vec![Vec::new(); index.len()];
            for level in levels {
                let dictionary = level.array.as_any_dictionary_opt();
                let found =
                    dictionary.and_then(|labels| Some((labels, labels::values(labels.values())?)));
                let (dictionary, labels) = found
                    .ok_or_else(|| node.unexpected("labels that are text, numbers or bools"))?;
                // No key is valid where there are no labels.
                let keys = if labels.is_empty() { vec![] } else { dictionary.normalized_keys() };
                for (number, row) in rows.iter_mut().enumerate() {
                    let key = keys.get(number).filter(|_| level.array.is_valid(number));
                    let label = key.and_then(|&key| labels.get(key)).cloned().unwrap_or_default();
                    budget.take(node, label.size_hint())?;
                    row.push(label);
                }
            }
            Ok((rows.into_iter().map(Value::Tuple).collect(), Value::Tuple(names)))
        }
        Index::Column(column, _) => {
            let labels = labels::values(&column.array);
            let labels =
                labels.ok_or_else(|| node.unexpected("labels that are text, numbers or bools"))?;
            Ok((labels, column.label.clone()))
        }
    }
}
