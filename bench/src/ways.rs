//! Ways and payloads by turns: one table, the promises about them, one plot.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::time::Duration;

use anyhow::Result;
use clap::ValueEnum as _;

use crate::case::Case;
use crate::case::Way::{
    self, OurPublisher, PackageHop, PythonForward, PythonHop, RawDds, RawZmq, RosToZmq,
    RustForward, RustHop, ZmqToRos,
};
use crate::micro::Micro;
use crate::payload::Kind::{F32Mib, FileMib, FullHdRgb, Small, U8Rgb200, VgaJpeg, VgaRgb};
use crate::payload::{self, Kind};
use crate::proc;
use crate::report::Limit::{self, AtLeast, AtMost, Shown};
use crate::report::{Row, Target, quantile};
use crate::turn::{Bench, Phase, Turn};
use crate::worker::{Order, Report};

/// Turns of each case by round: a turn that failed is missing.
#[derive(Default)]
pub(crate) struct Ways(BTreeMap<Case, BTreeMap<u32, Turn>>);

/// Ways of one hop whose ends code, for people who choose a library.
pub(crate) const HOPS: [Way; 3] = [PythonHop, PackageHop, RustHop];

/// Payloads that are promised to cost a bridge no more than its raw hops.
const BRIDGED: [Kind; 4] = [Small, VgaJpeg, VgaRgb, FullHdRgb];

/// Hops that are promised to be so many times as fast as Python's.
const FASTER: [(Way, Kind, f64); 11] = [
    (RustHop, Small, 1.25),
    (RustHop, U8Rgb200, 4.0),
    (RustHop, F32Mib, 8.0),
    (RustHop, VgaRgb, 8.0),
    (RustHop, VgaJpeg, 1.2),
    (PackageHop, Small, 1.0 / 0.7),
    (PackageHop, U8Rgb200, 3.0),
    (PackageHop, F32Mib, 5.0),
    (PackageHop, VgaRgb, 5.0),
    (PackageHop, FullHdRgb, 8.0),
    (PackageHop, VgaJpeg, 1.2),
];

/// Payloads of our publisher beside libzmq's.
const PUBLISHED: [Kind; 2] = [Small, FileMib];

/// Number of rounds of a whole run of which what takes long has a turn in one.
pub(crate) const LONG_EVERY: u32 = 3;

/// Number of rounds of which a case has a turn in one, in a whole run: 25 minutes do not allow all cases in each.
fn turn_every(Case { way, payload, .. }: Case) -> u32 {
    const ALL: u32 = 1;
    // Not a multiple of two, so that they run in either order.
    const SEVENTH: u32 = 7;
    match (way, payload) {
        // Short turns, whose medians differ most by where the system puts their threads.
        (RawZmq | RawDds | ZmqToRos | RosToZmq, Small | VgaJpeg | VgaRgb) => ALL,
        (PythonHop | PackageHop | RustHop, Small) => ALL,
        (OurPublisher, _) | (RawZmq, FileMib) => ALL,
        (RawZmq | RawDds | ZmqToRos | RosToZmq, FullHdRgb) => LONG_EVERY,
        (PythonHop | PackageHop | RustHop, _) => LONG_EVERY,
        // They decide no promise.
        _ => SEVENTH,
    }
}

/// True where the case has a turn in that round of a whole run.
pub(crate) fn has_turn(case: Case, round: u32) -> bool {
    case.is_other || round % turn_every(case) == 1 % turn_every(case)
}

/// Figure of a turn.
type Figure = fn(&Turn) -> f64;

fn p50(turn: &Turn) -> f64 {
    quantile(&turn.paced.report.latency_us, 0.5)
}

/// Of the messages of all rounds.
fn p99(turns: &BTreeMap<u32, Turn>) -> f64 {
    let all = turns.values().flat_map(|it| &it.paced.report.latency_us);
    quantile(&all.copied().collect::<Vec<f64>>(), 0.99)
}

fn lost(report: &Report) -> u32 {
    (report.sent + report.refused).saturating_sub(report.received)
}

