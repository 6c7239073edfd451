//! Promises, how sure a figure is, and what a run writes: parts of `RESULTS.md` and of the README, lines of `history.csv`.

use std::borrow::Cow;
use std::fmt::{self, Write as _};
use std::fs;
use std::io::Write as _;
use std::path::Path;
use std::process::Command;

use anyhow::{Context as _, Result};
use chrono::{DateTime, Utc};
use serde::{Deserialize, Serialize};

use crate::proc;

/// Lines of `RESULTS.md` and of the README between which a run writes.
const BEGIN: &str = "<!-- make bench writes from here -->";
const END: &str = "<!-- to here -->";

/// First line of `history.csv`.
const COLUMNS: &str =
    "date,commit_or_version,machine,area,what,unit,limit,found,low,high,verdict,conditions\n";

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
            Self::AtMost(limit) => write!(f, "at most {}", shortly(*limit)),
            Self::AtLeast(limit) => write!(f, "at least {}", shortly(*limit)),
            Self::Shown => Ok(()),
        }
    }
}

/// The number with at most two digits behind the point.
fn shortly(number: f64) -> f64 {
    (number * 100.0).round() / 100.0
}

/// Table that shows a figure; `history.csv` has every one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
enum Table {
    /// That of targets.
    Targets,
    /// That of targets, and the README: a user of the bridge asks for it first.
    Readme,
    /// One whose rows are no targets: of ways, of codecs.
    Other,
}

/// Name of a figure.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Row {
    area: Cow<'static, str>,
    what: Cow<'static, str>,
    /// Empty for counts.
    unit: Cow<'static, str>,
    table: Table,
}

impl Row {
    /// A row of the table of targets. The README lists the areas.
    pub(crate) fn new(
        area: &'static str,
        unit: &'static str,
        what: impl Into<Cow<'static, str>>,
    ) -> Self {
        Self { area: area.into(), what: what.into(), unit: unit.into(), table: Table::Targets }
    }

    /// The same, which the README shows as well.
    pub(crate) fn in_readme(self) -> Self {
        Self { table: Table::Readme, ..self }
    }

    /// The same, which another table shows.
    pub(crate) fn in_other_table(self) -> Self {
        Self { table: Table::Other, ..self }
    }
}

/// A figure beside its limit.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Target {
    row: Row,
    limit: Limit,
    value: f64,
    /// Bounds that hold the figure with a probability of 95 %; `None` where there are too few rounds.
    interval: Option<(f64, f64)>,
    /// Parts of the figure, in words.
    parts: String,
}

impl Target {
    /// A figure measured in each round: its median counts.
    pub(crate) fn of(row: Row, limit: Limit, rounds: &[f64], parts: impl Into<String>) -> Self {
        let value = quantile(rounds, 0.5);
        Self { row, limit, value, interval: interval(rounds), parts: parts.into() }
    }

    /// A figure whose bounds the caller knows.
    pub(crate) fn between(
        row: Row,
        limit: Limit,
        value: f64,
        interval: (f64, f64),
        parts: impl Into<String>,
    ) -> Self {
        Self { row, limit, value, interval: Some(interval), parts: parts.into() }
    }

    /// A figure of the whole run, or a count.
    pub(crate) fn once(row: Row, limit: Limit, value: f64, parts: impl Into<String>) -> Self {
        Self::between(row, limit, value, (value, value), parts)
    }

    /// The figure alone, with its interval.
    pub(crate) fn figure(&self) -> String {
        match self.bounds() {
            Some((low, high)) => format!("{:.2} ({low:.2} to {high:.2})", self.value),
            None => format!("{:.2}", self.value),
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
            (_, Some((_, true))) => "missed",
            _ => "undecided",
        }
    }

    /// Bounds that are not the figure itself.
    fn bounds(&self) -> Option<(f64, f64)> {
        self.interval.filter(|(low, high)| low < high)
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
    for target in targets.iter().filter(|it| it.row.table != Table::Other) {
        let Target { row: Row { what, .. }, limit, value, parts, .. } = target;
        let bounds = target.bounds();
        let interval =
            bounds.map_or_else(String::new, |(low, high)| format!("{low:.2} to {high:.2}"));
        let verdict = match target.verdict() {
            bad @ ("missed" | "undecided") => format!("**{bad}**"),
            good => good.to_owned(),
        };
        let found =
            if parts.is_empty() { format!("{value:.2}") } else { format!("{value:.2}: {parts}") };
        _ = writeln!(text, "| {what} | {limit} | {found} | {interval} | {verdict} |");
    }
    text
}

/// Targets that a user of the bridge asks for first, as a list.
pub(crate) fn shown(targets: &[Target]) -> String {
    let line = |it: &Target| format!("* {}: {}, {}\n", it.row.what, it.figure(), it.parts);
    targets.iter().filter(|it| it.row.table == Table::Readme).map(line).collect()
}

/// Place and time of a run.
pub(crate) struct Run {
    commit: String,
    date: String,
    machine: String,
    conditions: String,
}

impl Run {
    /// The run that is ending, of so many rounds; `loads` are those at their starts.
    pub(crate) fn now(repository: &Path, rounds: u32, loads: &[f64]) -> Self {
        let field = |path: &str, name: &str| {
            let text = fs::read_to_string(path).unwrap_or_default();
            let found =
                text.lines().find_map(|line| line.split_once(':').filter(|it| it.0.trim() == name));
            found.map_or_else(String::new, |(_, value)| value.trim().to_owned())
        };
        let git = Command::new("git")
            .arg("-C")
            .arg(repository)
            .args(["describe", "--always", "--dirty", "--abbrev=8", "--exclude=*"])
            .output();
        let commit = git.map_or_else(|_| Vec::new(), |it| it.stdout);
        let date = DateTime::<Utc>::from(std::time::SystemTime::now());
        let cores = std::thread::available_parallelism().map_or(0, usize::from);
        let (major, minor, patch) = zmq::version();
        let (least, most) = (quantile(loads, 0.0), quantile(loads, 1.0));
        Self {
            commit: String::from_utf8_lossy(&commit).trim().to_owned(),
            date: date.format("%Y-%m-%d %H:%M UTC").to_string(),
            machine: format!(
                "{cores} cores, {}; {} of memory",
                field("/proc/cpuinfo", "model name"),
                field("/proc/meminfo", "MemTotal"),
            ),
            conditions: format!(
                "Linux {}; libzmq {major}.{minor}.{patch}; {rounds} rounds; load average at their starts, this run's own \
                 included: {least:.1} to {most:.1}, now {:.1}",
                fs::read_to_string("/proc/sys/kernel/osrelease").unwrap_or_default().trim(),
                proc::load()
            ),
        }
    }

