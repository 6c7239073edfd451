//! Where middlewares come from: started when the first value needs one, with the options it has.
//!
//! ```text
//!   "zeromq", socket_pub_port = 5560 ─▶ Source::plan ─▶ key ─▶ started once for each key
//! ```

use std::sync::Arc;

use super::option::{OptionError, Options};
use super::resolve::Side;
use crate::endpoint::Middleware;

/// A middleware that a communicator may use by its name.
///
/// One that runs already is its own source: see
/// [`ContextBuilder::middleware`](super::ContextBuilder::middleware).
pub trait Source: Send + Sync {
    /// Name in `#[register]`.
    fn name(&self) -> &str;

    /// Which instance these options ask for.
    ///
    /// # Errors
    /// When an option or the environment has a value that means nothing.
    fn plan(&self, wanted: &Wanted<'_>) -> Result<Planned, StartError>;

    /// Why it is not available on this machine although this program knows it, if that is so: a value
    /// on it is `None` then, as on one that was not built in.
    fn absent(&self, options: &Options) -> Option<String> {
        _ = options;
        None
    }

    /// Messages that wait at a listener, unless `queue_size` says otherwise.
    fn queue_depth(&self) -> Option<usize> {
        None
    }
}

/// What an endpoint asks of its middleware.
#[derive(Debug)]
pub struct Wanted<'a> {
    /// Which way it goes. The two ways of one process are kept apart where a middleware ignores its
    /// own messages: an instance that publishes and one that listens must hear each other.
    pub side: Side,
    /// Requests and replies, not messages.
    pub is_service: bool,
    /// Options of the value.
    pub options: &'a Options,
    /// Largest message of the value in bytes.
    pub max_message_bytes: usize,
}

/// An instance of a middleware, not started yet.
pub struct Planned {
    /// Instances of equal keys are one.
    pub key: String,
    /// Starts it.
    pub start: Box<dyn FnOnce() -> Result<Arc<dyn Middleware>, StartError> + Send>,
}

/// Why a middleware does not start.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StartError {
    /// An option has a value that means nothing.
    #[error(transparent)]
    Option(#[from] OptionError),
    /// The middleware's own words.
    #[error("{0}")]
    Refused(String),
}

impl StartError {
    /// The middleware's own words.
    pub fn refused(reason: impl std::fmt::Display) -> Self {
        Self::Refused(reason.to_string())
    }
}

/// A middleware that runs already, whatever the options say.
pub(super) struct Running(pub(super) Arc<dyn Middleware>);

impl Source for Running {
    fn name(&self) -> &str {
        self.0.name()
    }

    fn plan(&self, _wanted: &Wanted<'_>) -> Result<Planned, StartError> {
        let middleware = Arc::clone(&self.0);
        Ok(Planned { key: String::new(), start: Box::new(move || Ok(middleware)) })
    }
}
