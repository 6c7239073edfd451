//! Makes routes by pattern as what they take comes, and ends them when it is gone.
//!
//! ```text
//!   sides ─ names, roles ─▶ note: what patterns mean ─▶ candidates
//!                                                          │ settle, each once a round
//!            nobody tells the type, another bridge has it ◀┼▶ Change::Make ─▶ engine: a Relay
//!            (status: waiting, with the reason)            └▶ Change::End     when its source is gone
//! ```
//!
//! No threads and no clock of its own, as [`super::Relay`].

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::{Duration, Instant};

use wrapyfi_interfaces::store::TypeStore;

use super::candidate::{Candidate, State};
use super::news::{self, News};
use super::pattern::Inverse;
use super::plan::{Plan, RouteSpec};
use super::plan_pattern::{Carried, PatternSpec, Source};
use super::plan_service::ServiceRouteSpec;
use super::route::{PatternCounts, RouteState, RouteStatus};
use super::sides::{Away, Side, Sides};
use crate::endpoint::{BridgeMark, Counters, CountersSnapshot, EndpointAddress, Registry, Role};

/// How often it looks.
pub(crate) const LOOK_EVERY: Duration = Duration::from_millis(500);
/// How often it looks at the start and while sources come: each step to a route waits for a look.
const HASTY_LOOK_EVERY: Duration = Duration::from_millis(100);
/// How long it looks so after the last source that came.
const HASTY_FOR: Duration = Duration::from_secs(3);
/// How long a source must have been there before its route is made.
const SETTLE: Duration = Duration::from_millis(700);
/// How long a source must be gone before its route ends.
pub(crate) const GONE_AFTER: Duration = Duration::from_secs(5);
/// Time without any change after which candidates are looked at less often, until there is one.
const CALM_AFTER: Duration = Duration::from_secs(10);
/// How often they are looked at then: what comes and goes is seen as soon as ever.
const CALM_SCAN_EVERY: Duration = Duration::from_secs(4);
/// Routes that ended whose counters are kept for when they come back.
const MAX_KEPT: usize = 10_000;

/// A route as it is to be run.
#[derive(Debug)]
pub(super) enum Made {
    Topic(Box<RouteSpec>),
    Service(Box<ServiceRouteSpec>),
}

/// What the engine has to do.
#[derive(Debug)]
pub(super) enum Change {
    /// Run a route; it counts where it counted before.
    Make { id: u64, made: Made, counters: Arc<Counters> },
    /// Open its source, and keep it open whether somebody listens or not.
    KeepOpen { id: u64 },
    /// Name listeners that it cannot serve in its reason; none any more.
    Misfits { id: u64, named: Option<String> },
    /// End it, and say why; in a low voice where many end at once.
    End { id: u64, why: String, is_one_of_many: bool },
}

/// Pattern by its place in the plan, and the name of the source.
pub(super) type Key = (usize, String);

pub(super) struct Scout {
    pub(super) patterns: Vec<Pattern>,
    /// Routes that the configuration names.
    pub(super) explicit: Vec<(Role, EndpointAddress, EndpointAddress)>,
    pub(super) sides: Sides,
    pub(super) types: TypeStore,
    /// The mark's.
    pub(super) number: u64,
    candidates: BTreeMap<Key, Candidate>,
    /// Destinations that are or were ours, for middlewares that do not tell.
    pub(super) ours: BTreeSet<(Role, EndpointAddress)>,
    /// Of routes by pattern, by name.
    counters: BTreeMap<String, Arc<Counters>>,
    next_id: u64,
    /// When something was other than before.
    stirred_at: Option<Instant>,
    /// When all candidates were looked at.
    scanned_at: Option<Instant>,
    /// When nothing had changed since.
    unchanged_at: Option<Instant>,
    /// When a source came that was not there before, or the first look was.
    came_at: Option<Instant>,
}

pub(super) struct Pattern {
    pub(super) spec: Arc<PatternSpec>,
    /// Tells the source that a listener at the destination waits for.
    inverse: Option<Inverse>,
    /// Names beyond the limit, at the last look.
    over: usize,
    told_over: bool,
    made: u64,
    ended: u64,
    /// What its names become.
    targets: BTreeMap<String, Option<EndpointAddress>>,
    news: News,
}

