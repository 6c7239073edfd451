//! One module per subcommand.

use std::time::Duration;

use wrapyfi_yarp::name::conf::{NameServerConf, file_of};
use wrapyfi_yarp::name::environment::Environment;

use crate::exit::{Failure, Result};

pub mod action;
mod announced;
#[cfg(feature = "bags")]
pub mod bag;
pub mod bridge;
pub mod broker;
pub mod check;
pub mod completions;
pub mod definitions;
pub mod demo;
pub mod detect;
pub mod echo;
pub mod list;
mod other_types;
pub mod publish;
pub mod service;
pub mod top;
pub mod why;
mod yaml;
pub mod yarpserver;

/// Longest a command waits before it looks at signals and deadlines again.
const WAIT_SLICE: Duration = Duration::from_millis(50);

/// Environment of YARP, in the namespace that is given.
fn yarp_environment(namespace: Option<&str>) -> Environment {
    let environment = Environment::from_process();
    match namespace {
        Some(name) => environment.with("YARP_NAMESPACE", name),
        None => environment,
    }
}

/// Writes down where the name server of a namespace is, as `yarp conf` does.
fn write_down(environment: &Environment, namespace: &str, server: &NameServerConf) -> Result<()> {
    let file = file_of(environment, namespace).map_err(Failure::usage)?;
    server.write(&file).map_err(anyhow::Error::new)?;
    tracing::info!("wrote {}", file.display());
    Ok(())
}
