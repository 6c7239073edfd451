//! `PandasData`: data frames, series and indices of pandas, as pickles with their buffers beside
//! them.
//!
//! ```text
//!   DataFrame { _mgr: BlockManager([blocks of columns], [labels, index]) } ─ read ─▶ Frame ─▶ Table
//!   pandas.DataFrame({label: Series(…), …}, index, columns) ◀─ write ─ Frame ◀─ Table
//! ```
//!
//! pandas pickles its insides, which change from release to release: those of pandas 2 and 3 are
//! read. What is written calls the constructors that every release has, so that any pandas reads it.
//!
//! The columns of the [`Table`](wrapyfi_data::types::Table) are Arrow arrays, an index that is no range
//! before all others, one column for each of its levels. Of each field the metadata `dtype` is
//! pandas's own name of the type. A frame that this cannot hold in full is refused and travels on as
//! it came: objects of other types than Python's own, sparse and complex columns.

mod cells;
mod column;
mod frame;
mod index;
mod intervals;
mod json;
mod labels;
mod objects;
mod offsets;
mod read;
mod write;

use super::budget::Budget;
use super::pickled::{in_pickle, parts_of, pickled};
use super::{Body, Part, Plugin, PluginError, Unpacking};
use crate::pickle::{Allowed, Writer};
use frame::Frame;
use wrapyfi_data::types::Value;

pub(super) use json::{read_records, write_records};

/// pandas of release 2 and later.
pub(super) struct Pandas;

impl Plugin for Pandas {
    fn key(&self) -> &str {
        "PandasData"
    }

    fn decode(&self, body: &Body<'_>, context: &Unpacking<'_>) -> Result<Value, PluginError> {
        let pickle = pickled(body, &Allowed::PANDAS, context)?;
        let frame = read::frame(&pickle.root(), &Budget::new(context.limits)).map_err(in_pickle)?;
        frame.into_table("PandasData").map(Value::from)
    }

    fn encode(&self, value: &Value) -> Result<Vec<Part>, PluginError> {
        let table = value.as_table().ok_or_else(|| PluginError::not_mine("table", value))?;
        let mut to = Writer::new();
        write::frame(&mut to, &Frame::from_table(table)?)?;
        Ok(parts_of(to))
    }
}

/// pandas before release 2: JSON.
pub(super) struct PandasLegacy;

impl Plugin for PandasLegacy {
    fn key(&self) -> &str {
        "PandasLegacyData"
    }

    fn decode(&self, body: &Body<'_>, context: &Unpacking<'_>) -> Result<Value, PluginError> {
        json::read_split(body, context)?.into_table("PandasLegacyData").map(Value::from)
    }

    fn encode(&self, value: &Value) -> Result<Vec<Part>, PluginError> {
        let table = value.as_table().ok_or_else(|| PluginError::not_mine("table", value))?;
        json::write_split(&Frame::from_table(table)?)
    }
}
