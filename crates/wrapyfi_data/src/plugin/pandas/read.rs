//! pandas's pickles into a [`Frame`].

use super::super::budget::Budget;
use super::column::{Typed, column, columns, dictionary, listed};
use super::frame::{Column, Frame, Index, Kind};
use super::{labels, made, offsets};
use crate::codec::pickle::{Node, Pairs, PickleCall, PickleError, View};
use crate::types::Value;

type Result<T> = std::result::Result<T, PickleError>;

/// Reads a data frame, a series or an index.
pub(super) fn frame(node: &Node<'_>, budget: &Budget) -> Result<Frame> {
    let call = node.any_call()?;
    match call.global().name {
        "DataFrame" if call.find_state().is_none() => made::data_frame(node, &call, budget),
        "Series" if call.find_state().is_none() => made::series(node, &call, budget),
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
    let (labels, columns_name) = labels::axis(&labels_axis, budget)?;
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
        let indices = slice.indices().filter(|indices| indices.len() <= count);
        return indices
            .map(Iterator::collect)
            .ok_or_else(|| node.unexpected(format!("places among {count} columns")));
    }
    match node.array()? {
        crate::codec::pickle::PickledArray::Tensor(tensor) => {
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
    let (array, dtype) = column(&values, budget)?;
    if array.len() != index.len() {
        return Err(node.unexpected(format!("a series of {} rows", index.len())));
    }
    let label = match state.find("_name").or_else(|| state.find("name")) {
        Some(name) => labels::scalar(&name)?,
        None => Value::Null,
    };
    let columns = vec![Column { label, dtype, array }];
    Ok(Frame { kind: Kind::Series, index, columns, columns_name: Value::Null })
}

/// Reads an index.
pub(super) fn index(node: &Node<'_>, budget: &Budget) -> Result<Index> {
    // Categories are an index, which may have categories.
    budget.deeper(node, || read_index(node, budget))
}

fn read_index(node: &Node<'_>, budget: &Budget) -> Result<Index> {
    let call = node.any_call()?;
    if matches!(call.global().name, "Index" | "RangeIndex") {
        return made::index(node, &call, budget);
    }
    let makers = ["_new_Index", "_new_DatetimeIndex", "_new_TimedeltaIndex"];
    if !makers.contains(&call.global().name) {
        return Err(node.unexpected("an index"));
    }
    let (class, parts) = (call.arg(0)?.global()?, call.arg(1)?.dict()?);
    let name = match parts.find("name") {
        Some(name) => labels::scalar(&name)?,
        None => Value::Null,
    };
    match class.name {
        "RangeIndex" => {
            let number = |key| parts.get(key)?.int();
            let (start, stop, step) = (number("start")?, number("stop")?, number("step")?);
            if step == 0 {
                return Err(node.unexpected("a range with a step other than 0"));
            }
            Ok(Index::Range { start, stop, step, name })
        }
        "MultiIndex" => levels(node, &parts, budget).map(Index::Levels),
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

/// True for a plain value, which may be a label.
pub(super) fn is_scalar(node: &Node<'_>) -> bool {
    matches!(node.view(), View::None | View::Bool(_) | View::Int(_) | View::Float(_) | View::Str(_))
}
