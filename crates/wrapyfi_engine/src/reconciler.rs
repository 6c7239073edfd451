//! The reconciler, which compares the routes that are wanted with those that run, and starts and
//! stops routes by it.
//!
//! ```text
//!   plan ─ whole routes ──────────────────────────▶ candidates that start as they stand
//!        └ patterns ─┐
//!   discovered graph ┴─▶ note: what patterns mean ─▶ candidates
//!                                                        │ settle, each once a round
//!          no type is known, another bridge has it ◀┼▶ Change::Start ─▶ driver
//!          (status: waiting, with the reason)            └▶ Change::Stop     when its source is gone
//! ```
//!
//! A plan may be replaced: routes that are the same in both go on untouched, whether they are
//! written or a pattern made them. It has no threads and no clock of its own, as [`super::Relay`].

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::{Duration, Instant};

use wrapyfi_interfaces::store::TypeStore;

use super::candidate::{Candidate, CandidateState, Misfit};
use super::discovered_graph::{Away, DiscoveredGraph, DiscoveredMiddleware};
use super::news;
use super::pattern::Pattern;
use super::route::{Route, RouteKey, Typing};
use super::route_status::RouteState;
use super::work::{Ending, Order};
use wrapyfi_endpoint::backoff::Backoff;
use wrapyfi_endpoint::{
    BridgeMark, Cause, Counters, EndpointAddress, Interaction, Registry, Role, Throttle,
};
use wrapyfi_retry::contained;

/// Time between two looks.
pub const LOOK_EVERY: Duration = Duration::from_millis(500);
/// Time between two looks at the start and while sources come: each step to a route waits for a
/// look.
const HASTY_LOOK_EVERY: Duration = Duration::from_millis(100);
/// Time for which [`HASTY_LOOK_EVERY`] holds after the last source that came.
const HASTY_FOR: Duration = Duration::from_secs(3);
/// Time for which a source must have existed before its route is made.
const SETTLE: Duration = Duration::from_millis(700);
/// Time for which a source must be gone before its route ends.
pub const GONE_AFTER: Duration = Duration::from_secs(5);
/// Time without any change after which candidates are looked at less often, until there is one.
const CALM_AFTER: Duration = Duration::from_secs(10);
/// Time between two looks at all candidates then; a source that comes or goes is seen as soon as
/// ever.
const CALM_SCAN_EVERY: Duration = Duration::from_secs(4);
/// Time after the end of a route in which its destination still counts as ours on middlewares that
/// do not tell our endpoints from others': a topic of ZeroMQ shows for a minute after its last
/// message.
const OURS_FOR: Duration = Duration::from_secs(90);
/// Largest number of ended routes whose counters are kept for their return.
const MAX_KEPT: usize = 10_000;

/// Order to the driver.
#[derive(Debug)]
pub(super) enum Change {
    /// Run a route, with the counters that it had before.
    Start { id: u64, route: Box<Route>, counters: Arc<Counters> },
    /// Give an order to a route that goes on.
    Order { id: u64, order: Order },
    /// End a route.
    Stop { id: u64, ending: Ending },
}

pub(super) fn stop(id: u64, why: impl Into<String>) -> Change {
    Change::Stop { id, ending: Ending { why: why.into(), is_one_of_many: false } }
}

/// Pattern by its place in the plan, and the name of the source.
pub(super) type Key = (usize, String);

