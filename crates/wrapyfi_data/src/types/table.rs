//! Tables: data frames, series, indices and Arrow data, as Arrow record batches.

use std::sync::Arc;

use arrow_array::RecordBatch;

use super::Origin;

/// A data frame of pandas or dask, or an array or a table of PyArrow.
///
/// The columns are Arrow arrays, for every Rust library that takes them; what makes them a frame
/// again (which columns are the index, labels that are no text, …) is in `origin`, written and read
/// by the plug-in that `origin.key` names.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::types; }
/// use std::sync::Arc;
/// use arrow_array::{Int64Array, RecordBatch, cast::AsArray, types::Int64Type};
/// use wrapyfi_core::types::{Table, Value};
///
/// let speeds = Arc::new(Int64Array::from(vec![1, 2, 3])) as _;
/// let table = Table::frame(RecordBatch::try_from_iter([("speed", speeds)])?);
/// let value = Value::from(table);
/// let column = value.as_table().unwrap().batch.column(0).as_primitive::<Int64Type>();
/// assert_eq!(column.value(2), 3);
/// # Ok::<(), arrow_schema::ArrowError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// The columns, index columns first.
    pub batch: RecordBatch,
    /// Library object that the table was, or shall become.
    pub origin: Arc<Origin>,
}

impl Table {
    /// A pandas `DataFrame` with the default index.
    pub fn frame(batch: RecordBatch) -> Self {
        Self { batch, origin: Arc::new(Origin::new("PandasData")) }
    }

    pub(crate) fn key(&self) -> &str {
        &self.origin.key
    }

    pub(crate) fn memory_bytes(&self) -> usize {
        self.batch.get_array_memory_size()
    }
}
