//! A service that is offered on another middleware than its server's.
//!
//! ```text
//!   caller ──▶ Server at `as` ── take ──▶ send ── Client at `service` ──▶ the real server
//!          ◀──────────────────── reply ◀── take ◀─────────────────────────
//! ```
//!
//! Many calls may be under way; each ends with its reply, or with why there is none. No threads and no
//! clock, as [`super::Relay`].

use std::collections::HashMap;
use std::sync::Arc;
use std::time::Instant;

use super::end::End;
use super::plan_service::ServiceRouteSpec;
use super::relay::{DEGRADED_FOR, REST_REVIEW_EVERY, REVIEW_EVERY, Step, UNWANTED_FOR};
use super::route::{RouteState, RouteStatus};
use super::work::Work;
use crate::Throttle;
use crate::backoff::Backoff;
use crate::endpoint::{
    CallError, Client, Context, Counters, DropReason, Qos, Registry, RequestId, ServeError, Server,
    Ticket, Wake,
};

/// Requests and replies moved in one step.
const BATCH: usize = 16;

/// One service route at work.
pub struct ServiceRelay {
    spec: ServiceRouteSpec,
    /// What is offered; its counters are the route's.
    front: Context,
    back: Context,
    offered: End<dyn Server>,
    called: End<dyn Client>,
    backoff: Backoff,
    /// Calls under way, and the requests they are for.
    calls: HashMap<Ticket, RequestId>,
    state: RouteState,
    /// When it moved something last.
    moved_at: Option<Instant>,
    last_loss: Option<(Instant, String)>,
    losses: Throttle,
}

impl ServiceRelay {
    /// A route that has opened nothing yet. `seed` spreads its back-off.
    #[must_use]
    pub fn new(spec: ServiceRouteSpec, registry: &Registry, seed: u64) -> Self {
        let front = Context::default();
        // One bell for both sides.
        let back = Context { wake: front.wake.clone(), ..Context::default() };
        Self {
            offered: End::new(registry, &spec.offered.middleware),
            called: End::new(registry, &spec.service.middleware),
            front,
            back,
            backoff: Backoff::new(seed),
            calls: HashMap::new(),
            state: RouteState::Waiting("its first step".to_owned()),
            moved_at: None,
            last_loss: None,
            losses: Throttle::default(),
            spec,
        }
    }

    /// Counts where somebody else counted before.
    #[must_use]
    pub(super) fn counting(mut self, counters: Arc<Counters>) -> Self {
        self.front.counters = counters;
        self
    }

    /// Whether nobody calls, and nobody has called for a while.
    pub(super) fn is_at_rest(&self, now: Instant) -> bool {
        let is_quiet = |at: Instant| now.saturating_duration_since(at) >= UNWANTED_FOR;
        self.calls.is_empty() && self.moved_at.is_none_or(is_quiet)
    }

    /// Rings when the route has work.
    #[must_use]
    pub fn wake(&self) -> &Wake {
        &self.front.wake
    }

    /// The route now: received are requests, sent are replies.
    #[must_use]
    pub fn status(&self) -> RouteStatus {
        RouteStatus {
            name: self.spec.name.clone(),
            from: self.spec.offered.to_string(),
            to: self.spec.service.to_string(),
            message_type: self.spec.kind.ros_type(),
            state: self.state.clone(),
            from_qos: None,
            to_qos: None,
            counters: self.front.counters.snapshot(),
            panics: 0,
            pattern: None,
        }
    }

    /// Brings the route one step on.
    pub fn step(&mut self, now: Instant) -> Step {
        self.reconcile(now);
        let moved = self.ask(now).saturating_add(self.answer(now));
        if moved > 0 {
            self.moved_at = Some(now);
        }
        self.state = self.judge(now);
        let next = match (moved >= BATCH, self.is_at_rest(now)) {
            (true, _) => now,
            (false, true) => now + REST_REVIEW_EVERY,
            (false, false) => now + REVIEW_EVERY,
        };
        let due = [
            self.offered.retry_at,
            self.called.retry_at,
            self.offered.open.as_ref().and_then(|server| server.deadline()),
            self.called.open.as_ref().and_then(|client| client.deadline()),
        ];
        Step { moved, next: due.into_iter().flatten().fold(next, Instant::min).max(now) }
    }

    /// The real server first: a request must find somebody to ask.
    fn reconcile(&mut self, now: Instant) {
        let Self { spec, front, back, offered, called, backoff, .. } = self;
        let to = spec.service_spec(&spec.service);
        called.open_with(now, backoff, |middleware| middleware.open_client(&to, back));
        if called.open.is_some() {
            let at = spec.service_spec(&spec.offered);
            offered.open_with(now, backoff, |middleware| middleware.open_server(&at, front));
        }
        if called.open.is_some() && offered.open.is_some() {
            backoff.reset();
        }
    }

