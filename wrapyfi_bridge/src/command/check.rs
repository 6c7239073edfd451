//! `wrapyfi check`: validates a configuration, prints what it would run or what it changes of another, and
//! warns of routes that do not hear each other, and of those that lead in a circle.

use std::path::Path;

use crate::exit::{Failure, Result};
use crate::in_force::{in_lines, warn_of_unheard};
use crate::middlewares::{self, Loaded, Settings, route_facts};
use crate::node::Node;
use crate::output;
use crate::sros2;

/// Prints the plan, a route a line, or its policy of SROS 2; with `against`, what it changes for a bridge that
/// runs with that file.
///
/// # Errors
/// Exit code 2 with every fault of a file, each with its line.
pub fn run(file: &Path, against: Option<&Path>, prints_policy: bool) -> Result<()> {
    let mut loaded = middlewares::load(file)?;
    loaded.endpoints.check_permitted(Some(file))?;
    let settings = |of: &Loaded, before: &Settings| Settings::of(&of.endpoints, &of.plan, before);
    // The bridge starts with them, and with variables that no line has.
    settings(&loaded, &Settings::default())?;
    if let Some(against) = against {
        let old = middlewares::load(against)?;
        output::line(&old.plan.diff(&loaded.plan).to_string())?;
        let before = settings(&old, &Settings::default())?;
        let now = settings(&loaded, &before)?;
        for change in before.changes(&now) {
            output::line(&change)?;
        }
        for refusal in before.refusals(&now) {
            output::line(&format!("start the program anew: {refusal}"))?;
        }
        return Ok(());
    }
    let warnings = loaded.endpoints.warnings(&route_facts(&loaded.plan), &mut loaded.types);
    let plan = loaded.plan;
    let node = Node::bridge().map_err(Failure::usage)?;
    if prints_policy {
        output::line(&sros2::policy(&node, &plan))?;
    } else {
        for route in &plan.routes {
            output::line(&route.to_string())?;
        }
    }
    for (at, warning) in warnings {
        match at {
            Some(at) => tracing::warn!("{}: {warning}", in_lines(&[at], &loaded.lines)),
            None => tracing::warn!("{warning}"),
        }
    }
    let index = plan.index(|address| node.resolve(address));
    warn_of_unheard(&index, &loaded.lines);
    for circle in index.circles() {
        tracing::warn!("{}: {circle}", in_lines(&circle.places, &loaded.lines));
    }
    Ok(())
}
