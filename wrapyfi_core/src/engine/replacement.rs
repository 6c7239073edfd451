//! A plan in place of another: what is the same in both goes on untouched.
//!
//! ```text
//!   written before ─ the same key and settings ─▶ stays   ─ others ─▶ Change::Stop
//!   made by a pattern ─ a pattern of now makes it the same ─▶ stays, under that pattern
//!   written now, and not running ─▶ Change::Start
//! ```

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

use super::candidate::{Candidate, State};
use super::news;
use super::plan::Plan;
use super::plan_pattern::{PatternSpec, Source};
use super::reconciler::{Change, Key, Pattern, Reconciler, stop};
use super::route::{Route, RouteKey};
use crate::endpoint::EndpointAddress;

/// Why a new plan ends a route.
const CHANGED: &str = "its settings have changed";
const REMOVED: &str = "the configuration has it no more";

impl Reconciler {
    /// Wants the routes of `plan`, and no others. Routes that are the same go on; of the others, those that
    /// end come first.
    pub(super) fn replace(&mut self, plan: Plan, now: Instant) -> Vec<Change> {
        let topics = plan.routes.into_iter().map(|spec| Route::Topic(Box::new(spec)));
        let services = plan.services.into_iter().map(|spec| Route::Service(Box::new(spec)));
        let routes: Vec<Route> = topics.chain(services).collect();
        let mut changes = Vec::new();
        let wanted: BTreeMap<RouteKey, &Route> =
            routes.iter().map(|route| (route.key(), route)).collect();
        let written = std::mem::take(&mut self.written);
        for (key, (id, route)) in written {
            match wanted.get(&key) {
                Some(same) if **same == route => {
                    self.written.insert(key, (id, route));
                }
                Some(_) => changes.push(stop(id, CHANGED)),
                None => {
                    changes.push(stop(id, REMOVED));
                    self.was_ours(&key, now);
                }
            }
        }
        let of_patterns = plan.patterns.iter().filter_map(PatternSpec::key_of_one);
        self.explicit = wanted.into_keys().chain(of_patterns).collect();
        let before = std::mem::take(&mut self.patterns);
        self.patterns = plan.patterns.into_iter().map(Pattern::new).collect();
        let specs: Vec<_> = self.patterns.iter().map(|it| Arc::clone(&it.spec)).collect();
        self.graph.follow(&self.registry, &specs);
        self.adopt(&before, now, &mut changes);
        for (index, spec) in specs.iter().enumerate() {
            if let Source::One(from) = &spec.from {
                let new = || Candidate::new(from.clone(), spec.to.clone(), None);
                self.candidates.entry((index, from.name.clone())).or_insert_with(new);
            }
        }
        for route in routes {
            let key = route.key();
            if !self.written.contains_key(&key) {
                let (id, counters) = self.begins(&key);
                self.written.insert(key, (id, route.clone()));
                changes.push(Change::Start { id, route, counters });
            }
        }
        news::lower(&mut changes);
        // The next look is a thorough one, and others follow soon.
        (self.stirred_at, self.scanned_at, self.came_at) = (None, None, None);
        changes
    }

    /// Keeps the candidates of the patterns `before` that those of now mean as well; their routes go on
    /// where they would be made the same.
    fn adopt(&mut self, before: &[Pattern], now: Instant, changes: &mut Vec<Change>) {
        let candidates = std::mem::take(&mut self.candidates);
        let runs = |it: &(Key, Candidate)| matches!(it.1.state, State::Runs(_));
        // Those that run first: they keep their place where there is not room for all.
        let (running, others): (Vec<_>, Vec<_>) = candidates.into_iter().partition(runs);
        for ((index, name), mut candidate) in running.into_iter().chain(others) {
            let Some(old) = before.get(index) else { continue };
            let adopted = self.patterns.iter().position(|new| {
                let spec = &new.spec;
                spec.role() == old.spec.role()
                    && spec.source_middleware() == old.spec.source_middleware()
                    && spec.target(&name).is_some_and(|to| is_or_was_set_apart(&to, &candidate.to))
            });
            let adopted = adopted.filter(|new| {
                let key = (*new, name.clone());
                let spec = self.patterns.get(*new).map(|it| Arc::clone(&it.spec));
                spec.is_some_and(|spec| {
                    let by_hand =
                        spec.is_many() && self.is_by_hand(&spec, &candidate.from, &candidate.to);
                    let has_room = self.of_pattern(*new).count() < spec.max_routes;
                    !by_hand && has_room && !self.candidates.contains_key(&key)
                })
            });
            let new = adopted.and_then(|new| self.patterns.get_mut(new));
            let is_same = new.as_ref().is_some_and(|new| new.spec.makes_the_same(&old.spec));
            if let (State::Runs(id), false) = (&candidate.state, is_same) {
                let why = if new.is_some() { CHANGED } else { REMOVED };
                changes.push(stop(*id, why));
                let key = candidate.key(old.spec.role());
                candidate.state = State::New;
                self.was_ours(&key, now);
            }
            if !is_same {
                // What was wrong with the old settings is not wrong with the new.
                candidate.forget();
            }
            if let Some(new) = adopted {
                if is_same && let Some(pattern) = self.patterns.get_mut(new) {
                    pattern.made = pattern.made.max(old.made);
                    pattern.ended = pattern.ended.max(old.ended);
                }
                self.candidates.insert((new, name), candidate);
            }
        }
    }
}

/// Whether a source goes `to` now, or would if its name were not set apart from another by a line.
fn is_or_was_set_apart(to: &EndpointAddress, now: &EndpointAddress) -> bool {
    let alone = now.name.strip_suffix('_').unwrap_or(&now.name);
    to == now || (to.middleware == now.middleware && alone == to.name)
}
