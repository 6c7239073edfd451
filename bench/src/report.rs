//! Promises, how sure a figure is, and the part of `RESULTS.md` that a run writes.

use std::fmt::{self, Write as _};
use std::fs;
use std::path::Path;

use anyhow::{Context as _, Result};
use chrono::{DateTime, Utc};
use serde::{Deserialize, Serialize};

use crate::proc;

/// Lines of `RESULTS.md` and of the README between which a run writes.
const BEGIN: &str = "<!-- make bench writes from here -->";
const END: &str = "<!-- to here -->";

/// Bound that was promised for a figure.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) enum Limit {
    AtMost(f64),
    AtLeast(f64),
    /// No promise: the figure explains the row above it.
    Shown,
}

impl fmt::Display for Limit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::AtMost(limit) => write!(f, "at most {limit}"),
            Self::AtLeast(limit) => write!(f, "at least {limit}"),
            Self::Shown => Ok(()),
        }
    }
}

/// A figure beside its limit.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Target {
    what: String,
    limit: Limit,
    value: f64,
    /// Bounds that hold the figure with a probability of 95 %; `None` where there are too few rounds.
    interval: Option<(f64, f64)>,
    /// Parts of the figure, in words.
    parts: String,
}

impl Target {
    /// A figure measured in each round: its median counts.
    pub(crate) fn of(
        what: impl Into<String>,
        limit: Limit,
        rounds: &[f64],
        parts: impl Into<String>,
    ) -> Self {
        let value = quantile(rounds, 0.5);
        Self { what: what.into(), limit, value, interval: interval(rounds), parts: parts.into() }
    }

    /// A figure whose bounds the caller knows.
    pub(crate) fn between(
        what: impl Into<String>,
        limit: Limit,
        value: f64,
        interval: (f64, f64),
        parts: impl Into<String>,
    ) -> Self {
        Self { what: what.into(), limit, value, interval: Some(interval), parts: parts.into() }
    }

    /// A figure of the whole run, or a count.
    pub(crate) fn once(
        what: impl Into<String>,
        limit: Limit,
        value: f64,
        parts: impl Into<String>,
    ) -> Self {
        Self::between(what, limit, value, (value, value), parts)
    }

    /// The figure alone, with its interval.
    pub(crate) fn figure(&self) -> String {
        match self.interval {
            Some((low, high)) if low < high => {
                format!("{:.2} ({low:.2} to {high:.2})", self.value)
            }
            _ => format!("{:.2}", self.value),
        }
    }

    /// Met or missed where all of the interval is on one side of the limit.
    fn verdict(&self) -> &'static str {
        let sides = |(low, high): (f64, f64)| match self.limit {
            Limit::AtMost(limit) => Some((high <= limit, low > limit)),
            Limit::AtLeast(limit) => Some((low >= limit, high < limit)),
            Limit::Shown => None,
        };
        match (self.limit, self.interval.and_then(sides)) {
            (Limit::Shown, _) => "",
            (_, Some((true, _))) => "met",
            (_, Some((_, true))) => "**missed**",
            _ => "**undecided**",
        }
    }
}

/// Interval of 95 % of the median of the figure of all possible rounds: it lies between the `k`-th lowest and the
/// `k`-th highest of `n` rounds with a probability of `1 - 2 P(B < k)`, where `B` counts heads of `n` coins. Nothing
/// is assumed of how the rounds are spread. `None` for fewer than six.
fn interval(rounds: &[f64]) -> Option<(f64, f64)> {
    let mut sorted = rounds.to_vec();
    sorted.sort_by(f64::total_cmp);
    let (n, mut k) = (sorted.len(), 0);
    // P(B = k), and P(B < k + 1).
    let mut exactly = 0.5_f64.powi(i32::try_from(n).ok()?);
    let mut below = exactly;
    while below <= 0.025 {
        k += 1;
        let ratio = (n - k + 1) as f64 / k as f64;
        exactly *= ratio;
        below += exactly;
    }
    Some((*sorted.get(k.checked_sub(1)?)?, *sorted.get(n - k)?))
}

/// Value below which `fraction` of `values` lie, by the nearest rank; NaN where there is none.
pub(crate) fn quantile(values: &[f64], fraction: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let rank = (sorted.len() as f64 * fraction).ceil() as usize;
    sorted.get(rank.saturating_sub(1)).copied().unwrap_or(f64::NAN)
}

/// Targets as a table.
pub(crate) fn table(targets: &[Target]) -> String {
    let mut text = String::from(
        "| target | promised | found | 95 % interval | |\n| --- | --- | --- | --- | --- |\n",
    );
    for target in targets {
        let Target { what, limit, value, interval, parts } = target;
        let interval = match interval {
            Some((low, high)) if low < high => format!("{low:.2} to {high:.2}"),
            _ => String::new(),
        };
        let verdict = target.verdict();
        _ = writeln!(text, "| {what} | {limit} | {value:.2}: {parts} | {interval} | {verdict} |");
    }
    text
}

