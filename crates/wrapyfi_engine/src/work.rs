//! The trait by which the driver steps a route, and the times that routes of topics and of services have in common.

use std::time::{Duration, Instant};

use super::candidate::Misfit;
use super::route_status::RouteState;
use wrapyfi_endpoint::{Cause, Qos};

/// Time for which a loss keeps a route `degraded`.
pub(super) const DEGRADED_FOR: Duration = Duration::from_secs(5);
/// Time without listeners or calls after which a lazy route closes its source.
pub(super) const UNWANTED_FOR: Duration = Duration::from_secs(2);
/// Time between two looks at the links when nothing rings.
pub(super) const REVIEW_EVERY: Duration = Duration::from_millis(500);
/// Time between two looks of a route at rest, or of one whose ends are; who comes, goes or sends rings before.
pub(super) const REST_REVIEW_EVERY: Duration = Duration::from_secs(2);

/// Messages that a step moved, and the time of the next one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress {
    /// Number of messages taken, delivered or not.
    pub moved: usize,
    /// Instant at which to step again if the bell does not ring before.
    pub next: Instant,
}

impl Progress {
    /// Progress of a step that left more to move, of a route at rest, or of one that looks at its links again; sooner
    /// where something is due before.
    pub(super) fn new(
        now: Instant,
        moved: usize,
        has_more: bool,
        is_at_rest: bool,
        due: impl IntoIterator<Item = Option<Instant>>,
    ) -> Self {
        let next = match (has_more, is_at_rest) {
            (true, _) => now,
            (false, true) => now + REST_REVIEW_EVERY,
            (false, false) => now + REVIEW_EVERY,
        };
        Self { moved, next: due.into_iter().flatten().fold(next, Instant::min).max(now) }
    }
}

/// State of a route that has opened nothing yet.
pub(super) fn not_begun() -> RouteState {
    RouteState::Waiting(Cause::Starting("its first step"))
}

/// Order that the reconciler gives a route that goes on; its next step carries it out.
#[derive(Debug)]
pub(super) enum Order {
    /// Keep the source open from now on, whether a program listens or not.
    KeepOpen,
    /// Name listeners of another type than the route's, for as long as no other program listens.
    NameMisfits(Option<Misfit>),
    /// Keep the ends closed, because the route would close a circle over other bridges; open them again without one.
    StayClosed(Option<Cause>),
}

/// Reason that a route is to end.
#[derive(Debug, Clone)]
pub(super) struct Ending {
    pub(super) why: String,
    /// True when many routes end at once; each is then logged at level debug.
    pub(super) is_one_of_many: bool,
}

/// A route at work: no threads, no clock of its own.
pub(super) trait Work: Send {
    /// Brings the route one step on. Blocks only as long as a reliable destination does.
    fn step(&mut self, now: Instant) -> Progress;

    /// State of the route after its last step, quality of service in use at source and destination, and whether
    /// a program is known at the source.
    fn state(&self) -> (&RouteState, [Option<Qos>; 2], bool);

    /// True once the route has opened what it needs.
    fn is_open(&self) -> bool;

    /// Carries out an order; a route of a service has nothing to do for any.
    fn obey(&mut self, _order: Order) {}

    /// Closes both ends and counts the messages on their way; the next step opens the ends again.
    fn close(&mut self);
}
