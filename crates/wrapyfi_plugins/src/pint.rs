//! `PintData`: a number with its unit.
//!
//! ```text
//!   ["PintData", base64 of {"magnitude": 1.5, "units": "meter"}, "Quantity"]  ◀─▶  Quantity
//! ```

use super::{Body, Part, Plugin, PluginError, Plugins, Unpacking};
use crate::malformed;
use wrapyfi_data::codec::json;
use wrapyfi_data::types::Value;

/// pint's `Quantity` with a single number.
pub(super) struct Pint;

impl Plugin for Pint {
    fn key(&self) -> &str {
        "PintData"
    }

    fn decode(&self, body: &Body<'_>, context: &Unpacking<'_>) -> Result<Value, PluginError> {
        let kind = body.text(1)?;
        if kind != "Quantity" {
            return Err(PluginError::unsupported(format!("a pint {kind:?}"), "send a Quantity"));
        }
        let text = body.base64(0)?;
        let limits = context.limits_within(text.len());
        // A quantity holds no plug-in objects.
        let text = json::decode(&text, &limits, &Plugins::none()).map_err(malformed)?;
        json::quantity(&text).map(Value::from).map_err(malformed)
    }

    fn encode(&self, value: &Value) -> Result<Vec<Part>, PluginError> {
        let quantity =
            value.as_quantity().ok_or_else(|| PluginError::not_mine("quantity", value))?;
        let text =
            json::encode(&json::quantity_body(quantity), &Plugins::none()).map_err(|error| {
                PluginError::unsupported(
                    format!("a magnitude of type {}", quantity.magnitude.kind()),
                    error.to_string(),
                )
            })?;
        Ok(vec![Part::base64(text), Part::Text("Quantity".into())])
    }
}
