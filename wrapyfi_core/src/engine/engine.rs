//! Runs the routes of a plan: step by step for tests, on threads in production.
//!
//! ```text
//!   Plan ─ routes ──────────────▶ Work ─ start ─▶ a thread each
//!        └ patterns ─▶ Scout ─ Change::Make, KeepOpen, End ─▶ more of them, and fewer
//! ```
//!
//! Which thread steps a route is told in `threads`.

use std::sync::Arc;
use std::time::Instant;

use wrapyfi_interfaces::store::TypeStore;

use super::plan::Plan;
use super::relay::{Relay, Step};
use super::route::RouteStatus;
use super::running::Running;
use super::scout::{Change, Made, Scout};
use super::service_relay::ServiceRelay;
use crate::endpoint::{Counters, Registry, Wake};

/// The routes of a plan, not running yet.
pub struct Engine {
    registry: Registry,
    relays: Vec<(u64, Work)>,
    scout: Option<Scout>,
    look_at: Option<Instant>,
}

/// A route at work.
pub(super) enum Work {
    Topic(Box<Relay>),
    Service(Box<ServiceRelay>),
}

impl Work {
    /// A route that a pattern made.
    pub(super) fn made(id: u64, made: Made, counters: Arc<Counters>, registry: &Registry) -> Self {
        match made {
            Made::Topic(spec) => {
                Self::Topic(Box::new(Relay::new(*spec, registry, id).counting(counters)))
            }
            Made::Service(spec) => {
                Self::Service(Box::new(ServiceRelay::new(*spec, registry, id).counting(counters)))
            }
        }
    }

    pub(super) fn step(&mut self, now: Instant) -> Step {
        match self {
            Self::Topic(relay) => relay.step(now),
            Self::Service(relay) => relay.step(now),
        }
    }

    /// Whether it moves nothing, because nobody wants it.
    pub(super) fn is_at_rest(&self, now: Instant) -> bool {
        match self {
            Self::Topic(relay) => relay.is_at_rest(),
            Self::Service(relay) => relay.is_at_rest(now),
        }
    }

    /// As [`Relay::keep_open`]; services have no source.
    pub(super) fn keep_open(&mut self) {
        if let Self::Topic(relay) = self {
            relay.keep_open();
        }
    }

    /// As [`Relay::name_misfits`]; services have none.
    pub(super) fn name_misfits(&mut self, named: Option<String>) {
        if let Self::Topic(relay) = self {
            relay.name_misfits(named);
        }
    }

    pub(super) fn status(&self) -> RouteStatus {
        match self {
            Self::Topic(relay) => relay.status(),
            Self::Service(relay) => relay.status(),
        }
    }

    pub(super) fn wake(&self) -> &Wake {
        match self {
            Self::Topic(relay) => relay.wake(),
            Self::Service(relay) => relay.wake(),
        }
    }
}

/// Says that a route by pattern is over, and what it has done.
pub(super) fn log_end(status: &RouteStatus, why: &str, is_one_of_many: bool) {
    let (received, sent) = (status.counters.received, status.counters.sent);
    let dropped = status.counters.dropped();
    let text = format!("route ended: {why}; {received} in, {sent} out, {dropped} dropped");
    match is_one_of_many {
        true => tracing::debug!(route = status.name, "{text}"),
        false => tracing::info!(route = status.name, "{text}"),
    }
}

impl Engine {
    /// Prepares the routes; nothing is opened before the first step.
    #[must_use]
    pub fn new(plan: Plan, registry: &Registry) -> Self {
        let first_id = plan.routes.len().saturating_add(plan.services.len()) as u64 + 1;
        let scout = (!plan.patterns.is_empty()).then(|| Scout::new(&plan, registry, first_id));
        let Plan { routes, services, patterns: _ } = plan;
        let mut ids = 1..;
        let mut id = || ids.next().unwrap_or_default();
        let mut relays = Vec::with_capacity(routes.len() + services.len());
        for spec in routes {
            let id = id();
            relays.push((id, Work::Topic(Box::new(Relay::new(spec, registry, id)))));
        }
        for spec in services {
            let id = id();
            relays.push((id, Work::Service(Box::new(ServiceRelay::new(spec, registry, id)))));
        }
        Self { registry: registry.clone(), relays, scout, look_at: None }
    }

    /// Where definitions of types are looked up that patterns learn; unless said, where
    /// `AMENT_PREFIX_PATH` says, then among those that are built in.
    #[must_use]
    pub fn with_types(mut self, types: TypeStore) -> Self {
        if let Some(scout) = &mut self.scout {
            scout.types = types;
        }
        self
    }

    /// Brings every route one step on; the number of messages taken.
    pub fn step(&mut self, now: Instant) -> usize {
        if self.look_at.is_none_or(|at| now >= at)
            && let Some(scout) = &mut self.scout
        {
            let changes = scout.scan(now);
            self.look_at = Some(now + scout.look_again_in(now));
            for change in changes {
                match change {
                    Change::Make { id, made, counters } => {
                        self.relays.push((id, Work::made(id, made, counters, &self.registry)));
                    }
                    Change::KeepOpen { id } => {
                        let route = self.relays.iter_mut().find(|it| it.0 == id);
                        route.into_iter().for_each(|(_, work)| work.keep_open());
                    }
                    Change::Misfits { id, named } => {
                        let route = self.relays.iter_mut().find(|it| it.0 == id);
                        route.into_iter().for_each(|(_, work)| work.name_misfits(named.clone()));
                    }
                    Change::End { id, why, is_one_of_many } => {
                        let (over, stays) =
                            std::mem::take(&mut self.relays).into_iter().partition(|it| it.0 == id);
                        self.relays = stays;
                        let over: Vec<(u64, Work)> = over;
                        over.iter()
                            .for_each(|(_, work)| log_end(&work.status(), &why, is_one_of_many));
                    }
                }
            }
        }
        self.relays.iter_mut().map(|(_, relay)| relay.step(now).moved).sum()
    }

    /// The routes now, then the patterns, and what they mean that is no route yet.
    #[must_use]
    pub fn status(&self) -> Vec<RouteStatus> {
        let found = self.scout.as_ref().map(Scout::status).unwrap_or_default();
        self.relays.iter().map(|(_, relay)| relay.status()).chain(found).collect()
    }

    /// Runs the routes on threads: one for each that has something to do, one for all others, and one for
    /// the patterns.
    ///
    /// # Errors
    /// When the system refuses a thread; the routes started before it are stopped.
    pub fn start(self) -> std::io::Result<Running> {
        Running::start(self.registry, self.relays, self.scout)
    }
}
