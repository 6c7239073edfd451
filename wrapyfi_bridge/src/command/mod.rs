//! One module per subcommand.

use std::time::Duration;

pub mod bridge;
pub mod broker;
pub mod check;
pub(crate) mod definitions;
pub mod demo;
pub mod detect;
pub mod echo;
pub mod list;
pub mod publish;
pub mod service;
mod strangers;
pub mod top;
pub mod why;
mod yaml;
pub mod yarpserver;

/// Longest a command waits before it looks at signals and deadlines again.
const WAIT_SLICE: Duration = Duration::from_millis(50);
