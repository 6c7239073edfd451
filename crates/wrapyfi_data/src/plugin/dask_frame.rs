//! dask's `DataFrame` and `Series`: records as pandas writes them.
//!
//! ```text
//!   ["DaskData", base64 of [{"index": 0, "a": 1}, …], "DataFrame", 2]  ◀─▶  Table
//! ```
//!
//! Wrapyfi makes a frame of one column of a received series; here it stays a series.

use super::dask::KEY;
use super::pandas::{read_records, write_records};
use super::{Body, Part, PluginError, Unpacking};
use crate::types::{Table, Value};

/// Words for frames and series in the second part.
pub(super) const KINDS: [&str; 2] = ["DataFrame", "Series"];

/// Attribute of the origin that keeps the last part.
const PARTITIONS: &str = "partitions";

pub(super) fn decode(
    body: &Body<'_>,
    kind: &str,
    context: &Unpacking<'_>,
) -> Result<Value, PluginError> {
    let mut table = read_records(&body.base64(0)?, kind == "Series", context)?;
    let partitions = body.value(2)?.as_i64().filter(|&partitions| partitions > 0);
    let partitions = partitions.ok_or_else(|| body.expected(2, "a number above 0"))?;
    table.origin = (*table.origin).clone().with(PARTITIONS, partitions.to_string()).into();
    Ok(table.into())
}

pub(super) fn encode(table: &Table) -> Result<Vec<Part>, PluginError> {
    debug_assert_eq!(table.origin.key, KEY);
    let (records, is_series) = write_records(table)?;
    let partitions = table.origin.get(PARTITIONS).and_then(|text| text.parse().ok());
    let partitions: i64 = partitions.unwrap_or(1);
    let kind = if is_series { "Series" } else { "DataFrame" };
    Ok(vec![Part::base64(records), Part::Text(kind.into()), Part::Value(partitions.into())])
}
