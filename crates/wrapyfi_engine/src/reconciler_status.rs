//! Statuses of a plan's patterns, and of the names they match that have no route yet.

use super::candidate::State;
use super::reconciler::{Pattern, Reconciler};
use super::route::{Kind, Route};
use super::route_status::{PatternCounts, Rate, RouteState, RouteStatus};
use wrapyfi_endpoint::{CountersSnapshot, EndpointAddress};

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
                all.push(RouteStatus {
                    name: candidate.name(spec.role()),
                    message_type: "unknown",
                    ..idle(spec, &candidate.from, &candidate.to, state.clone())
                });
            }
        }
        all
    }

    fn pattern_status(&self, index: usize, pattern: &Pattern) -> RouteStatus {
        let spec = &pattern.spec;
        let sides = [&spec.from, &spec.to].map(|end| self.graph.get(&end.middleware));
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
                    spec.max_routes()
                )),
            }
        });
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
            ..idle(spec, &spec.from, &spec.to, state)
        }
    }
}

/// Status of a pattern or a name, which carries no messages itself.
fn idle(
    route: &Route,
    from: &EndpointAddress,
    to: &EndpointAddress,
    state: RouteState,
) -> RouteStatus {
    // A service shows its offered end first, as its route does.
    let (from, to) = match route.kind {
        Kind::Topic(_) => (from, to),
        Kind::Service(_) => (to, from),
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
        rate: Rate::default(),
        panics: 0,
        pattern: None,
    }
}