fn twice(report: &Report) -> u32 {
    report.duplicates
}

/// Messages of all turns that `count` counts.
fn total(turns: &BTreeMap<u32, Turn>, count: fn(&Report) -> u32) -> u32 {
    let phases = turns.values().flat_map(|it| [&it.paced, &it.window]);
    phases.map(|Phase { report, .. }| count(report)).sum()
}

impl Ways {
    /// Adds a turn.
    pub(crate) fn add(&mut self, round: u32, case: Case, turn: Turn) {
        self.0.entry(case).or_default().insert(round, turn);
    }

    /// Figure of a case in each round, by payload and way.
    fn series(&self, way: Way, payload: Kind, is_other: bool, of: Figure) -> BTreeMap<u32, f64> {
        let turns = self.0.get(&Case { payload, way, is_other });
        turns.into_iter().flatten().map(|(round, turn)| (*round, of(turn))).collect()
    }

    /// Ratio of one figure to another in each round that has both, and medians of the two.
    fn ratio(
        &self,
        row: Row,
        limit: Limit,
        (above, below): (&BTreeMap<u32, f64>, &BTreeMap<u32, f64>),
        unit: &str,
    ) -> Option<Target> {
        let pairs = || above.iter().filter_map(|(round, one)| Some((*one, *below.get(round)?)));
        let rounds: Vec<f64> = pairs().map(|(above, below)| above / below).collect();
        let middle =
            |of: fn((f64, f64)) -> f64| quantile(&pairs().map(of).collect::<Vec<_>>(), 0.5);
        let parts = format!("{:.1} / {:.1} {unit}", middle(|it| it.0), middle(|it| it.1));
        (!rounds.is_empty()).then(|| Target::of(row, limit, &rounds, parts))
    }

    /// A bridge beside the two raw hops that it joins: the time of both and `more` on top.
    fn bridged(
        &self,
        (way, kind): (Way, Kind),
        what: &str,
        limit: f64,
        of: Figure,
        more: f64,
    ) -> Option<Target> {
        let dds = self.series(RawDds, kind, false, of);
        let mut hops = self.series(RawZmq, kind, false, of);
        hops.retain(|round, _| dds.contains_key(round));
        hops.iter_mut().for_each(|(round, it)| *it += dds.get(round).unwrap_or(&0.0) + more);
        let row =
            Row::new(way.area(), "ratio", format!("{}, {}, {what}", way.title(), kind.title()));
        let bridge = self.series(way, kind, false, of);
        self.ratio(row.in_readme(), AtMost(limit), (&bridge, &hops), "us")
    }

