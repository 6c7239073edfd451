//! pandas's pickles into a [`Frame`].

use super::super::budget::Budget;
use super::column::{Typed, column, columns, typed};
use super::frame::{Column, Frame, Index, Kind};
use super::index::{axis, index};
use super::labels;
use crate::pickle::{Node, PickleCall, PickleError, PickledArray};
use wrapyfi_data::types::Value;

type Result<T> = std::result::Result<T, PickleError>;

/// Reads a data frame, a series or an index.
pub(super) fn frame(node: &Node<'_>, budget: &Budget) -> Result<Frame> {
    let call = node.any_call()?;
    match call.global().name {
        "DataFrame" if call.find_state().is_none_or(|state| relabelled(&state).is_some()) => {
            constructed_frame(node, &call, budget)
        }
        "Series" if call.find_state().is_none() => constructed_series(node, &call, budget),
        "DataFrame" => data_frame(node, &call, budget),
        "Series" => series(node, &call, budget),
        _ => Ok(Frame {
            kind: Kind::Index,
            index: index(node, budget)?,
            columns: Vec::new(),
            columns_name: Value::Null,
        }),
    }
}

/// Refuses what a table has no place for: attributes, and flags other than usual.
fn check_extras(state: &Node<'_>) -> Result<()> {
    let state = state.dict()?;
    if let Some(attributes) = state.find("attrs")
        && !attributes.dict()?.is_empty()
    {
        return Err(attributes.unexpected("no attributes (attrs)"));
    }
    Ok(())
}

fn data_frame(node: &Node<'_>, call: &PickleCall<'_>, budget: &Budget) -> Result<Frame> {
    let state = call.state()?;
    check_extras(&state)?;
    let blocks = state.dict()?.get("_mgr")?.call("pandas.core.internals.managers.BlockManager")?;
    let [labels_axis, index_axis] = blocks.arg(1)?.sequence()?.exact()?;
    let (labels, columns_name) = axis(&labels_axis, budget)?;
    let index = index(&index_axis, budget)?;
    budget.take(node, labels.len().saturating_mul(size_of::<Column>()))?;
    let mut places: Vec<Option<Typed>> = labels.iter().map(|_| None).collect();
    for block in blocks.arg(0)?.sequence()?.iter() {
        let block = block.call("pandas._libs.internals._unpickle_block")?;
        let found = columns(&block.arg(0)?, budget)?;
        let placement = block.arg(1)?;
        let wanted = placement_of(&placement, labels.len())?;
        if wanted.len() != found.len() {
            let text = format!("places for {} columns", found.len());
            return Err(placement.unexpected(text));
        }
        for (place, typed) in wanted.into_iter().zip(found) {
            match places.get_mut(place) {
                Some(free @ None) => *free = Some(typed),
                _ => return Err(placement.unexpected("places of columns that are free")),
            }
        }
    }
    let mut columns = Vec::with_capacity(labels.len());
    for (label, place) in labels.into_iter().zip(places) {
        let (array, dtype) = place.ok_or_else(|| node.unexpected("a block for every column"))?;
        if array.len() != index.len() {
            return Err(node.unexpected(format!("columns of {} rows", index.len())));
        }
        columns.push(Column { label, dtype, array });
    }
    Ok(Frame { kind: Kind::Frame, index, columns, columns_name })
}

/// A `slice`, or an array of positions.
fn placement_of(node: &Node<'_>, count: usize) -> Result<Vec<usize>> {
    if let Ok(slice) = node.slice() {
        let indices = slice.filter(|indices| indices.len() <= count);
        return indices
            .map(Iterator::collect)
            .ok_or_else(|| node.unexpected(format!("places among {count} columns")));
    }
    match node.array()? {
        PickledArray::Tensor(tensor) => {
            let places = tensor.to_vec::<i64>().unwrap_or_default();
            let places =
                places.into_iter().map(usize::try_from).collect::<std::result::Result<_, _>>();
            places.map_err(|_negative| node.unexpected("places that are not negative"))
        }
        _ => Err(node.unexpected("places of columns")),
    }
}

fn series(node: &Node<'_>, call: &PickleCall<'_>, budget: &Budget) -> Result<Frame> {
    let state = call.state()?;
    check_extras(&state)?;
    let state = state.dict()?;
    let manager = state.get("_mgr")?.call("pandas.core.internals.managers.SingleBlockManager")?;
    let manager = manager.state()?.tuple()?;
    let [axis] = manager.get(0)?.sequence()?.exact()?;
    let [values] = manager.get(1)?.sequence()?.exact()?;
    let index = index(&axis, budget)?;
    let typed = column(&values, budget)?;
    let label = state.find("_name").or_else(|| state.find("name"));
    series_of(node, index, typed, label)
}

fn series_of(
    node: &Node<'_>,
    index: Index,
    (array, dtype): Typed,
    label: Option<Node<'_>>,
) -> Result<Frame> {
    if array.len() != index.len() {
        return Err(node.unexpected(format!("a series of {} rows", index.len())));
    }
    let label = label.map_or(Ok(Value::Null), |name| labels::scalar(&name))?;
    let columns = vec![Column { label, dtype, array }];
    Ok(Frame { kind: Kind::Series, index, columns, columns_name: Value::Null })
}

/// `pandas.DataFrame({label: series, …}, index, columns)`.
fn constructed_frame(node: &Node<'_>, call: &PickleCall<'_>, budget: &Budget) -> Result<Frame> {
    let [content, rows, columns] = call.args().exact()?;
    let (names, mut columns_name) = axis(&columns, budget)?;
    let index = index(&rows, budget)?;
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
    let mut columns = columns.collect::<Result<Vec<_>>>()?;
    if let Some(relabelled) = call.find_state().and_then(|state| relabelled(&state)) {
        let names;
        (names, columns_name) = axis(&relabelled, budget)?;
        if names.len() != columns.len() {
            return Err(relabelled.unexpected(format!("labels of {} columns", columns.len())));
        }
        columns.iter_mut().zip(names).for_each(|(column, label)| column.label = label);
    }
    Ok(Frame { kind: Kind::Frame, index, columns, columns_name })
}

/// Labels that a frame is given after it was made, because some are equal.
fn relabelled<'a>(state: &Node<'a>) -> Option<Node<'a>> {
    state.dict().ok()?.find("columns")
}

/// `pandas.Series(values, index, dtype, name)`.
fn constructed_series(node: &Node<'_>, call: &PickleCall<'_>, budget: &Budget) -> Result<Frame> {
    let [values, rows, dtype, name] = call.args().exact()?;
    let index = index(&rows, budget)?;
    series_of(node, index, typed(&values, &dtype, budget)?, Some(name))
}
