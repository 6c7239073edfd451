//! Statuses of routes and middlewares as `diagnostic_msgs/msg/DiagnosticArray`.
//!
//! | level | route | middleware |
//! | --- | --- | --- |
//! | OK | active | works |
//! | WARN | waiting, degraded | waits for its server |
//! | ERROR | error | |
//! | STALE | active, and nothing has come for [`STALE_AFTER`], though something did before | |

use std::collections::{BTreeMap, BTreeSet};
use std::time::{Duration, Instant};

use wrapyfi_data::types::Stamp;
use wrapyfi_endpoint::Cause;
use wrapyfi_engine::{RouteState, RouteStatus};
use wrapyfi_interfaces::builtin_interfaces::msg::Time;
use wrapyfi_interfaces::diagnostic_msgs::msg::{DiagnosticArray, DiagnosticStatus, KeyValue};
use wrapyfi_interfaces::std_msgs::msg::Header;

/// Time without a message after which a route that has carried some counts as stale.
pub const STALE_AFTER: Duration = Duration::from_secs(5);

/// Maker of the diagnostics of one bridge, which remembers when each route last carried something.
#[derive(Debug)]
pub struct Diagnostics {
    node: String,
    /// Number of messages that a route had received, and the instant at which that changed last.
    last: BTreeMap<String, (u64, Instant)>,
}

impl Diagnostics {
    /// Diagnostics of the bridge whose node has this full name.
    pub fn new(node: String) -> Self {
        Self { node, last: BTreeMap::new() }
    }

    /// Notes which routes have received something since the last look.
    pub fn note(&mut self, routes: &[RouteStatus], at: Instant) {
        for route in routes {
            let received = route.counters.received;
            match self.last.get_mut(&route.name) {
                Some(last) if last.0 == received => {}
                Some(last) => *last = (received, at),
                None => _ = self.last.insert(route.name.clone(), (received, at)),
            }
        }
        if self.last.len() > routes.len() {
            let names: BTreeSet<&str> = routes.iter().map(|route| route.name.as_str()).collect();
            self.last.retain(|name, _| names.contains(name.as_str()));
        }
    }

    /// Diagnostics of the routes, and of the middlewares with the reason that they wait for something.
    #[must_use]
    pub fn of(
        &mut self,
        routes: &[RouteStatus],
        middlewares: &BTreeMap<&'static str, Option<Cause>>,
        now: Stamp,
        at: Instant,
    ) -> DiagnosticArray {
        self.note(routes, at);
        let mut status: Vec<_> =
            middlewares.iter().map(|(name, away)| self.middleware(name, away.as_ref())).collect();
        for route in routes {
            status.push(self.route(route, at));
        }
        let stamp = Time { sec: now.sec, nanosec: now.nanosec };
        DiagnosticArray { header: Header { stamp, frame_id: String::new() }, status }
    }

    fn middleware(&self, name: &str, away: Option<&Cause>) -> DiagnosticStatus {
        let (level, message) = match away {
            None => (DiagnosticStatus::OK, "works".to_owned()),
            Some(what) => (DiagnosticStatus::WARN, format!("waits for {what}")),
        };
        let cause = away.map(|cause| ("cause", cause.code().to_string()));
        self.status(level, name, message, cause.into_iter().collect())
    }

    fn route(&self, route: &RouteStatus, at: Instant) -> DiagnosticStatus {
        let counters = &route.counters;
        let last = self.last.get(&route.name).map_or(at, |(_, last)| *last);
        let idle = at.saturating_duration_since(last);
        let is_stale = counters.received > 0 && idle >= STALE_AFTER;
        let (level, message) = match &route.state {
            RouteState::Active if is_stale => {
                (DiagnosticStatus::STALE, format!("no message for {} s", idle.as_secs()))
            }
            RouteState::Active => (DiagnosticStatus::OK, "active".to_owned()),
            RouteState::Waiting(_) | RouteState::Degraded(_) => {
                (DiagnosticStatus::WARN, route.state.to_string())
            }
            RouteState::Error(_) => (DiagnosticStatus::ERROR, route.state.to_string()),
        };
        let mut values = vec![
            ("from", route.from.clone()),
            ("to", route.to.clone()),
            ("type", route.message_type.to_owned()),
            ("received", counters.received.to_string()),
            ("sent", counters.sent.to_string()),
            ("sent_bytes", counters.sent_bytes.to_string()),
            ("dropped", counters.dropped().to_string()),
            ("latency_p50_us", counters.latency.p50_us.to_string()),
            ("latency_p99_us", counters.latency.p99_us.to_string()),
        ];
        values.extend(route.state.cause().map(|cause| ("cause", cause.code().to_string())));
        values.extend(
            counters.drops.iter().map(|(reason, count)| (reason.as_str(), count.to_string())),
        );
        values.extend(
            counters.goals.iter().map(|(event, count)| (event.as_str(), count.to_string())),
        );
        values.extend(counters.refused.iter().map(|it| ("refused", it.who.clone())));
        self.status(level, &route.name, message, values)
    }

