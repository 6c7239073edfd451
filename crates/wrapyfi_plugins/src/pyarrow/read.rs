//! Pickled arrays of PyArrow into Arrow arrays.

use arrow_array::{ArrayRef, make_array};
use arrow_buffer::Buffer;
use arrow_data::transform::MutableArrayData;
use arrow_data::{ArrayData, ArrayDataBuilder};
use arrow_schema::{ArrowError, DataType};

use super::super::budget::Budget;
use super::{KEY, scalar, single, types};
use crate::pickle::{Node, PickleError};
use wrapyfi_data::types::arrow::batch;
use wrapyfi_data::types::{Origin, Table};

/// Elements that an array may have without bytes for them.
const FREE: usize = 1 << 16;
/// Deepest nesting of an array.
const MAX_DEPTH: usize = 64;

type Result<T> = std::result::Result<T, PickleError>;

/// Reads whatever PyArrow pickles as a table.
pub(super) fn table(node: &Node<'_>, budget: &Budget) -> Result<Table> {
    let call = node.any_call()?;
    let invalid = |error: ArrowError| invalid(node, error);
    match call.global().name {
        "_restore_array" => single(array(node, budget)?, "Array").map_err(invalid),
        "scalar" => single(scalar::read(&call, budget)?, "Scalar").map_err(invalid),
        "chunked_array" => single(array(node, budget)?, "ChunkedArray").map_err(invalid),
        name @ ("_reconstruct_table" | "_reconstruct_record_batch") => {
            let schema = types::schema(&call.arg(1)?, budget)?;
            let columns = call.arg(0)?.sequence()?;
            let columns =
                columns.iter().map(|column| array(&column, budget)).collect::<Result<Vec<_>>>()?;
            let rows = columns.first().map_or(0, |column| column.len());
            let kind = if name == "_reconstruct_table" { "Table" } else { "RecordBatch" };
            let batch = batch(schema, columns, rows).map_err(invalid)?;
            Ok(Table { batch, origin: Origin::new(KEY).with("kind", kind).into() })
        }
        _ => Err(node.unexpected("an array or table of PyArrow")),
    }
}

/// Reads an array, or a chunked one with its chunks joined.
pub(crate) fn array(node: &Node<'_>, budget: &Budget) -> Result<ArrayRef> {
    let call = node.any_call()?;
    if call.global().is("pyarrow.lib._restore_array") {
        return restore(&call.arg(0)?, budget, 0).map(make_array);
    }
    let call = node.call("pyarrow.lib.chunked_array")?;
    let chunks = call.arg(0)?.sequence()?;
    let chunks = chunks
        .iter()
        .map(|chunk| restore(&chunk.call("pyarrow.lib._restore_array")?.arg(0)?, budget, 0))
        .collect::<Result<Vec<_>>>()?;
    let data_type = types::data_type(&call.arg(1)?, budget)?;
    if chunks.iter().any(|chunk| *chunk.data_type() != data_type) {
        return Err(node.unexpected(format!("chunks of type {data_type}")));
    }
    Ok(make_array(match <[ArrayData; 1]>::try_from(chunks) {
        Ok([only]) => only,
        Err(chunks) => {
            let sizes = chunks.iter().map(ArrayData::get_buffer_memory_size);
            budget.take(node, sizes.fold(0, usize::saturating_add))?;
            join(&chunks, &data_type).map_err(|error| invalid(node, error))?
        }
    }))
}

/// All elements of `chunks`, which are of one type, one behind the other.
fn join(chunks: &[ArrayData], data_type: &DataType) -> std::result::Result<ArrayData, ArrowError> {
    if chunks.is_empty() {
        return Ok(ArrayData::new_empty(data_type));
    }
    let length = chunks.iter().map(ArrayData::len).sum();
    let mut joined = MutableArrayData::new(chunks.iter().collect(), false, length);
    for (index, chunk) in chunks.iter().enumerate() {
        joined.try_extend(index, 0, chunk.len())?;
    }
    Ok(joined.freeze())
}

/// `(type, length, null count, offset, [buffers], [children], dictionary)`.
fn restore(node: &Node<'_>, budget: &Budget, depth: usize) -> Result<ArrayData> {
    budget.take(node, size_of::<ArrayData>() * 4)?;
    if depth > MAX_DEPTH {
        return Err(node.unexpected(format!("an array nested at most {MAX_DEPTH} deep")));
    }
    let parts = node.tuple()?;
    let data_type = types::data_type(&parts.get(0)?, budget)?;
    let (length, offset) = (parts.get(1)?.size()?, parts.get(3)?.size()?);
    let mut buffers = parts
        .get(4)?
        .sequence()?
        .iter()
        .map(|buffer| buffer.option().map(|buffer| read_buffer(&buffer)).transpose())
        .collect::<Result<Vec<_>>>()?
        .into_iter();
    let mut children = parts
        .get(5)?
        .sequence()?
        .iter()
        .map(|child| restore(&child, budget, depth + 1))
        .collect::<Result<Vec<_>>>()?;
    if let Some(dictionary) = parts.find(6).and_then(Node::option) {
        // Some releases wrap the dictionary in a call, others do not.
        let parts = match dictionary.call("pyarrow.lib._restore_array") {
            Ok(call) => call.arg(0)?,
            Err(_bare) => dictionary,
        };
        children.push(restore(&parts, budget, depth + 1)?);
    }
    let validity = buffers.next().flatten().filter(|_| data_type != DataType::Null);
    // An empty array may come without its buffers.
    let empty = || Buffer::from(vec![0_u8; 16]);
    let mut data: Vec<_> = buffers.map(|buffer| buffer.unwrap_or_else(empty)).collect();
    if length == 0 && offset == 0 {
        let wanted = ArrayData::new_empty(&data_type).buffers().len();
        data.resize_with(wanted, empty);
        for buffer in &mut data {
            if buffer.is_empty() {
                *buffer = empty();
            }
        }
    }
    // Arrow panics where the first buffer ends inside an element.
    let width = match &data_type {
        DataType::Utf8 | DataType::Binary | DataType::List(_) | DataType::Map(..) => {
            size_of::<i32>()
        }
        DataType::LargeUtf8 | DataType::LargeBinary | DataType::LargeList(_) => size_of::<i64>(),
        DataType::Dictionary(codes, _) => codes.primitive_width().unwrap_or(1),
        other => other.primitive_width().unwrap_or(1),
    };
    if let Some(first) = data.first_mut() {
        *first = first.slice_with_length(0, first.len() - first.len() % width.max(1));
    }
    ArrayDataBuilder::new(data_type)
        .len(length)
        .offset(offset)
        .null_bit_buffer(validity)
        .buffers(data)
        .child_data(children)
        .align_buffers(true)
        .build()
        .and_then(|data| data.validate_full().map(|()| data))
        .map_err(|error| invalid(node, error))
        .and_then(|data| {
            // Elements without bytes, such as nulls, could be claimed in any number.
            let most = data.get_buffer_memory_size().saturating_mul(8).saturating_add(FREE);
            if data.len() <= most {
                return Ok(data);
            }
            Err(invalid(node, format!("{} elements where at most {most} fit", data.len())))
        })
}

fn read_buffer(node: &Node<'_>) -> Result<Buffer> {
    Ok(Buffer::from(node.call("pyarrow.lib.py_buffer")?.arg(0)?.bytes()?))
}

fn invalid(node: &Node<'_>, reason: impl std::fmt::Display) -> PickleError {
    node.invalid("Arrow array", reason.to_string())
}
