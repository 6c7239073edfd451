//! dask's `Array`: a `.npy` file.
//!
//! ```text
//!   ["DaskData", "k05VTVBZ…", "Array", 1]  ◀─▶  Tensor { origin: DaskData { partitions: "1" }, … }
//! ```
//!
//! Wrapyfi sends 1 whatever the number of chunks was, and makes one chunk of a received array.

use super::dask::KEY;
use super::{Body, Part, PluginError};
use crate::codec::npy::{self, NpyArray};
use crate::types::{Origin, Tensor, Value};

/// Word for an array in the second part.
pub(super) const KIND: &str = "Array";

/// Attribute of the origin that keeps the last part.
const PARTITIONS: &str = "partitions";

pub(super) fn decode(body: &Body<'_>) -> Result<Value, PluginError> {
    let array = npy::read(&body.base64(0)?)
        .map_err(|error| PluginError::Malformed { part: 0, reason: error.to_string() })?;
    let NpyArray::Tensor(tensor) = array else {
        return Err(body.expected(0, "an array of numbers"));
    };
    let partitions = body.value(2)?.as_i64().filter(|&partitions| partitions > 0);
    let partitions = partitions.ok_or_else(|| body.expected(2, "a number above 0"))?;
    let origin = Origin::new(KEY).with(PARTITIONS, partitions.to_string());
    Ok(tensor.with_origin(origin).into())
}

pub(super) fn encode(tensor: &Tensor) -> Vec<Part> {
    let partitions = tensor.origin().and_then(|origin| origin.get(PARTITIONS)?.parse().ok());
    let partitions: i64 = partitions.unwrap_or(1);
    let (header, data) = npy::shared_parts(tensor);
    vec![
        Part::Base64(header.into(), data),
        Part::Text(KIND.to_owned()),
        Part::Value(partitions.into()),
    ]
}