    /// Promises that these turns decide.
    pub(crate) fn targets(&self, micro: &Micro) -> Vec<Target> {
        let mut targets = Vec::new();
        for kind in BRIDGED {
            for (way, code) in [(ZmqToRos, "decode"), (RosToZmq, "encode")] {
                // Pixels are base64 on ZeroMQ; a file goes as it is.
                let base64 = match kind {
                    VgaRgb | FullHdRgb => {
                        micro.us(&format!("base64/{code} {}", payload::name(&kind)))
                    }
                    _ => 0.0,
                };
                let (what, limit) = match kind {
                    Small => ("p50 against raw hops", 1.15),
                    _ => ("p50 against raw hops and base64", 1.05),
                };
                targets.extend(self.bridged((way, kind), what, limit, p50, base64));
                if kind == Small {
                    let of = |turn: &Turn| 1e6 / turn.window.rate();
                    let what = "64 under way, time a message against raw hops one after the other";
                    targets.extend(self.bridged((way, kind), what, 1.0 / 0.8, of, 0.0));
                }
            }
        }
        for (ours, kind, limit) in FASTER {
            let us = if ours == PackageHop { "the same script on wrapyfi_rs" } else { "us" };
            let what = format!("one hop of a {}, p50, Python against {us}", kind.title());
            let both = [PythonHop, ours].map(|way| self.series(way, kind, false, p50));
            let row = Row::new(ours.area(), "ratio", what);
            targets.extend(self.ratio(row, AtLeast(limit), (&both[0], &both[1]), "us"));
        }
        for (way, kind) in [(OurPublisher, Small), (RustHop, Small), (OurPublisher, FileMib)] {
            let what = format!("{}, {}, p50 against a raw hop", way.title(), kind.title());
            let both = [way, RawZmq].map(|way| self.series(way, kind, false, p50));
            let row = Row::new("zeromq", "ratio", what);
            targets.extend(self.ratio(row, AtMost(1.15), (&both[0], &both[1]), "us"));
        }
        let costs: [(&str, &str, Figure); 2] = [
            ("messages a second", "", |turn| turn.window.rate()),
            ("CPU of the sending process", "us", |turn| turn.window.source_us),
        ];
        for kind in PUBLISHED {
            for (figure, unit, of) in costs {
                let what = format!(
                    "our ZeroMQ publisher against libzmq's PUB, {}, {figure}",
                    kind.title()
                );
                let limit = if unit.is_empty() { AtLeast(1.0) } else { AtMost(1.0) };
                let [ours, mut raw] =
                    [OurPublisher, RawZmq].map(|way| self.series(way, kind, false, of));
                let row = Row::new("zeromq", "ratio", what.clone());
                targets.extend(self.ratio(row, limit, (&ours, &raw), unit));
                if kind == Small && !unit.is_empty() {
                    // libzmq is given its messages encoded.
                    let coding = micro.us(&format!("zeromq/encode {}", payload::name(&kind)));
                    raw.values_mut().for_each(|us| *us += coding);
                    let row = Row::new("zeromq", "ratio", format!("{what}, and coding alone"));
                    targets.extend(self.ratio(row, limit, (&ours, &raw), unit));
                }
            }
        }
        for case in self.0.keys().filter(|case| case.is_other) {
            let what = format!(
                "{}, {}, p50, this program against the other (5 % more counts as the same)",
                case.way.title(),
                case.payload.title()
            );
            let both = [false, true].map(|other| self.series(case.way, case.payload, other, p50));
            let row = Row::new(case.way.area(), "ratio", what);
            targets.extend(self.ratio(row, AtMost(1.05), (&both[0], &both[1]), "us"));
        }
        targets.extend(self.figures());
        targets
    }

    /// Columns of each way and payload, which [`Self::table`] shows.
    fn figures(&self) -> Vec<Target> {
        let figures: [(&str, &str, Figure); 6] = [
            ("us", "p50", p50),
            ("1/s", "messages a second", |turn| turn.window.rate()),
            ("us", "CPU a message", |turn| turn.paced.cpu_us),
            ("us", "CPU a message, between the ends", |turn| turn.paced.middle_us),
            ("MiB", "RSS", |turn| turn.rss_mib),
            ("MiB", "RSS, between the ends", |turn| turn.middle_rss_mib),
        ];
        let figure = |(case, turns): (&Case, &BTreeMap<u32, Turn>)| {
            let row = |unit, name: &str| {
                let what = format!("{}, {}: {name}", case.way.title(), case.payload.title());
                Row::new(case.way.area(), unit, what).in_other_table()
            };
            let once = |unit, name, value| Target::once(row(unit, name), Shown, value, "");
            let of_all = [
                once("us", "p99", p99(turns)),
                once("", "lost", total(turns, lost).into()),
                once("", "twice", total(turns, twice).into()),
            ];
            let figures = figures.map(|(unit, name, of)| {
                let rounds: Vec<f64> = turns.values().map(of).collect();
                Target::of(row(unit, name), Shown, &rounds, "")
            });
            of_all.into_iter().chain(figures).collect::<Vec<_>>()
        };
        self.0.iter().filter(|(case, _)| !case.is_other).flat_map(figure).collect()
    }

