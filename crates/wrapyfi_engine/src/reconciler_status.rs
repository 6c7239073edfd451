//! Statuses of a plan's patterns, and of the names they match that have no route yet.

use super::candidate::{Candidate, State};
use super::pattern::Pattern;
use super::reconciler::Reconciler;
use super::route_status::{PatternCounts, RouteState, RouteStatus};

/// Words between the limit of a pattern and the number of names beyond it.
pub const OVER_LIMIT: &str = " is the limit of routes (max_routes), ";

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
                let State::Waits(state) = &candidate.state else { continue };
                let ends = (spec.kind, &candidate.from, &candidate.to);
                let name = candidate.name(spec.role());
                all.push(RouteStatus::idle(&name, ends, "unknown", state.clone()));
            }
        }
        all
    }

    fn pattern_status(&self, index: usize, pattern: &Pattern) -> RouteStatus {
        let spec = &pattern.spec;
        let of_discovery: u64 = self.sides(spec).map(|side| side.panics).sum();
        let runs = |candidate: &&Candidate| matches!(candidate.state, State::Runs(_));
        let routes = self.of_pattern(index).filter(runs).count();
        let waiting = self.of_pattern(index).count() - routes;
        let panicked =
            |panic: &String| RouteState::Error(format!("a look at what exists panicked: {panic}"));
        let fault = self.fault.as_ref().map(panicked);
        let state = fault.or_else(|| self.away(spec)).unwrap_or_else(|| {
            match (pattern.over, routes + waiting) {
                (0, 0) => RouteState::Waiting("a name that matches".to_owned()),
                (0, _) => RouteState::Active,
                (over, _) => RouteState::Degraded(format!(
                    "{}{OVER_LIMIT}{over} more names match",
                    spec.max_routes()
                )),
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
