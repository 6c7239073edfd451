//! Sources of middlewares, each of which is started when the first value needs it, with its
//! options.
//!
//! ```text
//!   "zeromq", socket_pub_port = 5560 ─▶ Source::plan ─▶ key ─▶ started once for each key
//! ```

use std::sync::Arc;

use super::option::Options;
use super::resolve::Side;
use crate::start::MiddlewareSettings;
pub use crate::start::StartError;
use wrapyfi_endpoint::Middleware;

/// A middleware that a communicator may use by its name.
///
/// A middleware that runs already is its own source: see
/// [`ContextBuilder::middleware`](super::ContextBuilder::middleware).
///
/// ```
/// use std::sync::Arc;
/// use wrapyfi_core::communicator::{CommunicatorContext, Planned, Source, StartError, EndpointNeeds};
/// use wrapyfi_core::middleware::memory::Memory;
///
/// /// A bus for each name in the option `bus`.
/// struct Buses;
/// impl Source for Buses {
///     fn name(&self) -> &str { "bus" }
///     fn plan(&self, wanted: &EndpointNeeds<'_>) -> Result<Planned, StartError> {
///         let key = wanted.options.text("bus")?.unwrap_or("main").to_owned();
///         Ok(Planned { key, start: Box::new(|| Ok(Arc::new(Memory::new("bus")) as _)) })
///     }
/// }
///
/// let context = CommunicatorContext::builder().source(Arc::new(Buses)).build();
/// assert!(context.middlewares().contains(&"bus".to_owned()));
/// ```
pub trait Source: Send + Sync {
    /// Name in `#[register]`.
    fn name(&self) -> &str;

    /// Plans the instance of the middleware that these options ask for.
    ///
    /// # Errors
    /// When an option or a variable has a value that it cannot have.
    fn plan(&self, wanted: &EndpointNeeds<'_>) -> Result<Planned, StartError>;

    /// Reason that the middleware is not available on this machine though it is built in, if so. A
    /// value on it is then `None`, as on one that is not built in.
    fn absent(&self, options: &Options) -> Option<String> {
        _ = options;
        None
    }

    /// Number of messages that wait at a listener, unless `queue_size` says otherwise.
    fn queue_depth(&self) -> Option<usize> {
        None
    }
}

/// Number of messages that a subscription of Wrapyfi on ROS holds: as `variable` says, or 5.
#[cfg(any(feature = "ros1", feature = "ros2"))]
pub(super) fn queue_size(variable: &str) -> usize {
    const USUAL: usize = 5;
    match std::env::var(variable) {
        Err(_) => USUAL,
        Ok(text) => match text.trim().parse() {
            Ok(depth) if depth > 0 => depth,
            _ => {
                tracing::warn!("{variable}={text:?} is no number from 1: using {USUAL}");
                USUAL
            }
        },
    }
}

/// Needs of an endpoint, by which a [`Source`] chooses the instance of its middleware.
///
/// See [`Source`].
#[derive(Debug)]
pub struct EndpointNeeds<'a> {
    /// Direction of the endpoint. The two directions of one process are kept apart where a
    /// middleware ignores its own messages: an instance that publishes and one that listens must
    /// hear each other.
    pub side: Side,
    /// True for requests and replies, false for messages.
    pub is_service: bool,
    /// Options of the value.
    pub options: &'a Options,
    /// Largest message of the value in bytes.
    pub max_message_bytes: usize,
}

/// An instance of a middleware, not started yet.
///
/// See [`Source`].
pub struct Planned {
    /// Key of the instance: endpoints with equal keys share one.
    pub key: String,
    /// Function that starts the instance.
    pub start: Box<dyn FnOnce() -> Result<Arc<dyn Middleware>, StartError> + Send>,
}

impl Planned {
    /// An instance that starts with these settings.
    pub fn new(key: String, settings: impl MiddlewareSettings + Send + 'static) -> Self {
        Self { key, start: Box::new(move || Ok(Arc::new(settings.start()?) as _)) }
    }
}

/// A middleware that runs already, whatever the options say.
pub(super) struct Running(pub(super) Arc<dyn Middleware>);

impl Source for Running {
    fn name(&self) -> &str {
        self.0.name()
    }

    fn plan(&self, _wanted: &EndpointNeeds<'_>) -> Result<Planned, StartError> {
        let middleware = Arc::clone(&self.0);
        Ok(Planned { key: String::new(), start: Box::new(move || Ok(middleware)) })
    }
}
