//! Routes of a bridge from its replies, in the order and with the filter that the user chose.

use std::cmp::Reverse;
use std::collections::{BTreeMap, VecDeque};
use std::fmt::Write as _;

use clap::ValueEnum;
use wrapyfi_interfaces::named;
use wrapyfi_interfaces::wrapyfi_msgs::msg::RouteInfo;

use crate::columns::aligned;
use crate::visible::escaped;

/// Number of rates that are kept of each route: two minutes of a reply a second.
const HISTORY: usize = 120;

named! {
    /// Column by which routes are sorted, the largest first but for names.
    #[derive(Default, ValueEnum)]
    pub enum Sort {
        /// Name of the route.
        #[default]
        Name => "name",
        /// Messages a second.
        Rate => "rate",
        /// Bytes a second.
        Bytes => "bytes",
        /// Time from arrival to hand-over of 99 in 100 messages.
        Latency => "latency",
        /// Messages that wait.
        Queued => "queued",
        /// Messages that were dropped.
        Dropped => "dropped",
        /// State, those with an error first.
        State => "state",
    }
    /// Name of the column.
    pub fn word;
}

impl Sort {
    /// The column after this one, in the order of the table.
    #[must_use]
    pub fn next(self) -> Self {
        let place = Self::ALL.iter().position(|one| *one == self).unwrap_or(0);
        Self::ALL.get(place + 1).copied().unwrap_or_default()
    }
}

/// Last reply about a route, and its rates in the replies before.
#[derive(Debug, Default)]
pub struct Row {
    /// State and counters.
    pub info: RouteInfo,
    /// Messages a second of each reply so far, the oldest first.
    pub history: VecDeque<u64>,
}

impl Row {
    /// Cells of the table, in the order of [`COLUMNS`].
    pub fn cells(&self) -> [String; COLUMNS.len()] {
        let ms = |us: u64| format!("{:.2}", us as f64 / 1e3);
        [
            self.info.key.clone(),
            self.info.kind.clone(),
            self.info.state.clone(),
            format!("{:.1}", self.info.messages_per_s),
            format!("{:.2}", self.info.bytes_per_s as f64 / 1e6),
            ms(self.info.latency_p50_us),
            ms(self.info.latency_p99_us),
            self.info.queued.to_string(),
            self.info.dropped.to_string(),
        ]
    }

    /// Reasons for which messages were dropped, with their numbers.
    pub fn drops(&self) -> String {
        counted(&self.info.drop_reasons, &self.info.drop_counts)
    }

    /// Events of an action's goals, with their numbers.
    pub fn goals(&self) -> String {
        counted(&self.info.goal_events, &self.info.goal_counts)
    }

    /// Programs that were refused, the last first, and the lines that would let them in.
    pub fn refused(&self) -> String {
        let RouteInfo { refused, allow, .. } = &self.info;
        if refused.is_empty() { String::new() } else { format!("{refused}; to let it in: {allow}") }
    }

    fn severity(&self) -> u8 {
        match self.info.state.as_str() {
            "error" => 3,
            "degraded" => 2,
            "waiting" => 1,
            _ => 0,
        }
    }
}

fn counted(words: &[String], counts: &[u64]) -> String {
    let pairs = words.iter().zip(counts).map(|(word, count)| format!("{word} {count}"));
    pairs.collect::<Vec<_>>().join(", ")
}

/// Headings of the table.
pub const COLUMNS: [&str; 9] =
    ["route", "kind", "state", "msg/s", "MB/s", "p50 ms", "p99 ms", "queued", "dropped"];

/// Number of columns of text, at the left; the others are numbers.
pub const TEXTS: usize = 3;

/// Routes of one bridge.
#[derive(Debug, Default)]
pub struct Routes {
    /// By name and kind.
    rows: BTreeMap<(String, String), Row>,
    /// Column by which they are sorted.
    pub sort: Sort,
    /// Text that names, kinds, ends or types of the shown routes contain, whatever their case.
    pub filter: String,
}

impl Routes {
    /// No routes yet.
    pub fn new(sort: Sort, filter: String) -> Self {
        Self { sort, filter, ..Self::default() }
    }

    /// Takes a reply.
    pub fn update(&mut self, routes: Vec<RouteInfo>) {
        let mut rows = BTreeMap::new();
        for mut info in routes {
            for text in [
                &mut info.key,
                &mut info.kind,
                &mut info.source,
                &mut info.destination,
                &mut info.type_name,
                &mut info.state,
                &mut info.reason,
                &mut info.cause,
                &mut info.cause_subject,
                &mut info.cause_theirs,
                &mut info.cause_ours,
                &mut info.refused,
                &mut info.allow,
            ] {
                *text = escaped(text).into_owned();
            }
            let key = (info.key.clone(), info.kind.clone());
            let before = self.rows.remove(&key);
            let mut history = before.map(|before| before.history).unwrap_or_default();
            if history.len() == HISTORY {
                history.pop_front();
            }
            history.push_back(info.messages_per_s.round() as u64);
            rows.insert(key, Row { info, history });
        }
        self.rows = rows;
    }