    /// Hands requests on.
    fn ask(&mut self, now: Instant) -> usize {
        let mut moved = 0;
        while moved < BATCH {
            let (Some(server), Some(client)) = (&mut self.offered.open, &mut self.called.open)
            else {
                break;
            };
            let asked = match server.take() {
                Ok(None) => break,
                Ok(Some(asked)) => asked,
                Err(error) => {
                    // It is counted already.
                    moved += 1;
                    self.note(now, "refused a request", &error.to_string());
                    continue;
                }
            };
            moved += 1;
            // A little less than the caller's, so that what went wrong behind us is told in its words.
            let left = self.spec.timeout.saturating_sub(asked.received_at.elapsed());
            match client.send(&asked.request, left / 20 * 19) {
                Ok(ticket) => {
                    self.calls.insert(ticket, asked.id);
                }
                Err(error) => self.end(now, asked.id, Err(error)),
            }
        }
        moved
    }

    /// Hands replies back.
    fn answer(&mut self, now: Instant) -> usize {
        let mut moved = 0;
        while moved < BATCH {
            let Some(client) = &mut self.called.open else { break };
            let Some((ticket, result)) = client.take() else { break };
            moved += 1;
            if let Some(id) = self.calls.remove(&ticket) {
                self.end(now, id, result.map(|reply| reply.payload));
            }
        }
        moved
    }

    fn end(
        &mut self,
        now: Instant,
        id: RequestId,
        result: Result<crate::types::Payload, CallError>,
    ) {
        let Some(server) = &mut self.offered.open else { return };
        let answer = result.map_err(|error| {
            let counters = &self.front.counters;
            match &error {
                CallError::TimedOut { .. } => counters.dropped(DropReason::Expired),
                CallError::TooMany { .. } => counters.dropped(DropReason::Overloaded),
                CallError::Request { .. } => counters.dropped(DropReason::Unencodable),
                CallError::Reply { fault, .. } => counters.dropped(fault.drop_reason()),
                CallError::Refused { .. } => counters.dropped(DropReason::Refused),
                CallError::Transport { .. } => counters.dropped(DropReason::SendFailed),
            }
            error.to_string()
        });
        let why = answer.as_ref().err().cloned();
        // A server that gave a request up has counted it.
        let untold = match server.reply(id, answer) {
            Ok(_) | Err(ServeError::NotWaiting { .. }) => None,
            Err(error) => Some(error.to_string()),
        };
        if let Some(why) = why {
            self.note(now, "a call failed", &why);
        }
        if let Some(untold) = untold {
            self.note(now, "an answer was not sent", &untold);
        }
    }

    fn note(&mut self, now: Instant, what: &str, text: &str) {
        if let Some(unlogged_before) = self.losses.pass(now) {
            tracing::warn!(route = self.spec.name, unlogged_before, "{what}: {text}");
        }
        self.last_loss = Some((now, text.to_owned()));
    }

    fn judge(&self, now: Instant) -> RouteState {
        if let Some(trouble) = self.called.trouble.as_ref().or(self.offered.trouble.as_ref()) {
            return trouble.clone();
        }
        let (Some(server), Some(client)) = (&self.offered.open, &self.called.open) else {
            return self.state.clone();
        };
        let (server, client) = (server.link(), client.link());
        if let Some(what) = client.waiting_for.or(server.waiting_for) {
            return RouteState::Waiting(what);
        }
        if client.peers == Some(0) {
            return RouteState::Waiting(format!("a server of {}", self.spec.service));
        }
        match &self.last_loss {
            Some((at, text)) if now.saturating_duration_since(*at) < DEGRADED_FOR => {
                RouteState::Degraded(text.clone())
            }
            _ => RouteState::Active,
        }
    }
}

impl Work for ServiceRelay {
    fn step(&mut self, now: Instant) -> Step {
        Self::step(self, now)
    }

    fn state(&self) -> (&RouteState, [Option<Qos>; 2]) {
        (&self.state, [None, None])
    }

    fn is_open(&self) -> bool {
        self.called.open.is_some() && self.offered.open.is_some()
    }

    fn close(&mut self) {
        let under_way = std::mem::take(&mut self.calls).len();
        self.front.counters.dropped_many(DropReason::Closed, under_way as u64);
        self.offered.close();
        self.called.close();
    }
}

#[cfg(test)]
#[path = "service_relay_tests.rs"]
mod tests;
