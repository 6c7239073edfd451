//! Arrow arrays as PyArrow pickles them.

use arrow_array::Array;
use arrow_data::ArrayData;
use arrow_data::transform::MutableArrayData;
use arrow_schema::DataType;
use bytes::Bytes;

use super::super::PluginError;
use super::{scalar, types};
use crate::pickle::Writer;
use wrapyfi_data::types::Table;

const LIB: &str = "pyarrow.lib";

/// Writes what the table was, by its origin's `kind`.
pub(super) fn table(to: &mut Writer, table: &Table) -> Result<(), PluginError> {
    let kind = table.origin.get("kind").unwrap_or("Table");
    let columns = table.batch.columns();
    match (kind, columns) {
        ("Array", [only]) => array(to, &only.to_data()),
        ("ChunkedArray", [only]) => chunked(to, &only.to_data()),
        ("Scalar", [only]) if only.len() == 1 => scalar::write(to, only),
        ("RecordBatch" | "Table", _) => {
            let (function, column): (_, fn(&mut Writer, &ArrayData) -> _) = match kind {
                "Table" => ("_reconstruct_table", chunked),
                _ => ("_reconstruct_record_batch", array),
            };
            to.global(LIB, function).list(columns, |to, array| column(to, &array.to_data()))?;
            types::write_schema(to, table.batch.schema_ref())?;
            to.tuple(2).reduce();
            Ok(())
        }
        (kind, columns) => Err(PluginError::unsupported(
            format!("a PyArrow {kind} of {} columns", columns.len()),
            "make it an Array of one column, a RecordBatch or a Table",
        )),
    }
}

fn chunked(to: &mut Writer, data: &ArrayData) -> Result<(), PluginError> {
    to.global(LIB, "chunked_array").list([data], array)?;
    types::write_type(to, data.data_type())?;
    to.tuple(2).reduce();
    Ok(())
}

/// Writes an array.
pub(crate) fn array(to: &mut Writer, data: &ArrayData) -> Result<(), PluginError> {
    to.global(LIB, "_restore_array");
    parts(to, data)?;
    to.tuple(1).reduce();
    Ok(())
}

/// `(type, length, null count, offset, [buffers], [children], dictionary)`, from the first element
/// on: a part of an array is copied out of it.
fn parts(to: &mut Writer, data: &ArrayData) -> Result<(), PluginError> {
    let whole = data.offset() == 0 && data.nulls().is_none_or(|nulls| nulls.offset() == 0);
    let copied;
    let data = if whole {
        data
    } else {
        let mut copy = MutableArrayData::new(vec![data], false, data.len());
        copy.try_extend(0, 0, data.len()).map_err(|error| {
            PluginError::unsupported(
                format!("a column of type {}: {error}", data.data_type()),
                "send fewer rows",
            )
        })?;
        copied = copy.freeze();
        &copied
    };
    to.mark();
    types::write_type(to, data.data_type())?;
    to.int(count(data.len())).int(count(data.null_count())).int(0);
    to.mark();
    match data.nulls() {
        Some(nulls) => buffer(to, nulls.buffer().as_slice()),
        None => _ = to.none(),
    }
    for content in data.buffers() {
        buffer(to, content.as_slice());
    }
    to.list_since_mark();
    let dictionary = matches!(data.data_type(), DataType::Dictionary(..));
    to.list(data.child_data().iter().filter(|_| !dictionary), parts)?;
    match data.child_data().first().filter(|_| dictionary) {
        Some(values) => parts(to, values)?,
        None => _ = to.none(),
    }
    to.tuple_since_mark();
    Ok(())
}

fn buffer(to: &mut Writer, content: &[u8]) {
    to.global(LIB, "py_buffer").buffer(Bytes::copy_from_slice(content)).tuple(1).reduce();
}

fn count(number: usize) -> i64 {
    i64::try_from(number).unwrap_or(i64::MAX)
}
