//! `wrapyfi check`: validates a configuration, prints what it would run, and warns of routes that do not
//! hear each other.

use std::path::Path;

use super::bridge::warn_of_unheard;
use crate::exit::Failure;
use crate::middlewares::{self, Loaded};
use crate::node::Node;
use crate::output;

/// Prints the plan, a route a line.
///
/// # Errors
/// Exit code 2 with every fault of the file, each with its line.
pub fn run(file: &Path) -> Result<(), Failure> {
    let Loaded { plan, .. } = middlewares::load(file)?;
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
