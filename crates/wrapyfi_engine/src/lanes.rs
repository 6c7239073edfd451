//! Busy routes of a bridge, so that one may tell an answer from a loop.
//!
//! ```text
//!   a:/ask ─▶ this route ─▶ b:/ask     a program answers: the route back falls silent, too,
//!   a:/answer ◀─ route back ◀─ b:/answer     while this one's messages are held
//! ```

use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Weak};
use std::time::{Duration, Instant};

use wrapyfi_endpoint::{Counters, EndpointAddress, Mutex};

/// Share of the expected messages above which a publisher is at work.
pub(super) const PUBLISHES: f64 = 0.3;

/// Busy routes of a bridge.
#[derive(Default)]
pub(super) struct Lanes(Mutex<Vec<Weak<Lane>>>);

/// One busy route.
pub(super) struct Lane {
    from: EndpointAddress,
    to: EndpointAddress,
    counters: Arc<Counters>,
    pub(super) is_in_trial: AtomicBool,
}

impl Lane {
    /// True where the other leads back between the same middlewares, from and to other names. Its messages may be
    /// the answers to those of this one.
    fn is_answered_by(&self, other: &Self) -> bool {
        let name = |end: &EndpointAddress| end.name.trim_start_matches('/').to_owned();
        self.from.middleware == other.to.middleware
            && self.to.middleware == other.from.middleware
            && name(&self.from) != name(&other.to)
            && name(&self.to) != name(&other.from)
    }
}

impl Lanes {
    pub(super) fn enter(
        &self,
        from: &EndpointAddress,
        to: &EndpointAddress,
        counters: Arc<Counters>,
    ) -> Arc<Lane> {
        let (from, to, is_in_trial) = (from.clone(), to.clone(), AtomicBool::new(false));
        let lane = Arc::new(Lane { from, to, counters, is_in_trial });
        let mut lanes = self.0.lock();
        lanes.retain(|lane| lane.strong_count() > 0);
        lanes.push(Arc::downgrade(&lane));
        lane
    }

    fn back(&self, lane: &Lane) -> Vec<Arc<Lane>> {
        let lanes = self.0.lock();
        lanes.iter().filter_map(Weak::upgrade).filter(|other| lane.is_answered_by(other)).collect()
    }

    /// Begins a trial of a route, with the routes that may carry its answers; `None` while one of these is in a
    /// trial, because either would take the other's silence for its own work.
    pub(super) fn begin(&self, lane: &Lane, now: Instant) -> Option<Vec<Answer>> {
        let back = self.back(lane);
        if back.iter().any(|other| other.is_in_trial.load(Relaxed)) {
            return None;
        }
        lane.is_in_trial.store(true, Relaxed);
        Some(back.into_iter().map(|lane| Answer::new(lane, now)).collect())
    }
}

/// Messages of a route back, while this one's pass and while they are held.
pub(super) struct Answer {
    lane: Arc<Lane>,
    mark: (u64, Instant),
    passing: (u64, Duration),
    quiet: (u64, Duration),
}

impl Answer {
    fn new(lane: Arc<Lane>, now: Instant) -> Self {
        let none = (0, Duration::ZERO);
        Self { mark: (0, now), lane, passing: none, quiet: none }
    }

    /// Messages since the last call.
    pub(super) fn since(&mut self, now: Instant) -> (u64, Duration) {
        let received = self.lane.counters.received_so_far();
        let (before, at) = std::mem::replace(&mut self.mark, (received, now));
        (received.saturating_sub(before), now.saturating_duration_since(at))
    }

    pub(super) fn has_passed(&mut self, now: Instant) {
        let (messages, time) = self.since(now);
        self.passing = (self.passing.0 + messages, self.passing.1 + time);
    }

    pub(super) fn was_quiet(&mut self, now: Instant) {
        let (messages, time) = self.since(now);
        self.quiet = (self.quiet.0 + messages, self.quiet.1 + time);
    }

    /// True where the route back carried about as many messages, and none while this route's were held: a program
    /// answers what it hears.
    pub(super) fn fell_silent(&self, rate_hz: f64) -> bool {
        let rate =
            |(messages, time): (u64, Duration)| messages as f64 / time.as_secs_f64().max(0.001);
        rate(self.passing) >= rate_hz / 2.0 && rate(self.quiet) < rate(self.passing) * PUBLISHES
    }
}