impl Scout {
    /// Nothing is looked at yet. `first_id` is beyond the routes that the plan names.
    pub(super) fn new(plan: &Plan, registry: &Registry, first_id: u64) -> Self {
        let topics = plan.routes.iter().map(|it| (Role::Publisher, it.from.clone(), it.to.clone()));
        let services =
            plan.services.iter().map(|it| (Role::Server, it.service.clone(), it.offered.clone()));
        let mut explicit: Vec<_> = topics.chain(services).collect();
        let mut candidates = BTreeMap::new();
        for (index, spec) in plan.patterns.iter().enumerate() {
            if let Source::One(from) = &spec.from {
                explicit.push((spec.role(), from.clone(), spec.to.clone()));
                let candidate = Candidate::new(from.clone(), spec.to.clone(), None);
                candidates.insert((index, from.name.clone()), candidate);
            }
        }
        let specs: Vec<_> = plan.patterns.iter().map(|spec| Arc::new(spec.clone())).collect();
        let patterns = specs.iter().map(|spec| Pattern {
            spec: Arc::clone(spec),
            inverse: spec.inverse(),
            over: 0,
            told_over: false,
            made: 0,
            ended: 0,
            targets: BTreeMap::new(),
            news: News::default(),
        });
        Self {
            patterns: patterns.collect(),
            sides: Sides::new(registry, &specs),
            explicit,
            types: TypeStore::from_environment().or_generated(),
            number: BridgeMark::number(),
            candidates,
            ours: BTreeSet::new(),
            counters: BTreeMap::new(),
            next_id: first_id,
            stirred_at: None,
            scanned_at: None,
            unchanged_at: None,
            came_at: None,
        }
    }

    /// How long after a look at `now` the next one is due.
    pub(super) fn look_again_in(&self, now: Instant) -> Duration {
        let is_hasty = |at| now.saturating_duration_since(at) < HASTY_FOR;
        if self.came_at.is_some_and(is_hasty) { HASTY_LOOK_EVERY } else { LOOK_EVERY }
    }