pub(super) struct Reconciler {
    pub(super) registry: Registry,
    /// Routes of the plan: one that is written is a pattern with one name.
    pub(super) patterns: Vec<Pattern>,
    /// Routes with one name by their ends, which patterns leave alone; their places in the plan.
    pub(super) explicit: BTreeMap<RouteKey, usize>,
    /// Addresses of what the program has about itself, which patterns leave alone.
    pub(super) own: BTreeSet<EndpointAddress>,
    pub(super) graph: DiscoveredGraph,
    pub(super) types: TypeStore,
    /// Number of this bridge in marks.
    pub(super) number: u64,
    pub(super) candidates: BTreeMap<Key, Candidate>,
    /// Destinations of our routes, for middlewares that do not tell our endpoints from others';
    /// with the instant until which they count as ours, once their route has ended.
    pub(super) ours: BTreeMap<(Interaction, EndpointAddress), Option<Instant>>,
    /// Counters of all routes that run or ran.
    pub(super) counters: BTreeMap<RouteKey, Arc<Counters>>,
    pub(super) next_id: u64,
    /// Words of the panic in the last look, until a look ends without one.
    pub(super) fault: Option<String>,
    pub(super) panics: u64,
    pub(super) backoff: Backoff,
    pub(super) complaints: Throttle,
    /// Instant of the last change.
    pub(super) stirred_at: Option<Instant>,
    /// Instant at which all candidates were looked at last.
    pub(super) scanned_at: Option<Instant>,
    /// Instant of the last look that left the candidates alone because nothing had changed.
    pub(super) unchanged_at: Option<Instant>,
    /// Instant at which the last new source came; that of the first look where none came.
    pub(super) came_at: Option<Instant>,
}

impl Reconciler {
    /// A reconciler without routes or patterns.
    pub(super) fn new(registry: &Registry) -> Self {
        Self {
            registry: registry.clone(),
            patterns: Vec::new(),
            explicit: BTreeMap::new(),
            own: BTreeSet::new(),
            graph: DiscoveredGraph::default(),
            types: TypeStore::from_environment().or_generated(),
            number: BridgeMark::number(),
            candidates: BTreeMap::new(),
            ours: BTreeMap::new(),
            counters: BTreeMap::new(),
            next_id: 1,
            fault: None,
            panics: 0,
            backoff: Backoff::new(BridgeMark::number()),
            complaints: Throttle::default(),
            stirred_at: None,
            scanned_at: None,
            unchanged_at: None,
            came_at: None,
        }
    }

    /// Starts the route of a candidate, under a number of its own.
    pub(super) fn start(&mut self, candidate: &mut Candidate, route: Route) -> Change {
        let id = self.next_id;
        self.next_id += 1;
        if self.counters.len() >= MAX_KEPT {
            self.counters.retain(|_, counters| Arc::strong_count(counters) > 1);
        }
        candidate.state = CandidateState::Runs(id);
        let counters = Arc::clone(self.counters.entry(route.key()).or_default());
        Change::Start { id, route: Box::new(route), counters }
    }

    /// Notes that a route has ended, whose destination may show for a while.
    pub(super) fn was_ours(&mut self, key: &RouteKey, now: Instant) {
        self.ours.insert((key.interaction, key.to.clone()), Some(now + OURS_FOR));
    }

    /// True when there are patterns, so that looks are needed.
    pub(super) fn has_patterns(&self) -> bool {
        self.patterns.iter().any(|pattern| !pattern.spec.is_whole())
    }

    /// Notes that a look panicked; time until the next one.
    pub(super) fn panicked(&mut self, panic: String, now: Instant) -> Duration {
        self.panics += 1;
        if let Some(unlogged_before) = self.complaints.pass(now) {
            tracing::error!(unlogged_before, "a look at what exists panicked: {panic}");
        }
        self.fault = Some(panic);
        self.backoff.wait()
    }

    /// Time from a look at `now` to the next one.
    pub(super) fn look_again_in(&self, now: Instant) -> Duration {
        let is_hasty = |at| now.saturating_duration_since(at) < HASTY_FOR;
        if self.came_at.is_some_and(is_hasty) { HASTY_LOOK_EVERY } else { LOOK_EVERY }
    }

