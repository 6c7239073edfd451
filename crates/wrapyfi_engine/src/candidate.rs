//! A source that a pattern matches: the time since which it exists, and the state of its route.

use std::time::{Duration, Instant};

use super::route::{RouteKey, RouteTypes, ends};
use super::route_status::RouteState;
use wrapyfi_data::types::MessageType;
use wrapyfi_endpoint::{EndpointAddress, Interaction};

/// A listener of another type than a route's.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Misfit {
    /// Node of the listener; `a listener` where it is not known.
    pub(super) peer: String,
    /// Type that it wants.
    pub(super) theirs: String,
}

impl std::fmt::Display for Misfit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} wants {}", self.peer, self.theirs)
    }
}

/// A source, and the destination that its route has or would have.
#[derive(Debug)]
pub(super) struct Candidate {
    pub(super) from: EndpointAddress,
    pub(super) to: EndpointAddress,
    /// Destination that it has to go to instead.
    pub(super) moves_to: Option<EndpointAddress>,
    pub(super) state: CandidateState,
    first_seen: Option<Instant>,
    last_seen: Option<Instant>,
    /// Instant before which no route is made of it, after one that could not be made.
    pub(super) retry_at: Option<Instant>,
    /// True while its source has no publisher yet, and a listener waits at the destination.
    pub(super) precedes_publisher: bool,
    /// Types that its route carries.
    pub(super) made: Option<RouteTypes>,
    /// Type that its source has shown last.
    pub(super) announced_type: Option<&'static str>,
    /// Type that its listeners want, where it differs from the learned one and can be made of it.
    pub(super) wished: Option<MessageType>,
    /// Type that its route has left because its publishers have another one now, whatever listeners still want.
    pub(super) left_type: Option<&'static str>,
    /// Listener that its route cannot serve, as the route was told last.
    pub(super) misfits: Option<Misfit>,
    /// True when its route closes the source while no program listens. It must not where a publisher
    /// keeps messages.
    pub(super) closes_when_unwanted: bool,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum CandidateState {
    New,
    /// There is no route; the state says why.
    Waits(RouteState),
    /// The route with this number runs.
    Runs(u64),
}

impl Candidate {
    pub(super) fn new(from: EndpointAddress, to: EndpointAddress, seen: Option<Instant>) -> Self {
        Self {
            from,
            to,
            moves_to: None,
            state: CandidateState::New,
            first_seen: seen,
            last_seen: seen,
            retry_at: None,
            precedes_publisher: false,
            made: None,
            announced_type: None,
            wished: None,
            left_type: None,
            misfits: None,
            closes_when_unwanted: false,
        }
    }

    /// Name of its route, which is that of any route between the two.
    pub(super) fn name(&self, interaction: Interaction) -> String {
        ends(interaction, &self.from, &self.to)
    }

    /// Ends of its route.
    pub(super) fn key(&self, interaction: Interaction) -> RouteKey {
        RouteKey { interaction, from: self.from.clone(), to: self.to.clone() }
    }

    /// Forgets its state under other settings, but not the time since which the source exists.
    pub(super) fn forget(&mut self) {
        *self = Self {
            last_seen: self.last_seen,
            precedes_publisher: self.precedes_publisher,
            ..Self::new(self.from.clone(), self.to.clone(), self.first_seen)
        };
    }

    pub(super) fn seen(&mut self, now: Instant) {
        self.first_seen.get_or_insert(now);
        self.last_seen = Some(now);
    }

    /// Counts as gone since `long_ago`: a source that is there has its destination.
    pub(super) fn give_way(&mut self, long_ago: Option<Instant>) {
        self.last_seen = long_ago;
    }

    /// Notes that the source was there until `now` if it was seen at `then`: nothing has changed
    /// between.
    pub(super) fn seen_until(&mut self, then: Instant, now: Instant) {
        if self.last_seen == Some(then) {
            self.last_seen = Some(now);
        }
    }

    /// True when the source was last seen at least `after` ago.
    pub(super) fn is_gone(&self, now: Instant, after: Duration) -> bool {
        self.last_seen.is_some_and(|at| now.saturating_duration_since(at) >= after)
    }

    /// True when a route may be made of it now.
    pub(super) fn is_due(&self, now: Instant, settle: Duration) -> bool {
        let settled = self.first_seen.is_none_or(|at| now.saturating_duration_since(at) >= settle);
        settled && self.retry_at.is_none_or(|at| now >= at)
    }

    /// Notes the reason that it has no route, and logs a new one; at level debug where it is one of
    /// many. True where it is new.
    pub(super) fn set_waiting(
        &mut self,
        interaction: Interaction,
        state: RouteState,
        is_one_of_many: bool,
    ) -> bool {
        let is_news = match &self.state {
            CandidateState::Runs(_) => false,
            CandidateState::Waits(known) => *known != state,
            CandidateState::New => true,
        };
        if is_news {
            state.log(&self.name(interaction), is_one_of_many, 0);
            self.state = CandidateState::Waits(state);
        }
        is_news
    }
}
