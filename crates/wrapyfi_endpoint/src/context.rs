//! Bell, counters and clock that an endpoint shares with its owner.

use std::sync::Arc;

use super::{Clock, Counters, Wake};

/// Bell and counters that an endpoint shares with its owner.
#[derive(Debug, Clone, Default)]
pub struct Context {
    /// Bell that rings when a message arrives or the link changes.
    pub wake: Wake,
    /// Counters of messages received, sent and dropped. A listener counts the messages that it
    /// receives and that its queue drops; the owner counts everything after [`Listener::take`](super::Listener::take).
    pub counters: Arc<Counters>,
    /// The time that decides.
    pub clock: Clock,
}
