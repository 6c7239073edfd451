//! How long to wait before what failed is tried again.

use std::time::Duration;

use crate::Limits;

/// Doubles from its first wait up to [`Limits::RECONNECT_MAX`].
#[derive(Debug)]
pub(super) struct Retry {
    first: Duration,
    next: Duration,
}

impl Retry {
    pub(super) fn new(first: Duration) -> Self {
        Self { first, next: first }
    }

    /// It worked: the next failure is the first one.
    pub(super) fn reset(&mut self) {
        self.next = self.first;
    }

    /// Waits.
    pub(super) async fn wait(&mut self) {
        let now = self.next;
        self.next = (now * 2).min(Limits::RECONNECT_MAX);
        tokio::time::sleep(now).await;
    }
}

impl Default for Retry {
    fn default() -> Self {
        Self::new(Limits::RECONNECT_MIN)
    }
}
