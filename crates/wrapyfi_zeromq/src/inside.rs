//! The way of messages into a broker of the same process.

use std::sync::Weak;

use bytes::Bytes;

/// A broker that passes messages on while its caller waits.
pub(super) trait Passes: Send + Sync {
    /// Passes a message on to the queues of its listeners, and writes what they take.
    fn pass_on(&self, frames: Vec<Bytes>);
}

/// The broker of topics as publishers of its own process have it.
#[derive(Clone)]
pub(super) struct Inside(pub(super) Weak<dyn Passes>);

impl Inside {
    /// True while the broker is there.
    pub(super) fn is_there(&self) -> bool {
        self.0.strong_count() > 0
    }

    /// Passes a message on, on the caller's thread; false where the broker has ended.
    pub(super) fn pass(&self, frames: Vec<Bytes>) -> bool {
        self.0.upgrade().map(|broker| broker.pass_on(frames)).is_some()
    }
}

impl std::fmt::Debug for Inside {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("Inside").field(&self.is_there()).finish()
    }
}
