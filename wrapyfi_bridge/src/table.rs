//! Route status for people and for programs.

use std::fmt::Write as _;
use std::time::Duration;

use serde_json::{Value, json};
use wrapyfi_core::engine::RouteStatus;

/// Routes as a table, with rates over the time since `before` was taken.
///
/// ```text
/// route        state        in    out     Hz   MB/s p50 ms p99 ms  dropped
/// left camera  active      150    150   30.0  27.65   0.22   0.58  -
/// ```
#[must_use]
pub fn table(before: &[RouteStatus], now: &[RouteStatus], elapsed: Duration) -> String {
    let width = now.iter().map(|route| route.name.chars().count()).max().unwrap_or(0).max(5);
    let mut out = format!(
        "{:width$}  {:<8} {:>6} {:>6} {:>6} {:>6} {:>6} {:>6}  dropped\n",
        "route", "state", "in", "out", "Hz", "MB/s", "p50 ms", "p99 ms"
    );
    for (index, route) in now.iter().enumerate() {
        let counters = &route.counters;
        let (sent, bytes) =
            before.get(index).map_or((0, 0), |then| (then.counters.sent, then.counters.sent_bytes));
        let seconds = elapsed.as_secs_f64().max(1e-9);
        let rate = counters.sent.saturating_sub(sent) as f64 / seconds;
        let megabytes = counters.sent_bytes.saturating_sub(bytes) as f64 / seconds / 1e6;
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
            "{:width$}  {:<8} {:>6} {:>6} {rate:>6.1} {megabytes:>6.2} {:>6.2} {:>6.2}  {drops}",
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
    }
    out
}

/// Routes as one JSON object: `{"routes": [...]}`.
#[must_use]
pub fn json(now: &[RouteStatus]) -> Value {
    json!({ "routes": now })
}
