//! Statuses of a plan's patterns, and of the names they match that have no route yet.

use super::candidate::{Candidate, CandidateState};
use super::pattern::Pattern;
use super::reconciler::Reconciler;
use super::route_status::{PatternCounts, RouteState, RouteStatus};
use wrapyfi_endpoint::Cause;

impl Reconciler {
    /// Statuses of the patterns, and of the names that wait.
    pub(super) fn status(&self) -> Vec<RouteStatus> {
        let mut all = Vec::new();
        for (index, pattern) in self.patterns.iter().enumerate() {
            let spec = &pattern.spec;
            if spec.is_many() {
                all.push(self.pattern_status(index, pattern));
            }
            for candidate in self.of_pattern(index) {
                let CandidateState::Waits(state) = &candidate.state else { continue };
                let ends = (spec.interaction(), &candidate.from, &candidate.to);
                let name = candidate.name(spec.interaction());
                all.push(RouteStatus::idle(&name, ends, "unknown", state.clone()));
            }
        }
        all
    }

    fn pattern_status(&self, index: usize, pattern: &Pattern) -> RouteStatus {
        let spec = &pattern.spec;
        let of_discovery: u64 = self.sides(spec).map(|side| side.panics).sum();
        let runs = |candidate: &&Candidate| matches!(candidate.state, CandidateState::Runs(_));
        let routes = self.of_pattern(index).filter(runs).count();
        let waiting = self.of_pattern(index).count() - routes;
        let panicked = |panic: &String| {
            let (what, panic) = ("a look at what exists panicked".to_owned(), panic.clone());
            RouteState::Error(Cause::Panic { what, panic })
        };
        let fault = self.fault.as_ref().map(panicked);
        let state = fault.or_else(|| self.away(spec)).unwrap_or_else(|| {
            match (pattern.over, routes + waiting) {
                (0, 0) => RouteState::Waiting(Cause::NoName),
                (0, _) => RouteState::Active,
                (more, _) => {
                    let at = spec.from.to_string();
                    RouteState::Degraded(Cause::Limit { at, limit: spec.max_routes(), more })
                }
            }
        });
        RouteStatus {
            pattern: Some(PatternCounts {
                routes,
                waiting,
                over_limit: pattern.over,
                made: pattern.made,
                ended: pattern.ended,
            }),
            panics: pattern.panics + self.panics + of_discovery,
            ..RouteStatus::planned(spec, state)
        }
    }
}
