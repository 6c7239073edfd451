//! The connection of an endpoint.

use super::Cause;

/// State of an endpoint's connection, for status tables and for waiting.
///
/// ```
/// # mod wrapyfi_core {
/// #     pub use {wrapyfi_endpoint as endpoint, wrapyfi_data::types};
/// #     pub mod middleware { pub use wrapyfi_endpoint::memory; }
/// # }
/// use wrapyfi_core::endpoint::{Context, Link, Middleware, TopicSpec};
/// use wrapyfi_core::middleware::memory::Memory;
/// use wrapyfi_core::types::MessageType;
/// let spec = TopicSpec::new("/x", MessageType::Image);
/// let listener = Memory::new("memory").open_listener(&spec, &Context::default())?;
/// let Link { peers, waiting_for, .. } = listener.link();
/// assert_eq!((peers, waiting_for), (Some(0), None)); // no publisher, and nothing is in its way
/// # Ok::<(), wrapyfi_endpoint::OpenError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Link {
    /// Number of matched peers: listeners of a publisher, publishers of a listener. `None` where
    /// the transport cannot know.
    pub peers: Option<usize>,
    /// Cause for which nothing can flow at the moment, for instance a broker that does not answer;
    /// `None` when the way is open.
    pub waiting_for: Option<Cause>,
    /// True when the last message is kept for listeners that come later (transient local).
    pub keeps_last: bool,
}

impl Link {
    /// True when a peer is there, or may be: where the transport cannot know, the way is open.
    pub fn has_peers(&self) -> bool {
        self.peers.map_or(self.waiting_for.is_none(), |peers| peers > 0)
    }
}