    /// Adds every figure to `history.csv`, a line each.
    pub(crate) fn append(&self, file: &Path, targets: &[Target]) -> Result<()> {
        let mut text = String::new();
        for target in targets {
            let Target { row, limit, value, parts, .. } = target;
            let limit = limit.to_string().replace("at most", "<=").replace("at least", ">=");
            let number = |value: f64| shortly(value).to_string();
            let [low, high] = target
                .bounds()
                .map_or_else(Default::default, |(low, high)| [low, high].map(number));
            let conditions = match parts.as_str() {
                "" => self.conditions.clone(),
                parts => format!("{parts}; {}", self.conditions),
            };
            let cells = [
                &self.date,
                &self.commit,
                &self.machine,
                &*row.area,
                &*row.what,
                &*row.unit,
                &limit,
                &number(*value),
                &low,
                &high,
                target.verdict(),
                &conditions,
            ];
            // As RFC 4180 has it.
            let cells = cells.map(|cell| match cell.contains([',', '"', '\n']) {
                true => format!("\"{}\"", cell.replace('"', "\"\"")),
                false => cell.to_owned(),
            });
            _ = writeln!(text, "{}", cells.join(","));
        }
        let mut file = fs::OpenOptions::new().append(true).create(true).open(file)?;
        if file.metadata()?.len() == 0 {
            text.insert_str(0, COLUMNS);
        }
        Ok(file.write_all(text.as_bytes())?)
    }
}

impl fmt::Display for Run {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { commit, date, machine, conditions } = self;
        write!(f, "{date}; commit {commit}; {machine}; {conditions}")
    }
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
        let row = || Row::new("", "", "");
        let verdict = |limit, rounds: &[f64]| Target::of(row(), limit, rounds, "").verdict();
        let rounds = [1.0, 1.1, 1.2, 1.1, 1.0, 1.1];
        assert_eq!(verdict(Limit::AtMost(1.2), &rounds), "met");
        assert_eq!(verdict(Limit::AtMost(1.1), &rounds), "undecided");
        assert_eq!(verdict(Limit::AtMost(0.9), &rounds), "missed");
        assert_eq!(verdict(Limit::AtLeast(1.0), &rounds), "met");
        assert_eq!(verdict(Limit::AtLeast(1.0), &rounds[..5]), "undecided");
        assert_eq!(Target::once(row(), Limit::AtMost(2.0), 2.0, "").verdict(), "met");
        assert_eq!(Target::once(row(), Limit::AtMost(2.0), f64::NAN, "").verdict(), "undecided");
    }

    #[test]
    fn history_has_a_line_a_figure() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("history.csv");
        let run = Run {
            commit: "abc".to_owned(),
            date: "2026".to_owned(),
            machine: "2 cores, small".to_owned(),
            conditions: "quiet".to_owned(),
        };
        let row = |what: &'static str| Row::new("zeromq", "us", what);
        let targets = [
            Target::between(row("a \"hop\""), Limit::AtMost(1.0 / 0.7), 1.0, (0.9, 1.234), ""),
            Target::once(row("b").in_other_table(), Limit::Shown, 2.0, "of 3"),
        ];
        run.append(&file, &targets[..1]).unwrap();
        run.append(&file, &targets[1..]).unwrap();
        assert_eq!(
            fs::read_to_string(&file).unwrap().strip_prefix(COLUMNS).unwrap(),
            "2026,abc,\"2 cores, small\",zeromq,\"a \"\"hop\"\"\",us,<= 1.43,1,0.9,1.23,met,quiet\n\
             2026,abc,\"2 cores, small\",zeromq,b,us,,2,,,,of 3; quiet\n"
        );
        assert_eq!(table(&targets).lines().count(), 3);
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