/// Targets that a user of the bridge asks for first, as a list.
pub(crate) fn shown(targets: &[Target]) -> String {
    let is_shown = |it: &&Target| {
        ["bridge ", "1080p"].iter().any(|begin| it.what.starts_with(begin))
            || it.what.ends_with("at rest: percent of a core")
    };
    let line = |it: &Target| format!("* {}: {}, {}\n", it.what, it.figure(), it.parts.trim());
    targets.iter().filter(is_shown).map(line).collect()
}

/// Machine of the run, in one line.
pub(crate) fn machine() -> String {
    let field = |path: &str, name: &str| {
        let text = fs::read_to_string(path).unwrap_or_default();
        let found =
            text.lines().find_map(|line| line.split_once(':').filter(|it| it.0.trim() == name));
        found.map_or_else(String::new, |(_, value)| value.trim().to_owned())
    };
    let date = DateTime::<Utc>::from(std::time::SystemTime::now()).format("%Y-%m-%d %H:%M UTC");
    let cores = std::thread::available_parallelism().map_or(0, usize::from);
    let (major, minor, patch) = zmq::version();
    format!(
        "{date}; {cores} cores, {}; {} of memory; Linux {}; libzmq {major}.{minor}.{patch}",
        field("/proc/cpuinfo", "model name"),
        field("/proc/meminfo", "MemTotal"),
        fs::read_to_string("/proc/sys/kernel/osrelease").unwrap_or_default().trim()
    )
}

/// Head of the report: machine and rounds of the run, and its targets.
pub(crate) fn head(rounds: u32, loads: &[f64], targets: &[Target]) -> String {
    let (least, most) = (quantile(loads, 0.0), quantile(loads, 1.0));
    format!(
        "{}. {rounds} rounds; load average at their starts, this run's own included: {least:.1} to {most:.1}, now {:.1}.\n\n{}",
        machine(),
        proc::load(),
        table(targets)
    )
}

/// Puts `text` between the two marks of the file; what stands around them stays.
pub(crate) fn put(file: &Path, text: &str) -> Result<()> {
    let before =
        fs::read_to_string(file).unwrap_or_else(|_| format!("# Results\n\n{BEGIN}\n{END}\n"));
    let marks = before.split_once(BEGIN).zip(before.split_once(END));
    let ((head, _), (_, tail)) =
        marks.with_context(|| format!("{} lacks the line {BEGIN} or {END}", file.display()))?;
    Ok(fs::write(file, format!("{head}{BEGIN}\n\n{}\n\n{END}{tail}", text.trim()))?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranks() {
        let values: Vec<f64> = (1..=100).map(f64::from).collect();
        assert_eq!([0.0, 0.5, 0.99, 1.0].map(|at| quantile(&values, at)), [1.0, 50.0, 99.0, 100.0]);
        assert!(quantile(&[], 0.5).is_nan());
    }

    /// Ranks as tables of the sign test have them.
    #[test]
    fn an_interval_needs_six_rounds_and_leaves_out_what_is_far_from_the_median() {
        let of = |n: u32| interval(&(1..=n).rev().map(f64::from).collect::<Vec<_>>());
        assert_eq!(of(5), None);
        assert_eq!(of(6), Some((1.0, 6.0)));
        assert_eq!(of(9), Some((2.0, 8.0)));
        assert_eq!(of(17), Some((5.0, 13.0)));
    }

    #[test]
    fn the_interval_decides() {
        let verdict = |limit, rounds: &[f64]| Target::of("", limit, rounds, "").verdict();
        let rounds = [1.0, 1.1, 1.2, 1.1, 1.0, 1.1];
        assert_eq!(verdict(Limit::AtMost(1.2), &rounds), "met");
        assert_eq!(verdict(Limit::AtMost(1.1), &rounds), "**undecided**");
        assert_eq!(verdict(Limit::AtMost(0.9), &rounds), "**missed**");
        assert_eq!(verdict(Limit::AtLeast(1.0), &rounds), "met");
        assert_eq!(verdict(Limit::AtLeast(1.0), &rounds[..5]), "**undecided**");
        assert_eq!(Target::once("", Limit::AtMost(2.0), 2.0, "").verdict(), "met");
        assert_eq!(Target::once("", Limit::AtMost(2.0), f64::NAN, "").verdict(), "**undecided**");
    }

    #[test]
    fn what_stands_around_a_run_stays() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("RESULTS.md");
        put(&file, "one").unwrap();
        let text = fs::read_to_string(&file).unwrap();
        fs::write(&file, format!("{text}\nbelow\n")).unwrap();
        put(&file, "two").unwrap();
        let text = fs::read_to_string(&file).unwrap();
        assert!(text.starts_with("# Results\n") && text.ends_with("\nbelow\n"), "{text}");
        assert!(text.contains("\ntwo\n") && !text.contains("one"), "{text}");
        fs::write(&file, "no marks").unwrap();
        assert!(put(&file, "two").is_err());
    }
}
