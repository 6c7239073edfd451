//! Something that a pattern means: since when it is there, and what has become of it.

use std::time::{Duration, Instant};

use super::route::{RouteKey, RouteState};
use crate::endpoint::{EndpointAddress, Role};
use crate::types::MessageType;

/// Longest time after which the younger of two that are in each other's way yields, in milliseconds.
const YIELD_SPREAD_MS: u64 = 2000;

/// A source, and where it would go.
#[derive(Debug)]
pub(super) struct Candidate {
    pub(super) from: EndpointAddress,
    pub(super) to: EndpointAddress,
    /// Where it has to go instead.
    pub(super) moves_to: Option<EndpointAddress>,
    pub(super) state: State,
    first_seen: Option<Instant>,
    last_seen: Option<Instant>,
    retry_at: Option<Instant>,
    /// Since when somebody else does what it does.
    rival_since: Option<Instant>,
    /// Its source has no publisher yet: somebody waits at the destination.
    pub(super) is_ahead: bool,
    /// The type of the route that was made ahead of its publishers, which may have another.
    pub(super) guessed_type: Option<&'static str>,
    /// The type that its route carries.
    pub(super) carried: Option<MessageType>,
    /// The type that its listeners want, where that is another one than was learned and can be made.
    pub(super) wished: Option<MessageType>,
    /// What its route was told last of listeners that it cannot serve.
    pub(super) misfits: Option<String>,
    /// Its route closes the source while nobody listens; it must not where a publisher keeps messages.
    pub(super) rests: bool,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum State {
    New,
    /// Not a route yet, and why.
    Waits(RouteState),
    /// The route of this number.
    Runs(u64),
}

impl Candidate {
    pub(super) fn new(from: EndpointAddress, to: EndpointAddress, seen: Option<Instant>) -> Self {
        Self {
            from,
            to,
            moves_to: None,
            state: State::New,
            first_seen: seen,
            last_seen: seen,
            retry_at: None,
            rival_since: None,
            is_ahead: false,
            guessed_type: None,
            carried: None,
            wished: None,
            misfits: None,
            rests: false,
        }
    }

    /// Name of its route, which is that of any route between the two.
    pub(super) fn name(&self, role: Role) -> String {
        match role {
            Role::Server => format!("{} -> {}", self.to, self.from),
            _ => format!("{} -> {}", self.from, self.to),
        }
    }

    /// Ends of its route.
    pub(super) fn key(&self, role: Role) -> RouteKey {
        RouteKey { role, from: self.from.clone(), to: self.to.clone() }
    }

    /// Forgets what came of it with other settings; not since when it is there.
    pub(super) fn forget(&mut self) {
        *self = Self {
            last_seen: self.last_seen,
            is_ahead: self.is_ahead,
            ..Self::new(self.from.clone(), self.to.clone(), self.first_seen)
        };
    }

    pub(super) fn seen(&mut self, now: Instant) {
        self.first_seen.get_or_insert(now);
        self.last_seen = Some(now);
    }

    /// It was there until `now` where it was seen at `then`: nothing has changed between.
    pub(super) fn stayed(&mut self, then: Instant, now: Instant) {
        if self.last_seen == Some(then) {
            self.last_seen = Some(now);
        }
    }

    /// Whether it was last seen so long ago.
    pub(super) fn is_gone(&self, now: Instant, after: Duration) -> bool {
        self.last_seen.is_some_and(|at| now.saturating_duration_since(at) >= after)
    }

    /// Whether a route may be made of it now.
    pub(super) fn is_due(&self, now: Instant, settle: Duration) -> bool {
        let settled = self.first_seen.is_none_or(|at| now.saturating_duration_since(at) >= settle);
        settled && self.retry_at.is_none_or(|at| now >= at)
    }

    pub(super) fn retry_at(&mut self, at: Instant) {
        self.retry_at = Some(at);
    }

    /// Whether to give way to a rival now: after a time that differs from bridge to bridge, so that
    /// not all do.
    pub(super) fn yields(&mut self, now: Instant, number: u64) -> bool {
        let since = *self.rival_since.get_or_insert(now);
        let spread = Duration::from_millis(number % YIELD_SPREAD_MS);
        now.saturating_duration_since(since) >= spread
    }

    pub(super) fn has_no_rival(&mut self) {
        self.rival_since = None;
    }

    /// Notes why it is no route, and says so where that is news; in a low voice where it is one of many.
    pub(super) fn waits(&mut self, name: &str, state: RouteState, is_one_of_many: bool) {
        if matches!(self.state, State::Runs(_)) || self.state == State::Waits(state.clone()) {
            return;
        }
        state.log(name, is_one_of_many, 0);
        self.state = State::Waits(state);
    }
}
