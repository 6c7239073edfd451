//! `DaskData`: arrays and frames of dask, told apart by the second part.
//!
//! ```text
//!   ["DaskData", base64, "Array",                 partitions]   dask_array.rs  ◀─▶ Tensor
//!   ["DaskData", base64, "DataFrame" | "Series",  partitions]
//! ```

use super::{Body, Context, Part, Plugin, PluginError, dask_array};
use crate::types::Value;

/// dask's `Array`, `DataFrame` and `Series`.
pub(super) struct Dask;

/// Key of the plug-in, for origins.
pub(super) const KEY: &str = "DaskData";

impl Plugin for Dask {
    fn key(&self) -> &str {
        KEY
    }

    fn decode(&self, body: &Body<'_>, _context: &Context<'_>) -> Result<Value, PluginError> {
        match &*body.text(1)? {
            dask_array::KIND => dask_array::decode(body),
            other => Err(PluginError::Unsupported {
                what: format!("a dask {other:?}"),
                remedy: "send an Array".into(),
            }),
        }
    }

    fn encode(&self, value: &Value) -> Result<Vec<Part>, PluginError> {
        match value {
            Value::Tensor(tensor) => Ok(dask_array::encode(tensor)),
            other => Err(PluginError::not_mine("tensor", other)),
        }
    }
}