    fn status(
        &self,
        level: u8,
        name: &str,
        message: String,
        values: Vec<(&str, String)>,
    ) -> DiagnosticStatus {
        let pair = |(key, value): (&str, String)| KeyValue { key: key.to_owned(), value };
        DiagnosticStatus {
            level,
            // As diagnostic_updater writes it: aggregators group by it.
            name: format!("{}: {name}", self.node.trim_start_matches('/')),
            message,
            hardware_id: String::new(),
            values: values.into_iter().map(pair).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use wrapyfi_endpoint::{CountersSnapshot, DropReason, Interaction, Named};

    use super::*;

    fn route(state: RouteState, received: u64) -> RouteStatus {
        let drops = vec![(DropReason::QueueFull, 2)];
        RouteStatus {
            name: "talk".to_owned(),
            from: "ros2:/a".to_owned(),
            to: "zeromq:/a".to_owned(),
            interaction: Interaction::Topic,
            message_type: "std_msgs/msg/String",
            state,
            has_source: false,
            from_qos: None,
            to_qos: None,
            counters: CountersSnapshot { received, drops, ..CountersSnapshot::default() },
            messages_per_s: 0.0,
            bytes_per_s: 0,
            panics: 0,
            pattern: None,
        }
    }

    #[test]
    fn each_state_has_its_level() {
        let mut diagnostics = Diagnostics::new("/lab/bridge".to_owned());
        let begin = Instant::now();
        let mut level = |state, received, after| {
            let all = [route(state, received)];
            let array = diagnostics.of(&all, &BTreeMap::new(), Stamp::default(), begin + after);
            array.status[0].level
        };
        let (zero, long) = (Duration::ZERO, STALE_AFTER);
        assert_eq!(level(RouteState::Active, 0, zero), DiagnosticStatus::OK);
        assert_eq!(level(RouteState::Active, 0, long), DiagnosticStatus::OK, "nothing came yet");
        assert_eq!(level(RouteState::Active, 5, long), DiagnosticStatus::OK);
        assert_eq!(level(RouteState::Active, 5, long * 2), DiagnosticStatus::STALE);
        assert_eq!(level(RouteState::Active, 6, long * 2), DiagnosticStatus::OK);
        let waiting = RouteState::Waiting(Cause::NoName);
        assert_eq!(level(waiting, 6, zero), DiagnosticStatus::WARN);
        assert_eq!(level(RouteState::Degraded(Cause::NoName), 6, zero), DiagnosticStatus::WARN);
        assert_eq!(level(RouteState::Error(Cause::NoName), 6, zero), DiagnosticStatus::ERROR);
    }

    #[test]
    fn names_and_values_are_what_aggregators_expect() {
        let mut diagnostics = Diagnostics::new("/lab/bridge".to_owned());
        let server = Named::server("the broker at", "tcp://127.0.0.1:5555");
        let broker = Cause::ServerAway { server, detail: String::new() };
        let away = BTreeMap::from([("zeromq", Some(broker)), ("yarp", None)]);
        let all = [route(RouteState::Active, 3)];
        let array = diagnostics.of(&all, &away, Stamp::default(), Instant::now());
        let names: Vec<_> = array.status.iter().map(|one| one.name.as_str()).collect();
        assert_eq!(names, ["lab/bridge: yarp", "lab/bridge: zeromq", "lab/bridge: talk"]);
        assert_eq!(array.status[1].level, DiagnosticStatus::WARN);
        assert!(array.status[1].message.contains("broker at tcp"), "{array:?}");
        assert_eq!(array.status[1].values[0].value, "server_away");
        let dropped = array.status[2].values.iter().find(|pair| pair.key == "queue_full").unwrap();
        assert_eq!(dropped.value, "2");
    }
}