    /// Looks at discovery; changes that follow from it.
    pub(super) fn scan(&mut self, now: Instant) -> Vec<Change> {
        self.came_at.get_or_insert(now);
        self.ours.retain(|_, until| until.is_none_or(|until| now < until));
        if self.graph.look(now) {
            self.stirred_at = Some(now);
        }
        let since = |at: Option<Instant>| at.map(|at| now.saturating_duration_since(at));
        let is_calm = since(self.stirred_at).is_some_and(|it| it >= CALM_AFTER);
        if is_calm && since(self.scanned_at).is_some_and(|it| it < CALM_SCAN_EVERY) {
            self.unchanged_at = Some(now);
            return Vec::new();
        }
        if let (Some(scanned), Some(unchanged)) = (self.scanned_at, self.unchanged_at.take()) {
            self.candidates.values_mut().for_each(|it| it.seen_until(scanned, unchanged));
        }
        self.scanned_at = Some(now);
        let before = self.candidates.len();
        for index in 0..self.patterns.len() {
            self.note(index, now);
        }
        if self.candidates.len() > before {
            self.came_at = Some(now);
        }
        let mut changes = Vec::new();
        let is_whole =
            |(index, _): &&Key| self.patterns.get(*index).is_some_and(|it| it.spec.is_whole());
        let keys: Vec<Key> = self.candidates.keys().filter(|key| !is_whole(key)).cloned().collect();
        for key in keys {
            // The other candidates stay in the map, because they may be in this one's way.
            let Some(mut candidate) = self.candidates.remove(&key) else { continue };
            let settled = contained(|| self.settle(&key, &mut candidate, now));
            let (is_kept, change) = settled.unwrap_or_else(|panic| {
                self.settling_panicked(&key, &mut candidate, &panic, now);
                (true, None)
            });
            changes.extend(change);
            if is_kept {
                self.candidates.insert(key, candidate);
            }
        }
        if self.fault.take().is_some() {
            self.backoff.reset();
        }
        for pattern in &mut self.patterns {
            pattern.news.tell(&pattern.spec, now);
        }
        news::summarize_endings(&mut changes);
        if !changes.is_empty() {
            self.stirred_at = Some(now);
        }
        changes
    }

    /// Enters the endpoints that the pattern matches as candidates.
    fn note(&mut self, index: usize, now: Instant) {
        let Some(pattern) = self.patterns.get_mut(index) else { return };
        let mut targets = std::mem::take(&mut pattern.targets);
        self.note_names(index, &mut targets, now);
        if let Some(pattern) = self.patterns.get_mut(index) {
            pattern.targets = targets;
        }
    }

    fn note_names(
        &mut self,
        index: usize,
        targets: &mut BTreeMap<String, Option<EndpointAddress>>,
        now: Instant,
    ) {
        let Some(pattern) = self.patterns.get(index) else { return };
        let spec = &pattern.spec;
        if !spec.is_many() {
            return;
        }
        let (middleware, max_routes) = (&spec.from.middleware, spec.max_routes());
        let Some(side) = self.graph.get(middleware).filter(|side| side.away().is_none()) else {
            return;
        };
        if targets.len() > MAX_KEPT {
            targets.clear();
        }
        let mut of_pattern = self.of_pattern(index).count();
        let (mut found, mut ahead, mut over) = (Vec::new(), Vec::new(), 0);
        let awaited = self.awaited_otherwise(spec);
        for name in side.names(spec.interaction().provider()) {
            let to = match targets.get(name) {
                Some(known) => known.clone(),
                None => {
                    let target = spec.target(name);
                    targets.insert(name.clone(), target.clone());
                    target
                }
            };
            let Some(to) = to else { continue };
            let to = self.destination(index, name, to, &awaited);
            let from = EndpointAddress { middleware: middleware.clone(), name: name.clone() };
            if self.is_left_out(spec, &from, &to) {
                continue;
            }
            let key = (index, name.clone());
            if !self.candidates.contains_key(&key) {
                if of_pattern >= max_routes {
                    over += 1;
                    continue;
                }
                of_pattern += 1;
            }
            found.push((key, from, to));
        }
        for name in self.awaited(pattern) {
            let Some(to) = spec.target(&name) else { continue };
            let from = EndpointAddress { middleware: middleware.clone(), name: name.clone() };
            let key = (index, name);
            let is_known = self.candidates.contains_key(&key);
            // The name is a guess, where a source that is there goes to this destination.
            let is_guess = found.iter().any(|(_, _, place)| *place == to);
            if let Some(candidate) =
                self.candidates.get_mut(&key).filter(|it| it.precedes_publisher && is_guess)
            {
                candidate.give_way(now.checked_sub(GONE_AFTER));
            }
            if is_guess
                || self.is_not_for_patterns(spec, &from, &to)
                || (!is_known && of_pattern >= max_routes)
            {
                continue;
            }
            of_pattern += usize::from(!is_known);
            ahead.push((key, from, to));
        }
        for (key, from, to) in found {
            let candidate = self.candidates.entry(key);
            let new = || Candidate::new(from, to.clone(), Some(now));
            let candidate = candidate.or_insert_with(new);
            candidate.seen(now);
            candidate.precedes_publisher = false;
            candidate.moves_to = (candidate.to != to).then_some(to);
        }
        for (key, from, to) in ahead {
            let candidate = self.candidates.entry(key);
            let candidate = candidate.or_insert_with(|| Candidate::new(from, to, Some(now)));
            candidate.seen(now);
            candidate.precedes_publisher = true;
        }
        let Some(pattern) = self.patterns.get_mut(index) else { return };
        pattern.over = over;
        if over > 0 && !std::mem::replace(&mut pattern.told_over, true) {
            tracing::error!(
                route = pattern.spec.name,
                "{max_routes} routes are the limit of this pattern, {over} more names match: raise \
                 max_routes, or narrow it with allow and deny"
            );
        }
    }

