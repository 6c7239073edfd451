//! `PyArrowArray`: arrays and tables of PyArrow, as pickles with their buffers beside them.
//!
//! ```text
//!   _restore_array((type, length, null count, offset, [buffers], [children], dictionary))
//!   _reconstruct_table([chunked_array([…], type)], schema)      ◀─▶  Table
//!   _reconstruct_record_batch([…], schema)
//!   scalar(value, type)
//! ```
//!
//! | PyArrow | [`Table`] |
//! | --- | --- |
//! | `Array` of any kind | one column without a name, `kind` `Array` |
//! | `ChunkedArray` | the same with its chunks joined, `kind` `ChunkedArray` |
//! | `Scalar` of any kind | the same with one row, `kind` `Scalar` |
//! | `RecordBatch`, `Table` | its columns, `kind` `RecordBatch` or `Table`; chunks joined |
//!
//! Every buffer is checked against its type before it is used. Wrapyfi registers the key for arrays
//! and what they inherit from, which scalars and tables inherit from, too.

mod read;
mod scalar;
mod types;
mod write;

use std::sync::Arc;

use arrow_array::{ArrayRef, RecordBatch};
use arrow_schema::{ArrowError, Field, Schema};

use super::budget::Budget;
use super::pickled::{in_pickle, parts_of, pickled};
use super::{Body, Part, Plugin, PluginError, Unpacking};
use crate::pickle::{Allowed, Writer};
use wrapyfi_data::types::{Origin, Table, Value};

pub(super) use read::array;
pub(super) use types::type_name;
pub(super) use write::array as write_array;

/// Key on the wire.
pub(super) const KEY: &str = "PyArrowArray";

/// PyArrow's arrays and tables.
pub(super) struct PyArrow;

impl Plugin for PyArrow {
    fn key(&self) -> &str {
        KEY
    }

    fn decode(&self, body: &Body<'_>, context: &Unpacking<'_>) -> Result<Value, PluginError> {
        let read = pickled(body, &Allowed::PYARROW, context)?;
        read::table(&read.root(), &Budget::new(context.limits)).map_err(in_pickle).map(Value::from)
    }

    fn encode(&self, value: &Value) -> Result<Vec<Part>, PluginError> {
        let table = value.as_table().ok_or_else(|| PluginError::not_mine("table", value))?;
        let mut to = Writer::new();
        write::table(&mut to, table)?;
        Ok(parts_of(to))
    }
}

/// A table of one column.
fn single(array: ArrayRef, kind: &str) -> Result<Table, ArrowError> {
    let schema = Schema::new(vec![Field::new("", array.data_type().clone(), true)]);
    let batch = RecordBatch::try_new(Arc::new(schema), vec![array])?;
    Ok(Table { batch, origin: Arc::new(Origin::new(KEY).with("kind", kind)) })
}
