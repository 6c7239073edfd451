//! `DaskData`: arrays and frames of dask, told apart by the second part.
//!
//! ```text
//!   ["DaskData", base64 of a .npy file, "Array", partitions]                       ◀─▶ Tensor
//!   ["DaskData", base64 of [{"index": 0, "a": 1}, …], "DataFrame" | "Series", 2]   ◀─▶ Table
//! ```
//!
//! Of an array Wrapyfi sends 1 whatever the number of chunks was, and makes one chunk of a received one. It makes a
//! frame of one column of a received series; here it stays a series.

#[cfg(feature = "tables")]
use super::pandas::{read_records, write_records};
use super::{Body, Part, Plugin, PluginError, Unpacking};
use crate::malformed;
use wrapyfi_data::codec::npy::{self, NpyArray};
use wrapyfi_data::types::{Origin, Value};

/// dask's `Array`, `DataFrame` and `Series`.
pub(super) struct Dask;

/// Key of the plug-in, for origins.
const KEY: &str = "DaskData";
/// Attribute of the origin that keeps the last part.
const PARTITIONS: &str = "partitions";

impl Plugin for Dask {
    fn key(&self) -> &str {
        KEY
    }

    #[cfg_attr(not(feature = "tables"), allow(unused_variables, reason = "frames alone have it"))]
    fn decode(&self, body: &Body<'_>, context: &Unpacking<'_>) -> Result<Value, PluginError> {
        let partitions = || -> Result<String, PluginError> {
            let partitions = body.value(2)?.as_i64().filter(|&partitions| partitions > 0);
            let partitions = partitions.ok_or_else(|| body.expected(2, "a number above 0"))?;
            Ok(partitions.to_string())
        };
        match &*body.text(1)? {
            "Array" => {
                let array = npy::read(&body.base64(0)?).map_err(malformed)?;
                let NpyArray::Tensor(tensor) = array else {
                    return Err(body.expected(0, "an array of numbers"));
                };
                let origin = Origin::new(KEY).with(PARTITIONS, partitions()?);
                Ok(tensor.with_origin(origin).into())
            }
            #[cfg(feature = "tables")]
            kind @ ("DataFrame" | "Series") => {
                let mut table = read_records(&body.base64(0)?, kind == "Series", context)?;
                table.origin = (*table.origin).clone().with(PARTITIONS, partitions()?).into();
                Ok(table.into())
            }
            other => Err(PluginError::unsupported(
                format!("a dask {other:?}"),
                if cfg!(feature = "tables") {
                    "send an Array, a DataFrame or a Series"
                } else {
                    "send an Array, or build with feature `tables`"
                },
            )),
        }
    }

    fn encode(&self, value: &Value) -> Result<Vec<Part>, PluginError> {
        let (content, kind, origin) = match value {
            Value::Tensor(tensor) => {
                let (header, data) = npy::shared_parts(tensor);
                (Part::Base64(header.into(), data), "Array", tensor.origin())
            }
            #[cfg(feature = "tables")]
            Value::Table(table) => {
                debug_assert_eq!(table.origin.key, KEY);
                let (records, is_series) = write_records(table)?;
                let kind = if is_series { "Series" } else { "DataFrame" };
                (Part::base64(records), kind, Some(&*table.origin))
            }
            other => return Err(PluginError::not_mine("tensor or table", other)),
        };
        let partitions = origin.and_then(|origin| origin.get(PARTITIONS)?.parse().ok());
        let partitions: i64 = partitions.unwrap_or(1);
        Ok(vec![content, Part::Text(kind.into()), Part::Value(partitions.into())])
    }
}