    /// Sources without a publisher that listeners at the destination wait for, where the
    /// destination has no publisher either.
    fn awaited(&self, pattern: &Pattern) -> Vec<String> {
        let spec = &pattern.spec;
        let (Some(source), Some(target), Some(inverse)) = (
            self.graph.get(&spec.from.middleware),
            self.graph.get(&spec.to.middleware).filter(|side| side.away().is_none()),
            &pattern.inverse,
        ) else {
            return Vec::new();
        };
        let Some(middleware) = &source.middleware else { return Vec::new() };
        let knows_others =
            source.routing_properties().tells_own && target.routing_properties().tells_own;
        if spec.interaction() != Interaction::Topic
            || !source.routing_properties().subscribes_first
            || !knows_others
        {
            return Vec::new();
        }
        let waits = |name: &&String| {
            let mut listeners = target.endpoints(Role::Listener, name).iter();
            listeners.any(|one| one.mark.is_none())
                && target.endpoints(Role::Publisher, name).is_empty()
        };
        let sources = target.names(Role::Listener).filter(waits);
        let sources = sources.filter_map(|name| spec.source(inverse, name));
        let sources = sources.filter(|name| {
            let to = spec.target(name);
            middleware.ahead_options(name).is_some()
                && to.is_some_and(|to| !self.has_source(spec.interaction(), &to))
        });
        sources.filter(|name| source.endpoints(Role::Publisher, name).is_empty()).collect()
    }

    pub(super) fn of_pattern(&self, index: usize) -> impl Iterator<Item = &Candidate> {
        self.candidates.range((index, String::new())..(index + 1, String::new())).map(|(_, c)| c)
    }

    /// Notes that a decision panicked: a route that runs goes on, another is tried again later.
    fn settling_panicked(
        &mut self,
        key: &Key,
        candidate: &mut Candidate,
        panic: &str,
        now: Instant,
    ) {
        let Some(pattern) = self.patterns.get_mut(key.0) else { return };
        pattern.panics += 1;
        let interaction = pattern.spec.interaction();
        candidate.retry_at = Some(now + self.backoff.wait());
        let what = "a decision on it panicked".to_owned();
        let cause = Cause::Panic { what, panic: panic.to_owned() };
        if let Some(unlogged_before) = self.complaints.pass(now) {
            tracing::error!(route = candidate.name(interaction), unlogged_before, "{cause}");
        }
        candidate.set_waiting(interaction, RouteState::Error(cause), true);
    }