    /// Looks at what exists; what is to be done about it.
    pub(super) fn scan(&mut self, now: Instant) -> Vec<Change> {
        self.came_at.get_or_insert(now);
        if self.sides.look(now) {
            self.stirred_at = Some(now);
        }
        let since = |at: Option<Instant>| at.map(|at| now.saturating_duration_since(at));
        let is_calm = since(self.stirred_at).is_some_and(|it| it >= CALM_AFTER);
        if is_calm && since(self.scanned_at).is_some_and(|it| it < CALM_SCAN_EVERY) {
            self.unchanged_at = Some(now);
            return Vec::new();
        }
        if let (Some(scanned), Some(unchanged)) = (self.scanned_at, self.unchanged_at.take()) {
            self.candidates.values_mut().for_each(|it| it.stayed(scanned, unchanged));
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
        let keys: Vec<Key> = self.candidates.keys().cloned().collect();
        for key in keys {
            // The others stay where they are: they may be in its way.
            let Some(candidate) = self.candidates.remove(&key) else { continue };
            let (kept, change) = self.settle(&key, candidate, now);
            changes.extend(change);
            if let Some(kept) = kept {
                self.candidates.insert(key, kept);
            }
        }
        for pattern in &mut self.patterns {
            pattern.news.tell(&pattern.spec, now);
        }
        news::lower(&mut changes);
        if !changes.is_empty() {
            self.stirred_at = Some(now);
        }
        changes
    }

    /// Enters what the pattern means of what is there.
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
        let Source::Names { middleware, .. } = &spec.from else { return };
        let Some(side) = self.sides.get(middleware).filter(|side| side.away().is_none()) else {
            return;
        };
        if targets.len() > MAX_KEPT {
            targets.clear();
        }
        let mut of_pattern = self.of_pattern(index).count();
        let (mut found, mut ahead, mut over) = (Vec::new(), Vec::new(), 0);
        for name in side.names(spec.role()) {
            let to = match targets.get(name) {
                Some(known) => known.clone(),
                None => {
                    let target = spec.target(name);
                    targets.insert(name.clone(), target.clone());
                    target
                }
            };
            let Some(to) = to else { continue };
            let to = self.apart(index, side, name, to);
            let from = EndpointAddress { middleware: middleware.clone(), name: name.clone() };
            if self.is_left_out(spec, &from, &to) {
                continue;
            }
            let key = (index, name.clone());
            if !self.candidates.contains_key(&key) {
                if of_pattern >= spec.max_routes {
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
            if self.is_by_hand(spec, &from, &to) || (!is_known && of_pattern >= spec.max_routes) {
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
            candidate.is_ahead = false;
            candidate.moves_to = (candidate.to != to).then_some(to);
        }
        for (key, from, to) in ahead {
            let candidate = self.candidates.entry(key);
            let candidate = candidate.or_insert_with(|| Candidate::new(from, to, Some(now)));
            candidate.seen(now);
            candidate.is_ahead = true;
        }
        let Some(pattern) = self.patterns.get_mut(index) else { return };
        pattern.over = over;
        if over > 0 && !std::mem::replace(&mut pattern.told_over, true) {
            let (name, most) = (&pattern.spec.name, pattern.spec.max_routes);
            tracing::error!(
                route = name,
                "{most} routes are the limit of this pattern, {over} more names match: raise \
                 max_routes, or narrow it with allow and deny"
            );
        }
    }

    /// Where the source called `name` goes, which alone would go to `to`. Names of YARP may differ by a
    /// colon, which no name of ROS has: where `/a/b:o` and `/a/b/o` would become one, that with the colon
    /// is `/a/b/o_`.
    fn apart(
        &self,
        index: usize,
        side: &Side,
        name: &str,
        mut to: EndpointAddress,
    ) -> EndpointAddress {
        let (Some((before, last)), Some(pattern)) =
            (name.rsplit_once(':'), self.patterns.get(index))
        else {
            return to;
        };
        let (spec, plain) = (&pattern.spec, format!("{before}/{last}"));
        let others = self.patterns.iter().map(|other| &other.spec);
        let mut others = others.filter(|other| {
            other.role() == spec.role() && other.source_middleware() == spec.source_middleware()
        });
        if !side.endpoints(spec.role(), &plain).is_empty()
            && others.any(|other| other.target(&plain).as_ref() == Some(&to))
        {
            to.name.push('_');
        }
        to
    }

    /// Sources that nobody publishes yet, and that listeners at the destination wait for: theirs has no
    /// publisher either.
    fn awaited(&self, pattern: &Pattern) -> Vec<String> {
        let spec = &pattern.spec;
        let (Some(source), Some(target), Some(inverse)) = (
            self.sides.get(spec.source_middleware()),
            self.sides.get(&spec.to.middleware).filter(|side| side.away().is_none()),
            &pattern.inverse,
        ) else {
            return Vec::new();
        };
        let knows_others = source.traits().tells_own && target.traits().tells_own;
        if spec.role() != Role::Publisher || !source.traits().subscribes_first || !knows_others {
            return Vec::new();
        }
        let waits = |name: &&String| {
            let mut listeners = target.endpoints(Role::Listener, name).iter();
            listeners.any(|one| one.mark.is_none())
                && target.endpoints(Role::Publisher, name).is_empty()
        };
        let sources = target.names(Role::Listener).filter(waits);
        let sources = sources.filter_map(|name| inverse.source(name));
        sources.filter(|name| source.endpoints(Role::Publisher, name).is_empty()).collect()
    }

    fn of_pattern(&self, index: usize) -> impl Iterator<Item = &Candidate> {
        self.candidates.range((index, String::new())..(index + 1, String::new())).map(|(_, c)| c)
    }

    /// Brings one candidate on; what stays of it, and what is to be done.
    fn settle(
        &mut self,
        key: &Key,
        mut candidate: Candidate,
        now: Instant,
    ) -> (Option<Candidate>, Option<Change>) {
        let Some(spec) = self.patterns.get(key.0).map(|pattern| Arc::clone(&pattern.spec)) else {
            return (None, None);
        };
        let name = candidate.name(spec.role());
        if let Some(to) = candidate.moves_to.take() {
            let state = std::mem::replace(&mut candidate.state, State::New);
            candidate.to = to;
            if let State::Runs(id) = state {
                if let Some(pattern) = self.patterns.get_mut(key.0) {
                    pattern.ended += 1;
                }
                let why = format!("it goes to {} now: another source has its name", candidate.to);
                let end = Change::End { id, why, is_one_of_many: false };
                return (Some(candidate), Some(end));
            }
        }
        if let Some(away) = self.away(&spec) {
            // Nothing is gone because it cannot be seen.
            candidate.seen(now);
            candidate.waits(&name, away, spec.is_many());
            return (Some(candidate), None);
        }
        if let State::Runs(id) = candidate.state {
            let why = match self.rival(&spec, &candidate) {
                _ if !spec.is_many() => return self.goes_on(&spec, candidate, id, None),
                _ if candidate.is_gone(now, GONE_AFTER) => match candidate.is_ahead {
                    true => "nobody waits for it any more".to_owned(),
                    false => "its source is gone".to_owned(),
                },
                Some(rival) if candidate.yields(now, self.number) => {
                    candidate.state = State::New;
                    candidate.waits(&name, RouteState::Waiting(rival.clone()), true);
                    rival
                }
                Some(_) => return (Some(candidate), None),
                None => {
                    candidate.has_no_rival();
                    let guessed = candidate.guessed_type;
                    let told = guessed.and_then(|_| self.told_by_sources(&spec, &candidate));
                    match (guessed, told) {
                        (Some(guessed), Some(told)) if guessed != told => {
                            (candidate.state, candidate.guessed_type) = (State::New, None);
                            format!("its publishers have the type {told}, not {guessed}")
                        }
                        (_, told) => {
                            if told.is_some() {
                                candidate.guessed_type = None;
                            }
                            let misfits = self.misfits(&spec, &candidate);
                            let Some(instead) = misfits.instead else {
                                return self.goes_on(&spec, candidate, id, misfits.named);
                            };
                            candidate.state = State::New;
                            candidate.wished = Some(instead);
                            misfits.named.unwrap_or_default()
                        }
                    }
                }
            };
            if let Some(pattern) = self.patterns.get_mut(key.0) {
                pattern.ended += 1;
            }
            let stays = !matches!(candidate.state, State::Runs(_));
            return (
                stays.then_some(candidate),
                Some(Change::End { id, why, is_one_of_many: false }),
            );
        }
        if spec.is_many() && candidate.is_gone(now, GONE_AFTER) {
            return (None, None);
        }
        if !candidate.is_due(now, SETTLE) || !self.are_settled(&spec, now) {
            if candidate.state == State::New {
                // What takes time to learn is begun now, and known when it is due.
                _ = self.told_by_sources(&spec, &candidate);
            }
            return (Some(candidate), None);
        }
        let made = match self.make(&spec, &candidate) {
            Ok(made) => made,
            // Nobody has missed it yet.
            Err(_) if candidate.is_ahead => return (None, None),
            Err((state, retry)) => {
                candidate.retry_at(now + retry);
                candidate.waits(&name, state, spec.is_many());
                return (Some(candidate), None);
            }
        };
        let id = self.next_id;
        self.next_id += 1;
        candidate.state = State::Runs(id);
        self.ours.insert((spec.role(), candidate.to.clone()));
        (candidate.misfits, candidate.carried) = (None, None);
        let label = match &made {
            Made::Topic(route) => {
                candidate.rests = route.lazy;
                candidate.carried = Some(route.message_type);
                route.message_type.label()
            }
            Made::Service(route) => route.kind.ros_type(),
        };
        candidate.guessed_type = candidate.is_ahead.then_some(label);
        if let Some(pattern) = self.patterns.get_mut(key.0) {
            pattern.made += 1;
            pattern.news.add(name.clone(), &candidate.from, label, now);
        }
        if self.counters.len() >= MAX_KEPT {
            self.counters.retain(|_, counters| Arc::strong_count(counters) > 1);
        }
        let counters = Arc::clone(self.counters.entry(name).or_default());
        (Some(candidate), Some(Change::Make { id, made, counters }))
    }

    /// A route stays; its source is opened once a publisher has come that keeps messages, and listeners
    /// that it cannot serve are named.
    fn goes_on(
        &self,
        spec: &PatternSpec,
        mut candidate: Candidate,
        id: u64,
        misfits: Option<String>,
    ) -> (Option<Candidate>, Option<Change>) {
        if candidate.misfits != misfits {
            candidate.misfits.clone_from(&misfits);
            return (Some(candidate), Some(Change::Misfits { id, named: misfits }));
        }
        let opens = candidate.rests && self.keeps_last(spec, &candidate);
        if opens {
            candidate.rests = false;
        }
        (Some(candidate), opens.then_some(Change::KeepOpen { id }))
    }

    /// Why nothing can be seen on one of the two sides.
    fn away(&self, spec: &PatternSpec) -> Option<RouteState> {
        let sides =
            [spec.source_middleware(), &spec.to.middleware].map(|name| self.sides.get(name));
        sides.into_iter().flatten().find_map(|side| side.away()).map(|away| match away {
            Away::Waiting(what) => RouteState::Waiting(what.clone()),
            Away::Unable(why) => RouteState::Error(why.clone()),
        })
    }

    fn are_settled(&self, spec: &PatternSpec, now: Instant) -> bool {
        let sides =
            [spec.source_middleware(), &spec.to.middleware].map(|name| self.sides.get(name));
        sides.into_iter().flatten().all(|side| side.is_settled(now))
    }

    /// Whether another candidate already runs to this destination; its source.
    pub(super) fn taken(&self, role: Role, to: &EndpointAddress) -> Option<EndpointAddress> {
        // The candidate in question is not among them while it is looked at.
        let runs = self.candidates.iter().find(|((index, _), other)| {
            matches!(other.state, State::Runs(_))
                && other.to == *to
                && self.patterns.get(*index).is_some_and(|pattern| pattern.spec.role() == role)
        });
        runs.map(|(_, other)| other.from.clone())
    }

    /// A route could not be started.
    pub(super) fn failed(&mut self, id: u64, why: &str) {
        let runs = |it: &Candidate| it.state == State::Runs(id);
        let found = self.candidates.iter_mut().find(|(_, candidate)| runs(candidate));
        if let Some(((index, _), candidate)) = found
            && let Some(pattern) = self.patterns.get(*index)
        {
            candidate.state = State::New;
            let name = candidate.name(pattern.spec.role());
            candidate.waits(&name, RouteState::Error(why.to_owned()), true);
        }
    }

    /// The patterns, and what waits.
    pub(super) fn status(&self) -> Vec<RouteStatus> {
        let mut all = Vec::new();
        for (index, pattern) in self.patterns.iter().enumerate() {
            let spec = &pattern.spec;
            if spec.is_many() {
                all.push(self.pattern_status(index, pattern));
            }
            for candidate in self.of_pattern(index) {
                let State::Waits(state) = &candidate.state else { continue };
                all.push(RouteStatus {
                    name: candidate.name(spec.role()),
                    message_type: "unknown",
                    ..idle(&spec.carried, &candidate.from, &candidate.to, state.clone())
                });
            }
        }
        all
    }

    fn pattern_status(&self, index: usize, pattern: &Pattern) -> RouteStatus {
        let spec = &pattern.spec;
        let (mut routes, mut waiting) = (0, 0);
        for candidate in self.of_pattern(index) {
            match candidate.state {
                State::Runs(_) => routes += 1,
                State::New | State::Waits(_) => waiting += 1,
            }
        }
        let state = self.away(spec).unwrap_or_else(|| match (pattern.over, routes + waiting) {
            (0, 0) => RouteState::Waiting("a name that matches".to_owned()),
            (0, _) => RouteState::Active,
            (over, _) => RouteState::Degraded(format!(
                "{} routes are the limit (max_routes), {over} more names match",
                spec.max_routes
            )),
        });
        let from = match &spec.from {
            Source::One(address) => address.clone(),
            Source::Names { middleware, pattern, .. } => {
                EndpointAddress { middleware: middleware.clone(), name: pattern.to_string() }
            }
        };
        RouteStatus {
            name: spec.name.clone(),
            pattern: Some(PatternCounts {
                routes,
                waiting,
                over_limit: pattern.over,
                made: pattern.made,
                ended: pattern.ended,
            }),
            ..idle(&spec.carried, &from, &spec.to, state)
        }
    }
}

/// The status of something that carries nothing itself.
fn idle(
    carried: &Carried,
    from: &EndpointAddress,
    to: &EndpointAddress,
    state: RouteState,
) -> RouteStatus {
    // Services show who is offered first, as their routes do.
    let (from, to) = match carried {
        Carried::Topics { .. } => (from, to),
        Carried::Services { .. } => (to, from),
    };
    RouteStatus {
        name: String::new(),
        from: from.to_string(),
        to: to.to_string(),
        message_type: "by pattern",
        state,
        from_qos: None,
        to_qos: None,
        counters: CountersSnapshot::default(),
        pattern: None,
    }
}

#[cfg(test)]
#[path = "scout_tests.rs"]
mod tests;
