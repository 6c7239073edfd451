//! Intervals: a struct of their ends, whose sides the name of the type tells: `interval[int64, right]`.

use std::sync::Arc;

use arrow_array::cast::AsArray as _;
use arrow_array::{Array as _, ArrayRef, StructArray};
use arrow_schema::{Field, Fields};

use super::super::budget::Budget;
use super::column::{Typed, column, listed};
use super::frame::Column;
use super::index::index;
use crate::pickle::{Node, PickleCall, PickleError};
use wrapyfi_data::types::Value;

type Result<T> = std::result::Result<T, PickleError>;

/// Begin of the names of types of intervals.
pub(super) const DTYPE: &str = "interval[";

/// Sides that belong to the intervals.
const CLOSED: [&str; 4] = ["left", "right", "both", "neither"];

/// Name of pandas's type in a field's metadata.
const OF: &str = super::frame::DTYPE;

/// Reads an array of intervals: `from_arrays(left, right, closed)`, or an empty one with its state.
pub(super) fn read(node: &Node<'_>, call: &PickleCall<'_>, budget: &Budget) -> Result<Typed> {
    if call.global().name == "IntervalArray.from_arrays" {
        let [left, right, closed] = call.args().exact()?;
        return of(node, [left, right], &closed, budget);
    }
    let state = call.state()?.tuple()?.get(0)?;
    let state = state.dict()?;
    let dtype = state.get("_dtype")?.any_call()?;
    let closed = match dtype.find_state() {
        Some(state) => state.dict()?.get("closed")?,
        None => dtype.arg(1)?,
    };
    of(node, [state.get("_left")?, state.get("_right")?], &closed, budget)
}

/// Intervals between these ends.
pub(super) fn of(
    node: &Node<'_>,
    ends: [Node<'_>; 2],
    closed: &Node<'_>,
    budget: &Budget,
) -> Result<Typed> {
    let sides = closed.str()?;
    if !CLOSED.contains(&sides) {
        return Err(closed.unexpected("left, right, both or neither"));
    }
    let [(left, dtype), (right, other)] = [end(&ends[0], budget)?, end(&ends[1], budget)?];
    let field = |name: &str, array: &ArrayRef, dtype: &str| {
        let field = Field::new(name, array.data_type().clone(), true);
        field.with_metadata([(OF.to_owned(), dtype.to_owned())])
    };
    let fields = [field("left", &left, &dtype), field("right", &right, &other)];
    let array = StructArray::try_new(Fields::from_iter(fields), vec![left, right], None);
    let array = array.map_err(|error| node.unexpected(format!("ends of intervals: {error}")))?;
    Ok((Arc::new(array), format!("{DTYPE}{dtype}, {sides}]")))
}

fn end(node: &Node<'_>, budget: &Budget) -> Result<Typed> {
    if node.any_call().is_ok_and(|call| call.global().name.contains("Index")) {
        let Column { array, dtype, .. } = listed(index(node, budget)?, node, budget)?;
        return Ok((array, dtype));
    }
    column(node, budget)
}

/// Ends of the intervals in a column, and the sides that belong to them; `None` for a column of anything else.
pub(super) fn ends(column: &Column) -> Option<([Column; 2], &str)> {
    let (_, sides) = column.dtype.strip_prefix(DTYPE)?.strip_suffix(']')?.rsplit_once(", ")?;
    let ends = column.array.as_struct_opt().filter(|_| CLOSED.contains(&sides))?;
    let ends: Vec<Column> = ends
        .fields()
        .iter()
        .zip(ends.columns())
        .map(|(field, array)| Column {
            label: Value::Null,
            dtype: field.metadata().get(OF).cloned().unwrap_or_default(),
            array: Arc::clone(array),
        })
        .collect();
    Some((ends.try_into().ok()?, sides))
}