    /// Brings one candidate on; true when it stays, and the change that follows.
    fn settle(
        &mut self,
        key: &Key,
        candidate: &mut Candidate,
        now: Instant,
    ) -> (bool, Option<Change>) {
        let Some(spec) = self.patterns.get(key.0).map(|pattern| Arc::clone(&pattern.spec)) else {
            return (false, None);
        };
        let interaction = spec.interaction();
        if let Some(to) = candidate.moves_to.take() {
            let state = std::mem::replace(&mut candidate.state, CandidateState::New);
            let left = candidate.key(interaction);
            candidate.to = to;
            if let CandidateState::Runs(id) = state {
                self.ended(key.0, &left, now);
                let why = format!("it goes to {} now, by the names of others", candidate.to);
                return (true, Some(stop(id, why)));
            }
        }
        if let Some(away) = self.away(&spec) {
            // A source that cannot be seen is not gone for that reason.
            candidate.seen(now);
            candidate.set_waiting(interaction, away, spec.is_many());
            return (true, None);
        }
        if let CandidateState::Runs(id) = candidate.state {
            let why = match self.goes_on_with(&spec, candidate, now) {
                Ok(misfits) => return (true, self.goes_on(&spec, candidate, id, misfits)),
                Err(why) => why,
            };
            self.ended(key.0, &candidate.key(interaction), now);
            let stays = !matches!(candidate.state, CandidateState::Runs(_));
            return (stays, Some(stop(id, why)));
        }
        if spec.is_many() && candidate.is_gone(now, GONE_AFTER) {
            return (false, None);
        }
        // A bridge that began earlier makes its route first: both would carry until one of them sees the other.
        let is_younger = self.graph.oldest_bridge().is_some_and(|other| other < self.number);
        let settle = if is_younger { 2 * SETTLE } else { SETTLE };
        if !candidate.is_due(now, settle) || !self.sides(&spec).all(|side| side.is_settled(now)) {
            if candidate.state == CandidateState::New && self.hindrance(&spec, candidate).is_none()
            {
                // Asks for the type now, so that it is known when the candidate is due.
                _ = self.types(&spec, candidate);
            }
            return (true, None);
        }
        let route = match self.make(&spec, candidate) {
            Ok(route) => route,
            // A candidate without publisher is dropped; a later look finds it again.
            Err(_) if candidate.precedes_publisher => return (false, None),
            Err(refusal) => {
                let (state, retry) = *refusal;
                candidate.retry_at = Some(now + retry);
                let is_silent = spec.is_many() && matches!(state, RouteState::Waiting(_));
                // Where nothing but a user can help, a line of the debug log is not enough.
                if candidate.set_waiting(interaction, state, spec.is_many())
                    && is_silent
                    && !retry.is_zero()
                    && let CandidateState::Waits(state) = &candidate.state
                    && let Some(pattern) = self.patterns.get_mut(key.0)
                {
                    let text = format!("{} is {state}", candidate.from);
                    pattern.news.add_waiting(candidate.name(interaction), text, now);
                }
                return (true, None);
            }
        };
        self.ours.insert((route.interaction(), route.to.clone()), None);
        (candidate.misfits, candidate.made) = (None, Some(route.types));
        candidate.closes_when_unwanted = route.policy.lazy;
        if let Some(pattern) = self.patterns.get_mut(key.0) {
            pattern.made += 1;
            pattern.news.add(candidate.name(interaction), &candidate.from, route.label(), now);
        }
        (true, Some(self.start(candidate, route)))
    }

    fn ended(&mut self, index: usize, key: &RouteKey, now: Instant) {
        if let Some(pattern) = self.patterns.get_mut(index) {
            pattern.ended += 1;
        }
        self.was_ours(key, now);
    }

