//! Route status for people and for programs.

use std::fmt::Write as _;

use serde::Serialize;
use wrapyfi_core::endpoint::QosEvent;
use wrapyfi_core::engine::{Rate, RouteStatus};

/// Routes as a table, with rates over the last second.
///
/// ```text
/// route        state        in    out     Hz   MB/s p50 ms p99 ms  dropped
/// left camera  active      150    150   30.0  27.65   0.22   0.58  -
///                quality of service: deadline_missed 3
/// ```
#[must_use]
pub fn table(now: &[RouteStatus]) -> String {
    let width = now.iter().map(|route| route.name.chars().count()).max().unwrap_or(0).max(5);
    let mut out = format!(
        "{:width$}  {:<8} {:>6} {:>6} {:>6} {:>6} {:>6} {:>6}  dropped\n",
        "route", "state", "in", "out", "Hz", "MB/s", "p50 ms", "p99 ms"
    );
    for route in now {
        let counters = &route.counters;
        let Rate { messages_per_s, bytes_per_s } = route.rate;
        let megabytes = bytes_per_s as f64 / 1e6;
        let drops = counters
            .drops
            .iter()
            .map(|(reason, count)| format!("{reason} {count}"))
            .collect::<Vec<_>>()
            .join(", ");
        let drops = if drops.is_empty() { "-" } else { &drops };
        // Writing to a String cannot fail.
        let _infallible = writeln!(
            out,
            "{:width$}  {:<8} {:>6} {:>6} {messages_per_s:>6.1} {megabytes:>6.2} {:>6.2} {:>6.2}  {drops}",
            route.name,
            route.state.word(),
            counters.received,
            counters.sent,
            counters.latency.p50_us as f64 / 1e3,
            counters.latency.p99_us as f64 / 1e3,
        );
        if let Some(reason) = route.state.reason() {
            let _infallible = writeln!(out, "{:width$}    {}", "", reason);
        }
        if let Some(events) = qos_events(route) {
            let _infallible = writeln!(out, "{:width$}    quality of service: {events}", "");
        }
    }
    out
}

/// Numbers of events of a route's quality of service, and the quality of service itself where it
/// was changed.
fn qos_events(route: &RouteStatus) -> Option<String> {
    let events = &route.counters.qos_events;
    let mut texts: Vec<_> =
        events.iter().map(|(event, count)| format!("{event} {count}")).collect();
    if route.counters.qos_events_of(QosEvent::Changed) > 0 {
        let ends = [("from", route.from_qos), ("to", route.to_qos)];
        texts.extend(ends.iter().filter_map(|(end, qos)| Some(format!("{end}: {}", (*qos)?))));
    }
    (!texts.is_empty()).then(|| texts.join(", "))
}

/// Routes as one JSON object, `{"routes": [...]}`, on a line; with `"panics"` where this process had some.
#[must_use]
pub fn json_line(routes: &[RouteStatus], panics: u64) -> Vec<u8> {
    #[derive(Serialize)]
    struct Line<'a> {
        routes: &'a [RouteStatus],
        #[serde(skip_serializing_if = "Option::is_none")]
        panics: Option<u64>,
    }
    let panics = (panics > 0).then_some(panics);
    // Names are text and counters are numbers: nothing in it can fail.
    let mut line = serde_json::to_vec(&Line { routes, panics }).unwrap_or_default();
    line.push(b'\n');
    line
}

#[cfg(test)]
mod tests {
    use wrapyfi_core::endpoint::{Qos, QosPreset};
    use wrapyfi_core::engine::RouteState;

    use super::*;

    fn route() -> RouteStatus {
        RouteStatus {
            name: "chatter".to_owned(),
            from: "ros2:/chatter".to_owned(),
            to: "zeromq:/chatter".to_owned(),
            kind: "topic",
            message_type: "std_msgs/msg/String",
            state: RouteState::Active,
            from_qos: Some(Qos::from(QosPreset::SensorData)),
            to_qos: None,
            counters: Default::default(),
            rate: Rate { messages_per_s: 30.0, bytes_per_s: 27_648_000 },
            panics: 0,
            pattern: None,
        }
    }

    #[test]
    fn panics_are_told_where_there_were_some() {
        let text = |panics| String::from_utf8(json_line(&[], panics)).unwrap();
        assert_eq!(text(0), "{\"routes\":[]}\n");
        assert_eq!(text(2), "{\"routes\":[],\"panics\":2}\n");
    }

    #[test]
    fn a_row_and_an_object_have_the_rates() {
        let route = route();
        let text = table(std::slice::from_ref(&route));
        assert!(text.contains("   30.0  27.65 "), "{text}");
        let line: serde_json::Value = serde_json::from_slice(&json_line(&[route], 0)).unwrap();
        let row = &line["routes"][0];
        let rates = (row["messages_per_s"].as_f64(), row["bytes_per_s"].as_u64());
        assert_eq!(rates, (Some(30.0), Some(27_648_000)));
    }

    #[test]
    fn quality_of_service_is_told_where_something_happened_to_it() {
        let mut route = route();
        let print = |route: &RouteStatus| table(std::slice::from_ref(route));
        assert!(!print(&route).contains("quality of service"), "{}", print(&route));
        route.counters.qos_events = vec![(QosEvent::DeadlineMissed, 3), (QosEvent::Changed, 1)];
        let words = "quality of service: deadline_missed 3, qos_changed 1, from: best_effort \
                     volatile keep_last(5)\n";
        assert!(print(&route).ends_with(words), "{}", print(&route));
    }
}
