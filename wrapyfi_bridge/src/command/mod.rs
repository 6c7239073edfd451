//! One module per subcommand.

use std::time::Duration;

pub mod any;
pub mod bridge;
pub mod broker;
pub mod check;
pub mod demo;
pub mod detect;
pub mod echo;
pub mod list;
pub mod publish;
pub mod service;
pub mod top;
pub mod why;
pub mod yarpserver;

/// Longest a command waits before it looks at signals and deadlines again.
const WAIT_SLICE: Duration = Duration::from_millis(50);
