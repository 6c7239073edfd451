//! The connection of an endpoint.

/// State of an endpoint's connection, for status tables and for waiting.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Link {
    /// Number of matched peers: listeners of a publisher, publishers of a listener. `None` where
    /// the transport cannot know.
    pub peers: Option<usize>,
    /// Reason that nothing can flow at the moment (`broker tcp://127.0.0.1:5555 does not answer`);
    /// `None` when the way is open.
    pub waiting_for: Option<String>,
    /// True when the last message is kept for listeners that come later (transient local).
    pub keeps_last: bool,
}