    /// A row for each way and payload: latency, delivery, throughput, CPU, memory.
    pub(crate) fn table(&self) -> String {
        let mut text = String::from(
            "Microseconds. p50: median of the rounds' medians, with their range; p99 of all messages; both at a fixed rate, from \
             when a message was due. messages/s with few under way. CPU a message at the fixed rate: of all processes, and \
             between the ends. RSS in MiB.\n\n\
             | way | payload | p50 | range | p99 | lost | twice | messages/s | CPU | CPU between | RSS | RSS between |\n\
             | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n",
        );
        for (case, turns) in &self.0 {
            let of = |figure: Figure| turns.values().map(figure).collect::<Vec<f64>>();
            let middle = |figure: Figure| quantile(&of(figure), 0.5);
            let halves = of(p50);
            _ = writeln!(
                text,
                "| {}{} | {} | {:.0} | {:.0} to {:.0} | {:.0} | {} | {} | {:.0} | {:.0} | {:.0} | {:.0} | {:.0} |",
                case.way.title(),
                if case.is_other { ", the other program" } else { "" },
                case.payload.title(),
                quantile(&halves, 0.5),
                quantile(&halves, 0.0),
                quantile(&halves, 1.0),
                p99(turns),
                total(turns, lost),
                total(turns, twice),
                middle(|it| it.window.rate()),
                middle(|it| it.paced.cpu_us),
                middle(|it| it.paced.middle_us),
                middle(|it| it.rss_mib),
                middle(|it| it.middle_rss_mib),
            );
        }
        text
    }

    /// A row for each payload: one hop through Python Wrapyfi, through our package for Python and through our library.
    pub(crate) fn hops(&self) -> String {
        let mut text = String::from(
            "| one hop, coding included | Python Wrapyfi | the same script on `wrapyfi_rs` | times as fast | Rust | times as fast |\n\
             | --- | --- | --- | --- | --- | --- |\n",
        );
        for &payload in Kind::value_variants() {
            let [python, package, rust] = HOPS.map(|way| self.series(way, payload, false, p50));
            if python.is_empty() {
                continue;
            }
            let time = |of: &BTreeMap<u32, f64>| {
                let figures: Vec<f64> = of.values().copied().collect();
                format!("{:.2} ms", quantile(&figures, 0.5) / 1e3)
            };
            let faster = |ours: &BTreeMap<u32, f64>| {
                let found = self.ratio(Row::new("", "", ""), Shown, (&python, ours), "us");
                found.map_or_else(String::new, |it| it.figure())
            };
            _ = writeln!(
                text,
                "| {} | {} | {} | {} | {} | {} |",
                payload.title(),
                time(&python),
                time(&package),
                faster(&package),
                time(&rust),
                faster(&rust),
            );
        }
        text
    }

    /// Bars of the medians of `of` on a logarithmic axis, 10 us to 1 s, as SVG.
    pub(crate) fn plot(&self, of: &[Way]) -> String {
        let rows: Vec<_> = self.0.iter().filter(|(case, _)| of.contains(&case.way)).collect();
        const LEFT: f64 = 480.0;
        const DECADE: f64 = 110.0;
        let at = |micros: f64| LEFT + (micros.log10().clamp(1.0, 6.0) - 1.0) * DECADE;
        let height = 17 * rows.len() + 40;
        let mut text = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"1110\" height=\"{height}\" font-family=\"sans-serif\" \
             font-size=\"12\" role=\"img\" aria-label=\"Latency of ways and payloads\">\n\
             <rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n"
        );
        for (decade, label) in (1..).zip(["10 us", "100 us", "1 ms", "10 ms", "100 ms", "1 s"]) {
            let x = at(10_f64.powi(decade));
            _ = writeln!(
                text,
                "<path d=\"M{x:.0} 24V{height}\" stroke=\"#d8dee4\"/><text x=\"{x:.0}\" y=\"16\" \
                 text-anchor=\"middle\">{label}</text>"
            );
        }
        for (row, (case, turns)) in rows.into_iter().enumerate() {
            let (y, end) =
                (17 * row + 30, at(quantile(&turns.values().map(p50).collect::<Vec<_>>(), 0.5)));
            let colour = match case.way {
                RawZmq | OurPublisher | RawDds => "#8b949e",
                ZmqToRos | RosToZmq => "#0969da",
                RustHop | RustForward => "#1a7f37",
                PackageHop => "#8250df",
                PythonHop | PythonForward => "#bc4c00",
            };
            _ = writeln!(
                text,
                "<text x=\"{:.0}\" y=\"{}\" text-anchor=\"end\">{}, {}{}</text>\
                 <rect x=\"{LEFT}\" y=\"{y}\" width=\"{:.1}\" height=\"13\" fill=\"{colour}\"/>",
                LEFT - 8.0,
                y + 11,
                case.payload.title(),
                case.way.title(),
                if case.is_other { ", the other program" } else { "" },
                end - LEFT,
            );
        }
        text + "</svg>\n"
    }
}

