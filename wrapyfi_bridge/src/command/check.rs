//! `wrapyfi check`: validates a configuration, prints what it would run or what it changes of another, and
//! warns of routes that do not hear each other.

use std::path::Path;

use super::bridge::warn_of_unheard;
use crate::exit::Failure;
use crate::middlewares::{self, Loaded};
use crate::node::Node;
use crate::output;
use crate::reload::Fixed;

/// Prints the plan, a route a line; with `against`, what it changes for a bridge that runs with that file.
///
/// # Errors
/// Exit code 2 with every fault of a file, each with its line.
pub fn run(file: &Path, against: Option<&Path>) -> Result<(), Failure> {
    let loaded = middlewares::load(file)?;
    if let Some(against) = against {
        let old = middlewares::load(against)?;
        let fixed = |of: &Loaded, file: &Path| {
            Fixed::of(&of.plan, &of.text, &file.display().to_string()).map_err(Failure::usage)
        };
        output::line(&old.plan.diff(&loaded.plan).to_string())?;
        for refusal in fixed(&old, against)?.refusals(&fixed(&loaded, file)?) {
            output::line(&format!("start the program anew: {refusal}"))?;
        }
        return Ok(());
    }
    let plan = loaded.plan;
    for route in &plan.routes {
        output::line(&route.to_string())?;
    }
    for service in &plan.services {
        output::line(&service.to_string())?;
    }
    for pattern in &plan.patterns {
        output::line(&pattern.to_string())?;
    }
    warn_of_unheard(&plan, &Node::bridge().map_err(Failure::usage)?);
    Ok(())
}
