//! `wrapyfi check`: validates a configuration and prints what it would run.

use std::io::Write as _;
use std::path::Path;

use anyhow::Context as _;

use crate::exit::Failure;
use crate::middlewares::{self, Loaded};

/// Prints the plan, a route a line.
///
/// # Errors
/// Exit code 2 with every fault of the file, each with its line.
pub fn run(file: &Path) -> Result<(), Failure> {
    let Loaded { plan, .. } = middlewares::load(file)?;
    let mut out = std::io::stdout().lock();
    for route in &plan.routes {
        writeln!(out, "{route}").context("cannot print")?;
    }
    for service in &plan.services {
        writeln!(out, "{service}").context("cannot print")?;
    }
    for pattern in &plan.patterns {
        writeln!(out, "{pattern}").context("cannot print")?;
    }
    Ok(())
}
