//! Sources of middlewares, each of which is started when the first value needs it, with its
//! options.
//!
//! ```text
//!   "zeromq", socket_pub_port = 5560 ─▶ Source::plan ─▶ key ─▶ started once for each key
//! ```

use super::option::Options;
use crate::{Planned, Role, StartError};

/// A middleware that a communicator may use by its name.
///
/// ```
/// use std::sync::Arc;
/// use wrapyfi_endpoint::method::{EndpointNeeds, Options, Source};
/// use wrapyfi_endpoint::{Planned, Role, StartError, memory::Memory};
///
/// /// A bus for each name in the option `bus`.
/// struct Buses;
/// impl Source for Buses {
///     fn name(&self) -> &str { "bus" }
///     fn plan(&self, wanted: &EndpointNeeds<'_>) -> Result<Planned, StartError> {
///         let key = wanted.options.text("bus")?.unwrap_or("main").to_owned();
///         Ok(Planned { key, start: Arc::new(|| Ok(Arc::new(Memory::new("bus")) as _)) })
///     }
/// }
///
/// let options = Options::default();
/// let wanted = EndpointNeeds { role: Role::Listener, options: &options, max_message_bytes: 1 << 20 };
/// assert_eq!(Buses.plan(&wanted)?.key, "main");
/// # Ok::<(), StartError>(())
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
pub fn queue_size(variable: &str) -> usize {
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
/// ```
/// use wrapyfi_endpoint::Role;
/// use wrapyfi_endpoint::method::{EndpointNeeds, Options};
/// /// Name of the node for an endpoint: a node does not hear itself.
/// fn node(wanted: &EndpointNeeds<'_>) -> &'static str {
///     if wanted.role.is_provider() { "camera" } else { "camera_in" }
/// }
///
/// let options = Options::default();
/// let wanted = EndpointNeeds { role: Role::Listener, options: &options, max_message_bytes: 1 << 20 };
/// assert_eq!(node(&wanted), "camera_in");
/// ```
#[derive(Debug)]
pub struct EndpointNeeds<'a> {
    /// Role of the endpoint. Those who publish and serve and those who listen and call are kept apart in one process
    /// where a middleware ignores its own messages: an instance that publishes and one that listens must hear each
    /// other.
    pub role: Role,
    /// Options of the value.
    pub options: &'a Options,
    /// Largest message of the value in bytes.
    pub max_message_bytes: usize,
}
