//! Losses of a route: the log has a line for some of them, and the state of the route tells the last one for a while.

use std::fmt;
use std::time::Instant;

use super::route_status::RouteState;
use super::work::DEGRADED_FOR;
use wrapyfi_endpoint::{Cause, DropReason, Throttle};

/// Losses of one route.
#[derive(Default)]
pub(super) struct Losses {
    pub(super) last: Option<(Instant, Cause)>,
    log: Throttle,
}

impl Losses {
    /// Notes what was lost, and logs it where nothing was logged a moment ago.
    pub(super) fn note(
        &mut self,
        now: Instant,
        route: &str,
        what: fmt::Arguments<'_>,
        reason: DropReason,
        error: String,
    ) {
        if let Some(unlogged_before) = self.log.pass(now) {
            tracing::warn!(route, unlogged_before, "{what}: {error}");
        }
        self.last = Some((now, Cause::Lost { reason, error }));
    }

    /// State of a route that has lost something a short time ago.
    pub(super) fn state(&self, now: Instant) -> Option<RouteState> {
        let (at, cause) = self.last.as_ref()?;
        let is_fresh = now.saturating_duration_since(*at) < DEGRADED_FOR;
        is_fresh.then(|| RouteState::Degraded(cause.clone()))
    }
}
