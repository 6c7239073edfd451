//! One end of a service that outlives its participant.
//!
//! ```text
//!   Client, Server ─ renew ─▶ End { Opened ─▶ Participant }     RustDDS has ended beneath: on another participant
//! ```

use std::sync::Arc;
use std::time::Instant;

use super::pair::Pair;
use super::participant::{Opened, ServicesState, Topics};
use crate::graph::{GraphResult, Notify};
use wrapyfi_endpoint::backoff::Backoff;

/// Endpoints of a client or server, and what it takes to open them anew.
pub(super) struct ReopenedEndpoints {
    shared: Arc<ServicesState>,
    operation: &'static str,
    topics: Topics,
    notify: Notify,
    opened: Opened,
    backoff: Backoff,
    not_before: Option<Instant>,
}

impl ReopenedEndpoints {
    /// Creates the endpoints and announces them.
    pub(super) fn open(
        shared: &Arc<ServicesState>,
        operation: &'static str,
        topics: Topics,
        notify: Notify,
    ) -> GraphResult<Self> {
        let opened = shared.participant()?.open(operation, &topics, Arc::clone(&notify))?;
        let backoff = Backoff::new(u64::from(std::process::id()));
        let shared = Arc::clone(shared);
        Ok(Self { shared, operation, topics, notify, opened, backoff, not_before: None })
    }

    /// The endpoints.
    pub(super) fn pair(&self) -> &Arc<Pair> {
        &self.opened.pair
    }

    /// True where the node has its services in CycloneDDS's mapping too.
    pub(super) fn is_beside(&self) -> bool {
        self.shared.settings.is_beside
    }

    /// Opens the endpoints anew where RustDDS has ended beneath them; true where it did. A failure is followed by
    /// another try at a later call.
    pub(super) fn renew(&mut self) -> GraphResult<bool> {
        let now = Instant::now();
        if !self.opened.has_ended() || self.not_before.is_some_and(|at| now < at) {
            return Ok(false);
        }
        self.not_before = Some(now + self.backoff.wait());
        let notify = Arc::clone(&self.notify);
        self.opened = self.shared.participant()?.open(self.operation, &self.topics, notify)?;
        Ok(true)
    }
}
