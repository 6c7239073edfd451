//! The key `options` of a route: settings that only some middlewares have.
//!
//! ```text
//!   options: { carrier: fast_tcp, joints: [neck, eye] }  ──▶  Map of values, known at one end at least
//! ```
//!
//! The middleware that reads an option checks its value.

use std::collections::BTreeMap;

use serde_saphyr::Spanned;
use wrapyfi_data::did_you_mean;

use super::config_error::Problem;
use super::plan_address::Available;
use wrapyfi_data::types::{Map, Value, to_value};
use wrapyfi_endpoint::EndpointAddress;

/// Reads the options of a route between `ends`.
pub(super) fn read(
    written: &BTreeMap<String, Spanned<serde_json::Value>>,
    ends: [&EndpointAddress; 2],
    middlewares: &[Available<'_>],
) -> Result<Map, Vec<Problem>> {
    let known: Vec<&str> = middlewares
        .iter()
        .filter(|middleware| ends.iter().any(|end| end.middleware == middleware.name))
        .flat_map(|middleware| middleware.options.iter().copied())
        .collect();
    let mut problems = Vec::new();
    let mut options = Map::default();
    for (name, value) in written {
        let mut complain = |text| problems.push(Problem::at(value.referenced, text));
        let [from, to] = ends.map(|end| end.middleware.as_str());
        if let Err(unknown) = known_option(name, &known, &format!("between {from} and {to}")) {
            complain(unknown);
            continue;
        }
        match to_value(&value.value) {
            Ok(read) => {
                options.insert(name.as_str(), plain(read));
            }
            Err(error) => complain(format!("option {name}: {error}")),
        }
    }
    if problems.is_empty() { Ok(options) } else { Err(problems) }
}

/// Refuses an option whose name is not among those `known` at `place`, such as `on yarp`.
///
/// # Errors
/// When there is no such option; the text names those that exist, and the one that is probably
/// meant.
pub fn known_option(name: &str, known: &[&str], place: &str) -> Result<(), String> {
    if known.contains(&name) {
        return Ok(());
    }
    let hint = did_you_mean(name, known);
    let names = if known.is_empty() { "none".to_owned() } else { known.join(", ") };
    Err(format!("option {name} is unknown {place}; {hint}options here: {names}"))
}

/// Keeps lists of numbers as lists, because options are written by hand and read one by one.
fn plain(value: Value) -> Value {
    match value {
        Value::Tensor(tensor) => {
            wrapyfi_data::types::nested_list(&tensor).unwrap_or(Value::Tensor(tensor))
        }
        other => other,
    }
}