    /// Routes that pass the filter, sorted.
    pub fn visible(&self) -> Vec<&Row> {
        let wanted = self.filter.to_lowercase();
        let has = |text: &String| text.to_lowercase().contains(&wanted);
        let mut rows: Vec<_> = self.rows.values().collect();
        rows.retain(|Row { info, .. }| {
            [&info.key, &info.kind, &info.source, &info.destination, &info.type_name]
                .into_iter()
                .any(has)
        });
        match self.sort {
            // As the map has them.
            Sort::Name => {}
            Sort::Rate => {
                rows.sort_by(|a, b| b.info.messages_per_s.total_cmp(&a.info.messages_per_s));
            }
            Sort::Bytes => rows.sort_by_key(|row| Reverse(row.info.bytes_per_s)),
            Sort::Latency => rows.sort_by_key(|row| Reverse(row.info.latency_p99_us)),
            Sort::Queued => rows.sort_by_key(|row| Reverse(row.info.queued)),
            Sort::Dropped => rows.sort_by_key(|row| Reverse(row.info.dropped)),
            Sort::State => rows.sort_by_key(|row| Reverse(row.severity())),
        }
        rows
    }

    /// Number of routes in each state, of all whatever the filter.
    pub fn summary(&self) -> String {
        let mut states: BTreeMap<&str, usize> = BTreeMap::new();
        for row in self.rows.values() {
            *states.entry(&row.info.state).or_default() += 1;
        }
        let mut text = format!("{} routes", self.rows.len());
        for (state, count) in states {
            // Writing to a String cannot fail.
            let _infallible = write!(text, ", {count} {state}");
        }
        text
    }

    /// The shown routes as a table of text, reasons, drops and refusals below their routes.
    pub fn table(&self) -> String {
        let rows = self.visible();
        if self.rows.is_empty() {
            return "no routes: the file has none, or the bridge is not configured yet (ros2 lifecycle get NODE)".to_owned();
        }
        let cells = std::iter::once(COLUMNS.map(str::to_owned));
        let cells: Vec<_> = cells.chain(rows.iter().map(|row| row.cells())).collect();
        let mut lines = aligned(&cells, TEXTS).into_iter();
        let mut text = lines.next().unwrap_or_default();
        for (row, line) in rows.into_iter().zip(lines) {
            let _infallible = write!(text, "\n{line}");
            for note in [row.info.reason.clone(), row.goals(), row.drops(), row.refused()] {
                if !note.is_empty() {
                    let _infallible = write!(text, "\n    {note}");
                }
            }
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn info(key: &str, state: &str, messages_per_s: u64) -> RouteInfo {
        RouteInfo {
            key: key.to_owned(),
            source: format!("ros2:/{key}"),
            destination: format!("zeromq:/{key}"),
            kind: "topic".to_owned(),
            state: state.to_owned(),
            messages_per_s: messages_per_s as f64,
            bytes_per_s: messages_per_s * 1000,
            ..RouteInfo::default()
        }
    }

    fn names(routes: &Routes) -> Vec<&str> {
        routes.visible().into_iter().map(|row| row.info.key.as_str()).collect()
    }

    #[test]
    fn the_last_rates_are_kept_while_the_route_is_there() {
        let mut routes = Routes::default();
        for rate in 0..=HISTORY as u64 + 5 {
            routes.update(vec![info("a", "active", rate)]);
        }
        assert_eq!(routes.visible()[0].history.len(), HISTORY);
        assert_eq!(routes.visible()[0].history.back(), Some(&(HISTORY as u64 + 5)));
        routes.update(Vec::new());
        assert!(routes.visible().is_empty());
    }

    #[test]
    fn the_order_and_the_filter_are_the_users() {
        let mut routes = Routes::default();
        let reply = [("a", "active", 10), ("b", "error", 5), ("c", "waiting", 20)];
        routes.update(reply.map(|(key, state, rate)| info(key, state, rate)).into());
        assert_eq!(names(&routes), ["a", "b", "c"]);
        routes.sort = Sort::Rate;
        assert_eq!(names(&routes), ["c", "a", "b"]);
        routes.sort = Sort::State;
        assert_eq!(names(&routes), ["b", "c", "a"]);
        routes.filter = "ZEROMQ:/C".to_owned();
        assert_eq!(names(&routes), ["c"]);
        assert_eq!(routes.summary(), "3 routes, 1 active, 1 error, 1 waiting");
        let round = Sort::value_variants().iter().fold(Sort::Name, |sort, _| sort.next());
        assert_eq!(round, Sort::Name);
    }

    #[test]
    fn a_table_says_states_reasons_and_drops() {
        let mut routes = Routes::default();
        let waits = RouteInfo { reason: "a publisher".to_owned(), ..info("b", "waiting", 0) };
        let loses = RouteInfo {
            kind: "action".to_owned(),
            dropped: 5,
            drop_reasons: vec!["queue_full".to_owned(), "stalled".to_owned()],
            drop_counts: vec![2, 3],
            latency_p50_us: 120,
            latency_p99_us: 2500,
            ..info("left camera", "degraded", 7)
        };
        routes.update(vec![waits, loses]);
        let wanted = "\
route        kind    state     msg/s  MB/s  p50 ms  p99 ms  queued  dropped
b            topic   waiting     0.0  0.00    0.00    0.00       0        0
    a publisher
left camera  action  degraded    7.0  0.01    0.12    2.50       0        5
    queue_full 2, stalled 3";
        assert_eq!(routes.table(), wanted);
        routes.filter = "action".to_owned();
        assert_eq!(names(&routes), ["left camera"]);
    }

    #[test]
    fn a_name_cannot_command_the_terminal() {
        let mut routes = Routes::default();
        routes.update(vec![info("a\x1b[2J\nb", "active", 0)]);
        assert!(!routes.table().contains('\x1b'), "{:?}", routes.table());
        assert_eq!(routes.table().lines().count(), 2);
    }
}
