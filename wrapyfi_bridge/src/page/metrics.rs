//! Statuses in the text format of Prometheus.

use std::collections::BTreeMap;
use std::fmt::{Display, Write as _};

use wrapyfi_endpoint::Cause;
use wrapyfi_engine::RouteStatus;

use crate::visible::escaped;

/// States of a route, each with a line of its own.
const STATES: [&str; 4] = ["active", "waiting", "degraded", "error"];

/// A counter of a route: its name, its help, its value.
type Counter = (&'static str, &'static str, fn(&RouteStatus) -> u64);

const COUNTERS: [Counter; 6] = [
    ("received_messages_total", "Number of messages that arrived.", |it| it.counters.received),
    ("received_bytes_total", "Number of bytes that arrived.", |it| it.counters.received_bytes),
    ("sent_messages_total", "Number of messages handed to the destination.", |it| it.counters.sent),
    ("sent_bytes_total", "Number of bytes handed to the destination.", |it| it.counters.sent_bytes),
    ("unread_objects_total", "Number of objects that were passed on as they came.", |it| {
        it.counters.unread
    }),
    ("panics_total", "Number of panics, each of which closed both ends for a while.", |it| {
        it.panics
    }),
];

/// The routes, and the middlewares, each with what it waits for.
pub(super) fn text(
    all: &[RouteStatus],
    middlewares: &BTreeMap<&'static str, Option<Cause>>,
    panics: u64,
) -> String {
    let mut out = Text::default();
    // A pattern carries nothing itself.
    let routes: Vec<_> = all.iter().filter(|route| route.pattern.is_none()).collect();
    out.family("wrapyfi_route_state", "gauge", "1 for the state that a route is in.");
    for route in &routes {
        for state in STATES {
            let is_in = u8::from(state == route.state.word());
            out.of_route(route, Some(("state", state)), is_in);
        }
    }
    out.family("wrapyfi_route_cause", "gauge", "1 for the cause for which a route is not active.");
    for route in &routes {
        if let Some(cause) = route.state.cause() {
            out.of_route(route, Some(("cause", cause.code().as_str())), 1);
        }
    }
    out.family("wrapyfi_route_info", "gauge", "Type that a route carries.");
    for route in &routes {
        out.of_route(route, Some(("type", route.message_type)), 1);
    }
    for (name, help, of) in COUNTERS {
        out.family(&format!("wrapyfi_route_{name}"), "counter", help);
        for route in &routes {
            out.of_route(route, None, of(route));
        }
    }
    out.family(
        "wrapyfi_route_dropped_messages_total",
        "counter",
        "Number of messages dropped, by reason.",
    );
    for route in &routes {
        for (reason, count) in &route.counters.drops {
            out.of_route(route, Some(("reason", reason.as_str())), count);
        }
    }
    out.family("wrapyfi_route_goals_total", "counter", "Number of events of an action's goals.");
    for route in &routes {
        for (event, count) in &route.counters.goals {
            out.of_route(route, Some(("event", event.as_str())), count);
        }
    }
    out.family(
        "wrapyfi_route_latency_seconds",
        "gauge",
        "Time from arrival to hand-over, by quantile.",
    );
    for route in routes.iter().filter(|route| route.counters.sent > 0) {
        let latency = route.counters.latency;
        for (quantile, us) in [("0.5", latency.p50_us), ("0.99", latency.p99_us)] {
            out.of_route(route, Some(("quantile", quantile)), us as f64 / 1e6);
        }
    }
    out.family("wrapyfi_middleware_up", "gauge", "1 where a middleware waits for nothing.");
    for (name, away) in middlewares {
        out.value(&[("middleware", name)], u8::from(away.is_none()));
    }
    out.family("wrapyfi_panics_total", "counter", "Number of panics of the process.");
    out.value(&[], panics);
    out.text
}

#[derive(Default)]
struct Text {
    text: String,
    name: String,
}

// Writing to a String cannot fail, so the results of `write!` are not looked at.
impl Text {
    /// Begins a family; values that follow are of it.
    fn family(&mut self, name: &str, kind: &str, help: &str) {
        let _infallible = write!(self.text, "# HELP {name} {help}\n# TYPE {name} {kind}\n");
        name.clone_into(&mut self.name);
    }

    fn of_route(&mut self, route: &RouteStatus, more: Option<(&str, &str)>, value: impl Display) {
        let own = [("route", route.name.as_str()), ("from", &route.from), ("to", &route.to)];
        let labels: Vec<_> = own.into_iter().chain(more).collect();
        self.value(&labels, value);
    }

    fn value(&mut self, labels: &[(&str, &str)], value: impl Display) {
        self.text.push_str(&self.name);
        for (at, (label, text)) in labels.iter().enumerate() {
            let begin = if at == 0 { '{' } else { ',' };
            let lines: Vec<_> = text.split('\n').map(escaped).collect();
            let text = lines.join("\n").replace('\\', "\\\\");
            let text = text.replace('"', "\\\"").replace('\n', "\\n");
            let _infallible = write!(self.text, "{begin}{label}=\"{text}\"");
        }
        let end = if labels.is_empty() { "" } else { "}" };
        let _infallible = writeln!(self.text, "{end} {value}");
    }
}

#[cfg(test)]
mod tests {
    use wrapyfi_endpoint::{CountersSnapshot, DropReason, Interaction};
    use wrapyfi_engine::RouteState;

    use super::*;

    #[test]
    fn a_route_has_its_numbers_and_its_name_stays_within_its_label() {
        let route = RouteStatus {
            name: "a\"} 1\nb\\\x1b\u{202e}".to_owned(),
            from: "ros2:/a".to_owned(),
            to: "zeromq:/a".to_owned(),
            interaction: Interaction::Topic,
            message_type: "Text",
            state: RouteState::Degraded(Cause::Transport("queue full".to_owned())),
            has_source: false,
            from_qos: None,
            to_qos: None,
            counters: CountersSnapshot {
                received: 9,
                sent: 4,
                drops: vec![(DropReason::QueueFull, 3)],
                ..CountersSnapshot::default()
            },
            messages_per_s: 0.0,
            bytes_per_s: 0,
            panics: 0,
            pattern: None,
        };
        let away = BTreeMap::from([("ros2", None), ("yarp", Some(Cause::NoName))]);
        let text = text(&[route], &away, 2);
        let own = r#"route="a\"} 1\nb\\\\u001b\\u202e",from="ros2:/a",to="zeromq:/a""#;
        for line in [
            format!("wrapyfi_route_state{{{own},state=\"degraded\"}} 1"),
            format!("wrapyfi_route_state{{{own},state=\"active\"}} 0"),
            format!("wrapyfi_route_received_messages_total{{{own}}} 9"),
            format!("wrapyfi_route_dropped_messages_total{{{own},reason=\"queue_full\"}} 3"),
            format!("wrapyfi_route_cause{{{own},cause=\"transport\"}} 1"),
            format!("wrapyfi_route_latency_seconds{{{own},quantile=\"0.99\"}} 0"),
            "wrapyfi_middleware_up{middleware=\"ros2\"} 1".to_owned(),
            "wrapyfi_middleware_up{middleware=\"yarp\"} 0".to_owned(),
            "wrapyfi_panics_total 2".to_owned(),
        ] {
            assert!(text.lines().any(|known| known == line), "{line}\n{text}");
        }
        let is_one = |line: &&str| line.starts_with('#') || line.starts_with("wrapyfi_");
        assert!(text.lines().all(|line| is_one(&line)), "{text}");
    }
}
