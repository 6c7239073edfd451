//! What the patterns of a plan say of themselves, and of what they mean that is no route yet.

use super::candidate::State;
use super::plan_pattern::{Carried, Source};
use super::reconciler::{Pattern, Reconciler};
use super::route::{PatternCounts, RouteState, RouteStatus};
use crate::endpoint::{CountersSnapshot, EndpointAddress};

impl Reconciler {
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
        let sides = [spec.source_middleware(), &spec.to.middleware].map(|it| self.graph.get(it));
        let of_discovery: u64 = sides.into_iter().flatten().map(|side| side.panics).sum();
        let (mut routes, mut waiting) = (0, 0);
        for candidate in self.of_pattern(index) {
            match candidate.state {
                State::Runs(_) => routes += 1,
                State::New | State::Waits(_) => waiting += 1,
            }
        }
        let panicked =
            |panic: &String| RouteState::Error(format!("a look at what exists panicked: {panic}"));
        let fault = self.fault.as_ref().map(panicked);
        let state = fault.or_else(|| self.away(spec)).unwrap_or_else(|| {
            match (pattern.over, routes + waiting) {
                (0, 0) => RouteState::Waiting("a name that matches".to_owned()),
                (0, _) => RouteState::Active,
                (over, _) => RouteState::Degraded(format!(
                    "{} routes are the limit (max_routes), {over} more names match",
                    spec.max_routes
                )),
            }
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
            panics: pattern.panics + self.panics + of_discovery,
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
        panics: 0,
        pattern: None,
    }
}
