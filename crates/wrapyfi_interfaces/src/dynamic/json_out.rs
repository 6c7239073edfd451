//! Messages to JSON.
//!
//! Objects have their fields in the definition's order, `uint8[]` is an array of numbers, and
//! numbers that JSON lacks are the strings `"NaN"`, `"Infinity"` and `"-Infinity"`.

use serde::ser::{Serialize, Serializer};

use super::value::Number;
use super::{DynamicMessage, Primitives};
use crate::with_elements;

impl DynamicMessage {
    /// The message as JSON. A [`serde_json::Value`] may sort the fields by name;
    /// [`serde_json::to_string`] of the message itself keeps their order.
    pub fn to_json(&self) -> serde_json::Value {
        // Keys are strings and numbers are finite: nothing here fails.
        serde_json::to_value(self).unwrap_or_default()
    }
}

impl Serialize for DynamicMessage {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.fields())
    }
}

impl Serialize for Primitives {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::F32(values) => serializer.collect_seq(values.iter().copied().map(Number)),
            Self::F64(values) => serializer.collect_seq(values.iter().copied().map(Number)),
            Self::Bytes(values) => serializer.collect_seq(values.iter()),
            other => with_elements!(other, values => serializer.collect_seq(values)),
        }
    }
}