/// 1080p frames at 30 Hz through the bridge: losses and growth of its memory.
pub(crate) fn stream(bench: &Bench, seconds: u32) -> Result<Vec<Target>> {
    let mut line = bench.line(Case { way: ZmqToRos, payload: FullHdRgb, is_other: false })?;
    line.ask(&Order::Warm)?;
    let bridge = line.middle.get(1).map_or(0, crate::child::Child::id);
    line.source.tell(&Order::Paced { count: seconds * 30, hz: 30.0 })?;
    let settle = seconds / 6;
    std::thread::sleep(Duration::from_secs(settle.into()));
    let before = proc::rss_mib(bridge);
    let report: Report = line.source.answer()?;
    let grown = (proc::rss_mib(bridge) - before) * 60.0 / f64::from((seconds - settle).max(1));
    let Report { sent, duplicates, .. } = report;
    Ok(vec![
        Target::once(
            Row::new("ros2", "", "1080p RGB at 30 Hz, ZeroMQ to ROS 2, reliable: lost or twice")
                .in_readme(),
            AtMost(0.0),
            f64::from(lost(&report) + duplicates),
            format!("of {sent} in {seconds} s"),
        ),
        Target::once(
            Row::new(
                "ros2",
                "MiB/min",
                "1080p RGB at 30 Hz, ZeroMQ to ROS 2, reliable: growth of the bridge's memory, MiB a minute",
            ),
            if seconds < 60 { Shown } else { AtMost(1.0) },
            grown,
            format!("from {before:.0} MiB after {settle} s"),
        ),
    ])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn turn(micros: f64) -> Turn {
        let latency_us = vec![micros];
        let report = Report { sent: 1, received: 1, latency_us, ..Report::default() };
        Turn { paced: Phase { report, ..Phase::default() }, ..Turn::default() }
    }

    /// Turns of one round are compared with each other: a round in which all is slow changes nothing.
    #[test]
    fn ratios_are_of_rounds() {
        let mut ways = Ways::default();
        for round in 1..=6 {
            let slow = if round % 2 == 0 { 10.0 } else { 1.0 };
            let case = |is_other| Case { way: RawZmq, payload: Small, is_other };
            ways.add(round, case(false), turn(30.0 * slow));
            ways.add(round, case(true), turn(10.0 * slow));
        }
        let both = [false, true].map(|other| ways.series(RawZmq, Small, other, p50));
        let target =
            ways.ratio(Row::new("", "", ""), AtMost(3.0), (&both[0], &both[1]), "us").unwrap();
        assert!(crate::report::table(&[target]).contains("| 3.00: 30.0 / 10.0 us |  | met |"));
        assert_eq!(ways.table().lines().count(), 6);
        assert_eq!(ways.plot(&[RawZmq]).matches("<rect x=").count(), 2);
        assert_eq!(ways.plot(&HOPS).matches("<rect x=").count(), 0);
        for round in 1..=6 {
            for (way, micros) in HOPS.into_iter().zip([3000.0, 1500.0, 1000.0]) {
                ways.add(round, Case { payload: Small, way, is_other: false }, turn(micros));
            }
        }
        let hops = ways.hops();
        assert!(
            hops.ends_with("| small dict | 3.00 ms | 1.50 ms | 2.00 | 1.00 ms | 3.00 |\n"),
            "{hops}"
        );
    }
}