    /// Listeners that the route of a candidate cannot serve, where it goes on.
    ///
    /// # Errors
    /// When the route cannot go on; the candidate's state then says whether another one may follow.
    fn goes_on_with(
        &mut self,
        spec: &Route,
        candidate: &mut Candidate,
        now: Instant,
    ) -> Result<Option<Misfit>, String> {
        if spec.typing != Typing::Given
            && let Some(other) =
                self.other_type(spec, candidate).or_else(|| self.other_called(spec, candidate))
        {
            candidate.state = CandidateState::New;
            return Err(other);
        }
        if spec.is_many() {
            if candidate.is_gone(now, GONE_AFTER) {
                return Err(match candidate.precedes_publisher {
                    true => "nobody waits for it any more".to_owned(),
                    false => "its source is gone".to_owned(),
                });
            }
            if candidate.precedes_publisher && self.has_source(spec.interaction(), &candidate.to) {
                return Err("another source has come".to_owned());
            }
            if let Some(rival) = self.rival(spec, candidate) {
                candidate.state = CandidateState::New;
                candidate.set_waiting(spec.interaction(), RouteState::Waiting(rival.clone()), true);
                return Err(rival.to_string());
            }
        }
        let misfits = self.misfits(spec, candidate);
        if let Some(instead) = misfits.instead {
            candidate.state = CandidateState::New;
            candidate.wished = Some(instead);
            return Err(misfits.named.map_or_else(String::new, |it| it.to_string()));
        }
        Ok(misfits.named)
    }

    /// Lets a route go on: its source is opened once a publisher has come that keeps messages, and
    /// listeners that it cannot serve are named.
    fn goes_on(
        &self,
        spec: &Route,
        candidate: &mut Candidate,
        id: u64,
        named: Option<Misfit>,
    ) -> Option<Change> {
        if candidate.misfits != named {
            candidate.misfits.clone_from(&named);
            return Some(Change::Order { id, order: Order::NameMisfits(named) });
        }
        let opens = candidate.closes_when_unwanted && self.keeps_last(spec, candidate);
        candidate.closes_when_unwanted &= !opens;
        opens.then_some(Change::Order { id, order: Order::KeepOpen })
    }

    /// Reason that nothing can be seen on one of the two sides.
    pub(super) fn away(&self, spec: &Route) -> Option<RouteState> {
        self.sides(spec).find_map(|side| side.away()).map(|away| match away {
            Away::Waiting(what) => RouteState::Waiting(what.clone()),
            Away::Failed(why) | Away::Unable(why) => RouteState::Error(why.clone()),
        })
    }

    /// Middlewares at the two ends of a route, as far as the reconciler looks at them.
    pub(super) fn sides(&self, spec: &Route) -> impl Iterator<Item = &DiscoveredMiddleware> {
        [&spec.from, &spec.to].into_iter().filter_map(|end| self.graph.get(&end.middleware))
    }

    /// True where a source that exists has this destination, also one that another pattern matches.
    pub(super) fn has_source(&self, interaction: Interaction, to: &EndpointAddress) -> bool {
        self.candidates.iter().any(|((index, _), other)| {
            !other.precedes_publisher
                && other.to == *to
                && self
                    .patterns
                    .get(*index)
                    .is_some_and(|pattern| pattern.spec.interaction() == interaction)
        })
    }

    /// Source of another candidate whose route already runs to this destination.
    pub(super) fn taken(
        &self,
        interaction: Interaction,
        to: &EndpointAddress,
    ) -> Option<EndpointAddress> {
        // The candidate in question is not among them while it is looked at.
        let runs = self.candidates.iter().find(|((index, _), other)| {
            matches!(other.state, CandidateState::Runs(_))
                && other.to == *to
                && self
                    .patterns
                    .get(*index)
                    .is_some_and(|pattern| pattern.spec.interaction() == interaction)
        });
        runs.map(|(_, other)| other.from.clone())
    }
}

#[cfg(test)]
#[path = "reconciler_tests.rs"]
mod tests;
