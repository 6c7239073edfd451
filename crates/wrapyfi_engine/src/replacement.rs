//! Replacement of a plan: routes that are the same in both go on untouched.
//!
//! ```text
//!   before ─ a route of now makes it the same ─▶ goes on, under that route   ─ others ─▶ Change::Stop
//!   whole now, and not running ─▶ Change::Start
//! ```

use std::sync::Arc;
use std::time::Instant;

use super::candidate::{Candidate, CandidateState};
use super::news;
use super::pattern::Pattern;
use super::plan::Plan;
use super::reconciler::{Change, Key, Reconciler, stop};
use super::route::{Route, may_be_meant};
use wrapyfi_endpoint::{EndpointAddress, Registry};

/// Reason for a new plan to end a route.
const CHANGED: &str = "its settings have changed";
const RESTARTED: &str = "its middleware starts anew";
pub(super) const REMOVED: &str = "the configuration has it no more";
pub(super) const INACTIVE: &str = "the node was deactivated";

impl Reconciler {
    /// Replaces the plan, so that the routes of `plan` on the middlewares of `registry` are wanted,
    /// and no others. Routes that are the same go on; among the changes, ends come before starts. `removed` is the
    /// reason that is told of a route that the plan does not have.
    pub(super) fn replace(
        &mut self,
        plan: Plan,
        registry: Registry,
        removed: &str,
        now: Instant,
    ) -> Vec<Change> {
        let registry_before = std::mem::replace(&mut self.registry, registry);
        let mut changes = Vec::new();
        let patterns = plan.routes.into_iter().map(Pattern::new).collect();
        let before = std::mem::replace(&mut self.patterns, patterns);
        let specs: Vec<_> = self.patterns.iter().map(|it| Arc::clone(&it.spec)).collect();
        let single = specs.iter().enumerate().filter(|(_, spec)| !spec.is_many());
        self.explicit = single.map(|(index, spec)| (spec.key(), index)).collect();
        let found: Vec<_> = specs.iter().filter(|spec| !spec.is_whole()).cloned().collect();
        self.graph.follow(&self.registry, &found);
        self.adopt(&before, (&registry_before, removed), now, &mut changes);
        for (index, spec) in specs.iter().enumerate().filter(|(_, spec)| !spec.is_many()) {
            let key = (index, spec.from.name.clone());
            let known = self.candidates.remove(&key);
            let mut candidate =
                known.unwrap_or_else(|| Candidate::new(spec.from.clone(), spec.to.clone(), None));
            if spec.is_whole() && !matches!(candidate.state, CandidateState::Runs(_)) {
                changes.push(self.start(&mut candidate, Route::clone(spec)));
            }
            self.candidates.insert(key, candidate);
        }
        news::summarize_endings(&mut changes);
        // Forgets these times, so that the next look goes over all candidates and others follow
        // soon.
        (self.stirred_at, self.scanned_at, self.came_at) = (None, None, None);
        changes
    }

    /// Keeps the candidates of the patterns `before` that the new ones match as well; their routes
    /// go on where they would be made the same.
    fn adopt(
        &mut self,
        before: &[Pattern],
        (registry, removed): (&Registry, &str),
        now: Instant,
        changes: &mut Vec<Change>,
    ) {
        let candidates = std::mem::take(&mut self.candidates);
        let runs = |it: &(Key, Candidate)| matches!(it.1.state, CandidateState::Runs(_));
        // Candidates with routes come first, so that they keep them where there is not room for
        // all.
        let (running, others): (Vec<_>, Vec<_>) = candidates.into_iter().partition(runs);
        for ((index, name), mut candidate) in running.into_iter().chain(others) {
            let Some(old) = before.get(index) else { continue };
            let means = |new: &Pattern| {
                let spec = &new.spec;
                spec.is_many()
                    && spec.interaction() == old.spec.interaction()
                    && spec.from.middleware == old.spec.from.middleware
                    && spec.target(&name).is_some_and(|to| is_or_was_set_apart(&to, &candidate.to))
            };
            let written = self.explicit.get(&candidate.key(old.spec.interaction())).copied();
            let adopted = written.or_else(|| self.patterns.iter().position(means));
            let adopted = adopted.filter(|new| {
                let key = (*new, name.clone());
                let spec = self.patterns.get(*new).map(|it| Arc::clone(&it.spec));
                spec.is_some_and(|spec| {
                    let is_not_meant = spec.is_many()
                        && self.is_not_for_patterns(&spec, &candidate.from, &candidate.to);
                    let has_room = self.of_pattern(*new).count() < spec.max_routes();
                    !is_not_meant && has_room && !self.candidates.contains_key(&key)
                })
            });
            let ends = [&old.spec.from, &old.spec.to];
            let is_there = ends.iter().all(|end| self.registry.has_same(registry, &end.middleware));
            let new = adopted.and_then(|new| self.patterns.get_mut(new));
            let is_same =
                is_there && new.as_ref().is_some_and(|new| new.spec.makes_the_same(&old.spec));
            if let (CandidateState::Runs(id), false) = (&candidate.state, is_same) {
                let why = match new {
                    Some(_) if !is_there => RESTARTED,
                    Some(_) => CHANGED,
                    None => removed,
                };
                changes.push(stop(*id, why));
                let key = candidate.key(old.spec.interaction());
                candidate.state = CandidateState::New;
                self.was_ours(&key, now);
            }
            if !is_same {
                // A fault of the old settings need not be one of the new.
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

/// True when a source goes `to` now, or would if no `_` set its name apart from another one, and no program awaited it
/// under another.
fn is_or_was_set_apart(to: &EndpointAddress, now: &EndpointAddress) -> bool {
    let alone = now.name.strip_suffix('_').unwrap_or(&now.name);
    to == now || (to.middleware == now.middleware && alone == to.name) || may_be_meant(to, now)
}
