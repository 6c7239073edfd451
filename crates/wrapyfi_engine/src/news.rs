//! Log lines for routes that patterns make and end: one for each route where they are few, one for
//! all where they are many.
//!
//! ```text
//!   1 to 3 within a second   route made for yarp:/cam: sensor_msgs/msg/Image
//!   more                     185 routes made: 12 of sensor_msgs/msg/Image, …    each at level debug
//! ```

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use super::reconciler::Change;
use super::route::Route;
use wrapyfi_endpoint::EndpointAddress;

/// Time that one log line covers.
const SPAN: Duration = Duration::from_secs(1);
/// Largest number of routes that get a line of their own in such a time.
const FEW: usize = 3;
/// Largest number of types that a summary names.
const MAX_TYPES: usize = 6;

/// Routes that a pattern has made, and that were not logged yet.
#[derive(Debug, Default)]
pub(super) struct News {
    since: Option<Instant>,
    /// Name of each route, and its log line.
    made: Vec<(String, String)>,
    types: BTreeMap<&'static str, usize>,
    /// Name of each route that lacks what only a user can give, and its log line.
    lacking: Vec<(String, String)>,
}

impl News {
    /// Notes a route that was made.
    pub(super) fn add(
        &mut self,
        route: String,
        from: &EndpointAddress,
        label: &'static str,
        now: Instant,
    ) {
        // Logged at once for its time stamp; the line for users waits for others.
        tracing::trace!(route, "made");
        self.since.get_or_insert(now);
        self.made.push((route, format!("route made for {from}: {label}")));
        *self.types.entry(label).or_default() += 1;
    }

    /// Notes a route that cannot be made before a user does something.
    pub(super) fn add_waiting(&mut self, route: String, text: String, now: Instant) {
        self.since.get_or_insert(now);
        self.lacking.push((route, text));
    }

    /// Logs the routes that were made or cannot be, once [`SPAN`] has passed since the first.
    pub(super) fn tell(&mut self, pattern: &Route, now: Instant) {
        if self.since.is_none_or(|since| now.saturating_duration_since(since) < SPAN) {
            return;
        }
        let Self { made, types, lacking, .. } = std::mem::take(self);
        for (route, text) in lacking.iter().take(FEW) {
            tracing::warn!(route, "{text}");
        }
        if lacking.len() > FEW {
            let more = lacking.len() - FEW;
            tracing::warn!(route = pattern.name, "{more} more routes wait for something like this");
        }
        for (route, text) in &made {
            match made.len() {
                ..=FEW => tracing::info!(route, "{text}"),
                _ => tracing::debug!(route, "{text}"),
            }
        }
        if made.len() > FEW {
            tracing::info!(route = pattern.name, "{} routes made: {}", made.len(), summary(types));
        }
    }
}

/// Types with their numbers, the most frequent first.
fn summary(types: BTreeMap<&'static str, usize>) -> String {
    let mut types: Vec<_> = types.into_iter().collect();
    types.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    let more: usize = types.iter().skip(MAX_TYPES).map(|(_, count)| count).sum();
    let named = types.iter().take(MAX_TYPES).map(|(label, count)| format!("{count} of {label}"));
    let others = (more > 0).then(|| format!("{more} of other types"));
    named.chain(others).collect::<Vec<_>>().join(", ")
}

/// Lowers the log level of routes that end together, and logs their number.
pub(super) fn summarize_endings(changes: &mut [Change]) {
    let count = changes.iter().filter(|change| matches!(change, Change::Stop { .. })).count();
    if count <= FEW {
        return;
    }
    let mut first = None;
    for change in changes {
        if let Change::Stop { ending, .. } = change {
            ending.is_one_of_many = true;
            first.get_or_insert_with(|| ending.why.clone());
        }
    }
    tracing::info!("{count} routes ended, the first because {}", first.unwrap_or_default());
}

#[cfg(test)]
mod tests {
    use super::super::work::Ending;
    use super::*;

    #[test]
    fn a_summary_names_the_most_frequent_types() {
        let types =
            [("a", 1), ("b", 3), ("c", 2), ("d", 2), ("e", 2), ("f", 2), ("g", 1), ("h", 1)];
        let text = summary(types.into());
        assert_eq!(text, "3 of b, 2 of c, 2 of d, 2 of e, 2 of f, 1 of a, 2 of other types");
    }

    #[test]
    fn routes_that_end_together_are_quiet() {
        let end = |id| {
            let ending = Ending { why: "gone".into(), is_one_of_many: false };
            Change::Stop { id, ending }
        };
        let quiet = |changes: &[Change]| {
            changes
                .iter()
                .all(|it| matches!(it, Change::Stop { ending, .. } if ending.is_one_of_many))
        };
        let mut few: Vec<_> = (0..3).map(end).collect();
        summarize_endings(&mut few);
        assert!(!quiet(&few));
        let mut many: Vec<_> = (0..4).map(end).collect();
        summarize_endings(&mut many);
        assert!(quiet(&many));
    }
}
