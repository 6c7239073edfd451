//! The start of a middleware, with the exit code of a failure.

use wrapyfi_core::start::{MiddlewareSettings, StartError};

use crate::exit::{Failure, Result};

/// Role of a command at its topic or service.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Observer: looks which endpoints exist, and opens none.
    Observer,
    /// Listener: Wrapyfi's listeners never start a broker.
    Listener,
    /// Publisher: Wrapyfi's publishers start the broker when there is none.
    Publisher,
    /// Client: Wrapyfi's clients never start a broker.
    Client,
    /// Server: Wrapyfi's servers start the broker of requests where there is none.
    Server,
}

/// Starts a middleware that is called `name`.
///
/// # Errors
/// Exit code 2 for settings that cannot work, 1 when it does not start.
pub(super) fn start<S: MiddlewareSettings>(name: &str, settings: &S) -> Result<S::Middleware> {
    settings.start().map_err(|error| match error {
        StartError::Absent(what) => Failure::Absent(what),
        StartError::Failed(why) => {
            Failure::Failed(anyhow::Error::msg(why).context(name.to_owned()))
        }
        refused => Failure::Usage(format!("{name}: {refused}")),
    })
}
