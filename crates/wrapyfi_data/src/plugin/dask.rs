//! `DaskData`: arrays and frames of dask, told apart by the second part.
//!
//! ```text
//!   ["DaskData", base64, "Array",                 partitions]   dask_array.rs  ◀─▶ Tensor
//!   ["DaskData", base64, "DataFrame" | "Series",  partitions]   dask_frame.rs  ◀─▶ Table
//! ```

#[cfg(feature = "tables")]
use super::dask_frame;
use super::{Body, Part, Plugin, PluginError, Unpacking, dask_array};
use crate::types::Value;

/// dask's `Array`, `DataFrame` and `Series`.
pub(super) struct Dask;

/// Key of the plug-in, for origins.
pub(super) const KEY: &str = "DaskData";

impl Plugin for Dask {
    fn key(&self) -> &str {
        KEY
    }

    #[cfg_attr(not(feature = "tables"), allow(unused_variables, reason = "frames alone have it"))]
    fn decode(&self, body: &Body<'_>, context: &Unpacking<'_>) -> Result<Value, PluginError> {
        match &*body.text(1)? {
            dask_array::KIND => dask_array::decode(body),
            #[cfg(feature = "tables")]
            kind if dask_frame::KINDS.contains(&kind) => dask_frame::decode(body, kind, context),
            other => Err(PluginError::Unsupported {
                what: format!("a dask {other:?}"),
                remedy: if cfg!(feature = "tables") {
                    "send an Array, a DataFrame or a Series".into()
                } else {
                    "send an Array, or build with feature `tables`".into()
                },
            }),
        }
    }

    fn encode(&self, value: &Value) -> Result<Vec<Part>, PluginError> {
        match value {
            Value::Tensor(tensor) => Ok(dask_array::encode(tensor)),
            #[cfg(feature = "tables")]
            Value::Table(table) => dask_frame::encode(table),
            other => Err(PluginError::not_mine("tensor or table", other)),
        }
    }
}
