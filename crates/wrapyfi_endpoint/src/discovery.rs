//! Discovery: the endpoints of other programs that exist on a middleware now.
//!
//! ```text
//!   Middleware::discover ─▶ Discovery, which looks for as long as it lives
//!                              │ endpoints()
//!                              ▼
//!        [Discovered { name, role, type, QoS, node, traffic }]   whatever the transport tells
//! ```

use super::{Cause, Discovered, StartError};

/// Predicate that is true for the names of endpoints that the owner of a [`Discovery`] asks for.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_endpoint as endpoint; }
/// use wrapyfi_core::endpoint::NameFilter;
/// let cameras: NameFilter = Box::new(|name| name.starts_with("/camera/"));
/// assert!(cameras("/camera/left") && !cameras("/arm"));
/// ```
pub type NameFilter = Box<dyn Fn(&str) -> bool + Send + Sync>;

/// A look for endpoints that goes on until it is dropped, and sees more the longer it goes on.
///
/// ```
/// # mod wrapyfi_core {
/// #     pub use {wrapyfi_endpoint as endpoint, wrapyfi_data::types};
/// #     pub mod middleware { pub use wrapyfi_endpoint::memory; }
/// # }
/// use wrapyfi_core::endpoint::{Context, Discovery, Middleware, Role, TopicSpec};
/// use wrapyfi_core::middleware::memory::Memory;
/// use wrapyfi_core::types::MessageType;
/// let bus = Memory::new("memory");
/// let spec = TopicSpec::new("/camera", MessageType::Image);
/// let _publisher = bus.open_publisher(&spec, &Context::default())?;
/// let mut discovery = bus.discover()?;
/// let found = discovery.endpoints()?;
/// assert_eq!((found[0].name.as_str(), found[0].role), ("/camera", Role::Publisher));
/// assert_eq!(discovery.is_complete(), Some(true));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub trait Discovery: Send {
    /// Restricts discovery to the names that `wanted` accepts; call it before the first look.
    /// Endpoints of other names may be left out, and are not asked where each has to be asked.
    fn only(&mut self, wanted: NameFilter) {
        _ = wanted;
    }

    /// Endpoints that exist now as far as is known, in order of name and role.
    ///
    /// # Errors
    /// When the transport cannot be asked.
    fn endpoints(&mut self) -> Result<Vec<Discovered>, DiscoverError>;

    /// Cause for which nothing can be found at the moment, for instance a broker that does not answer;
    /// `None` while it looks.
    fn waiting_for(&self) -> Option<Cause> {
        None
    }

    /// True when the last [`Discovery::endpoints`] listed all endpoints, or there is no program to ask;
    /// `None` where the transport never knows, because endpoints announce themselves in their own
    /// time.
    fn is_complete(&self) -> Option<bool> {
        None
    }

    /// True once every program that was found has told its endpoints, for who wants a whole list and waits for it; `None`
    /// where [`Discovery::is_complete`] says all that is known of that.
    fn has_everybody_told(&self) -> Option<bool> {
        None
    }

    /// Network under the middleware, and the reason for it; `None` where there is no choice.
    fn carried_by(&self) -> Option<&str> {
        None
    }
}

/// Error of listing endpoints.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_endpoint as endpoint; }
/// use wrapyfi_core::endpoint::DiscoverError;
/// let error = DiscoverError::Unsupported("zeromq".into());
/// assert_eq!(error.to_string(), "zeromq cannot tell which endpoints exist");
/// ```
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum DiscoverError {
    /// The middleware has no way to list endpoints.
    #[error("{0} cannot tell which endpoints exist")]
    Unsupported(String),
    /// The middleware has not started; it is tried again.
    #[error("{middleware} to start: {fault}")]
    NotStarted {
        /// Middleware asked.
        middleware: String,
        /// Error of the last try.
        fault: StartError,
    },
    /// The middleware can never start with its settings.
    #[error("{middleware} does not start: {reason}")]
    Refused {
        /// Middleware asked.
        middleware: String,
        /// Setting that is wrong, and the remedy.
        reason: String,
    },
    /// The transport refused.
    #[error("{middleware} could not list its endpoints: {reason}")]
    Transport {
        /// Middleware asked.
        middleware: String,
        /// Error of the transport, in its words.
        reason: String,
    },
}
