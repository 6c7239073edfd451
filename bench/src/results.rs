//! Everything a run found, and its summary.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use anyhow::Result;

use crate::case::{Case, Way};
use crate::crowd::Rest;
use crate::estimate::Series;
use crate::fast;
use crate::many::Many;
use crate::micro::Figure;
use crate::payload::Kind;
use crate::python::Coding;
use crate::soak::Soak;
use crate::stats::{median, quantile};
use crate::tcpros::{self, Streams};
use crate::trip::Leg;
use crate::turn::{Phase, Turn};
use crate::worker::Report;
use crate::yarp::Ports;

/// All rounds of all cases.
#[derive(Default)]
pub(crate) struct Results {
    pub(crate) rounds: u32,
    /// Turns of each case by round: a turn that failed is missing.
    turns: BTreeMap<Case, BTreeMap<u32, Turn>>,
    /// Figures of single threads, in the order in which they were first measured.
    micro: Vec<(String, Series)>,
    coding: BTreeMap<Kind, BTreeMap<u32, Coding>>,
    /// Turns of whatever has two ends, by its name and by round.
    legs: BTreeMap<String, BTreeMap<u32, Leg>>,
    pub(crate) soak: Option<Soak>,
    pub(crate) rest: Option<Rest>,
    pub(crate) many: Option<Many>,
    pub(crate) fast: Option<fast::Stream>,
    pub(crate) ports: Option<Ports>,
    streams: BTreeMap<tcpros::Way, Streams>,
    /// Turns that failed, with the reason.
    pub(crate) failures: Vec<String>,
    /// Reason why there are no figures of Python Wrapyfi.
    pub(crate) no_python: Option<String>,
    /// Load average at the start of every round.
    pub(crate) loads: Vec<f64>,
    rows: String,
}

/// One case over all rounds. Times in microseconds.
#[derive(Debug, Clone, Default)]
pub(crate) struct Summary {
    /// Median over the rounds of each round's median.
    pub(crate) p50: f64,
    /// Lowest and highest median of a round.
    pub(crate) p50_range: (f64, f64),
    /// 99th percentile of all messages of all rounds together.
    pub(crate) p99: f64,
    /// Rounds in which it was measured.
    pub(crate) rounds: usize,
    pub(crate) messages: usize,
    pub(crate) rate: f64,
    pub(crate) cpu_us: f64,
    pub(crate) middle_us: f64,
    pub(crate) lost: u32,
    pub(crate) duplicates: u32,
    pub(crate) rss_mib: f64,
    pub(crate) middle_rss_mib: f64,
    /// Start to first arrival, in milliseconds.
    pub(crate) opening_ms: f64,
    /// Median of the messages that only warmed up.
    pub(crate) warm: f64,
}

fn lost(report: &Report) -> u32 {
    (report.sent + report.refused).saturating_sub(report.received)
}

impl Results {
    /// Results of a run of `rounds` rounds, empty so far.
    pub(crate) fn new(rounds: u32) -> Self {
        Self { rounds, ..Self::default() }
    }

    /// Adds a turn.
    pub(crate) fn turn(&mut self, round: u32, case: Case, turn: Turn) {
        let name = case.name();
        for (phase, found) in [("paced", &turn.paced), ("window", &turn.window)] {
            let Phase { report, cpu_us, middle_us } = found;
            let q = |fraction| quantile(&report.latency_us, fraction).unwrap_or(f64::NAN);
            let values = [
                ("p50_us", q(0.5)),
                ("p99_us", q(0.99)),
                ("max_us", q(1.0)),
                ("min_us", q(0.0)),
                ("latest_send_us", report.latest_us),
                ("sent", report.sent.into()),
                ("refused", report.refused.into()),
                ("received", report.received.into()),
                ("duplicates", report.duplicates.into()),
                ("messages_per_s", found.rate()),
                ("cpu_us_per_message", *cpu_us),
                ("middle_cpu_us_per_message", *middle_us),
            ];
            for (measure, value) in values {
                self.row(round, &name, phase, measure, value);
            }
        }
        #[allow(clippy::cast_precision_loss)]
        let opening_ms = turn.warm.opening_ns as f64 / 1e6;
        self.row(round, &name, "warm", "opening_ms", opening_ms);
        let warm = median(&turn.warm.latency_us).unwrap_or(f64::NAN);
        self.row(round, &name, "warm", "p50_us", warm);
        self.row(round, &name, "end", "rss_mib", turn.rss_mib);
        self.row(round, &name, "end", "middle_rss_mib", turn.middle_rss_mib);
        self.turns.entry(case).or_default().insert(round, turn);
    }

    /// Adds a turn of two ends, or the reason why there is none.
    pub(crate) fn leg(&mut self, round: u32, name: &str, found: Result<Leg>) {
        let leg = match found {
            Ok(leg) => leg,
            Err(error) => {
                let failure = format!("round {round}, {name}: {error:#}");
                crate::note(&failure);
                return self.failures.push(failure);
            }
        };
        let Phase { report, cpu_us, middle_us } = &leg.calls;
        let q = |fraction| quantile(&report.latency_us, fraction).unwrap_or(f64::NAN);
        for (measure, value) in [
            ("p50_us", q(0.5)),
            ("p99_us", q(0.99)),
            ("max_us", q(1.0)),
            ("min_us", q(0.0)),
            ("sent", report.sent.into()),
            ("received", report.received.into()),
            ("duplicates", report.duplicates.into()),
            ("cpu_us_per_message", *cpu_us),
            ("far_cpu_us_per_message", *middle_us),
            ("opening_ms", leg.opening_ms()),
        ] {
            self.row(round, name, "ends", measure, value);
        }
        self.legs.entry(name.to_owned()).or_default().insert(round, leg);
    }

    /// Turns of two ends by round; `None` where none succeeded.
    pub(crate) fn legs(&self, name: &str) -> Option<&BTreeMap<u32, Leg>> {
        self.legs.get(name)
    }

    /// A figure of two ends in each round.
    pub(crate) fn of_legs(
        &self,
        name: &str,
        figure: impl Fn(&Leg) -> Option<f64>,
    ) -> Option<Series> {
        let legs = self.legs(name)?.iter();
        Some(legs.filter_map(|(round, leg)| Some((*round, figure(leg)?))).collect())
    }

    /// A quantile of the times of two ends in each round.
    pub(crate) fn times(&self, name: &str, fraction: f64) -> Option<Series> {
        self.of_legs(name, |leg| quantile(&leg.calls.report.latency_us, fraction))
    }

    /// Adds what a bridge of many routes takes.
    #[allow(clippy::cast_precision_loss)]
    pub(crate) fn many(&mut self, many: Many) {
        self.rest_rows(
            "many",
            &[
                ("opening_ms", many.opening_ms),
                ("threads", many.threads as f64),
                ("rss_mib", many.rss_mib),
                ("percent_of_core", many.share),
                ("reload_ms", many.reload_ms),
                ("lost", many.lost as f64),
            ],
        );
        self.many = Some(many);
    }

    /// Adds what a bridge at rest takes.
    pub(crate) fn rest(&mut self, rest: Rest) {
        self.rest_rows(
            "endpoints",
            &[
                ("percent_of_core_alone", rest.alone),
                ("percent_of_core_among", rest.among),
                ("meeting_cpu_ms", rest.meeting_ms),
                ("meeting_rss_mib", rest.grown_mib),
            ],
        );
        self.rest = Some(rest);
    }

    /// Adds what YARP's ports take at rest.
    pub(crate) fn ports(&mut self, ports: Ports) {
        self.rest_rows(
            "yarp-ports",
            &[
                ("percent_of_core", ports.share),
                ("opening_ms", ports.opening_ms),
                ("rss_mib", ports.rss_mib),
            ],
        );
        self.ports = Some(ports);
    }

    fn rest_rows(&mut self, case: &str, figures: &[(&str, f64)]) {
        for (measure, value) in figures {
            self.row(0, case, "rest", measure, *value);
        }
    }

    /// Adds what became of two streams of ROS 1.
    pub(crate) fn streams(&mut self, way: tcpros::Way, streams: Streams) {
        let name = format!("ros1-{}/streams", way.name());
        self.row(0, &name, "stream", "percent_of_core", streams.share);
        for (load, report) in &streams.reports {
            for (measure, value) in
                [("sent", report.sent), ("received", report.received), ("refused", report.refused)]
            {
                let measure = format!("{}_{measure}", load.name());
                self.row(0, &name, "stream", &measure, value.into());
            }
        }
        self.streams.insert(way, streams);
    }

    /// Streams of ROS 1 by what carried them.
    pub(crate) fn streams_of(&self, way: tcpros::Way) -> Option<&Streams> {
        self.streams.get(&way)
    }

    /// Adds figures of the machine and of coding.
    pub(crate) fn micro(&mut self, round: u32, figures: Vec<Figure>) {
        for (name, value) in figures {
            self.row(round, "micro", "alone", &name, value);
            match self.micro.iter_mut().find(|(known, _)| *known == name) {
                Some((_, values)) => _ = values.insert(round, value),
                None => self.micro.push((name, Series::from([(round, value)]))),
            }
        }
    }

    /// Adds Python's coding.
    pub(crate) fn coding(&mut self, round: u32, kind: Kind, coding: Coding) {
        for (what, value) in [("encode", coding.encode_us), ("decode", coding.decode_us)] {
            let name = format!("python {what} {}", kind.name());
            self.row(round, "micro", "alone", &name, value);
        }
        self.coding.entry(kind).or_default().insert(round, coding);
    }

    fn row(&mut self, round: u32, case: &str, phase: &str, measure: &str, value: f64) {
        // Writing to a String cannot fail.
        _ = writeln!(self.rows, "{round},{case},{phase},\"{measure}\",{value:.3}");
    }

    /// Every figure of every round, as CSV.
    pub(crate) fn csv(&self) -> String {
        format!("round,case,phase,measure,value\n{}", self.rows)
    }

    /// A case over all rounds; `None` where no round of it succeeded.
    pub(crate) fn summary(&self, way: Way, payload: Kind) -> Option<Summary> {
        let halves: Vec<f64> = self.halves(way, payload)?.into_values().collect();
        let turns: Vec<&Turn> = self.turns.get(&Case { way, payload })?.values().collect();
        let over = |value: &dyn Fn(&Turn) -> f64| {
            let values: Vec<f64> =
                turns.iter().map(|turn| value(turn)).filter(|v| v.is_finite()).collect();
            median(&values).unwrap_or(f64::NAN)
        };
        let pooled: Vec<f64> =
            turns.iter().flat_map(|turn| turn.paced.report.latency_us.clone()).collect();
        let both = |turn: &Turn, value: &dyn Fn(&Report) -> u32| {
            value(&turn.paced.report) + value(&turn.window.report)
        };
        Some(Summary {
            p50: median(&halves)?,
            p50_range: (quantile(&halves, 0.0)?, quantile(&halves, 1.0)?),
            p99: quantile(&pooled, 0.99)?,
            rounds: halves.len(),
            messages: pooled.len(),
            rate: over(&|turn| turn.window.rate()),
            cpu_us: over(&|turn| turn.paced.cpu_us),
            middle_us: over(&|turn| turn.paced.middle_us),
            lost: turns.iter().map(|turn| both(turn, &lost)).sum(),
            duplicates: turns.iter().map(|turn| both(turn, &|r| r.duplicates)).sum(),
            rss_mib: over(&|turn| turn.rss_mib),
            middle_rss_mib: over(&|turn| turn.middle_rss_mib),
            #[allow(clippy::cast_precision_loss)]
            opening_ms: over(&|turn| turn.warm.opening_ns as f64 / 1e6),
            warm: over(&|turn| median(&turn.warm.latency_us).unwrap_or(f64::NAN)),
        })
    }

    /// Cases that were measured.
    pub(crate) fn cases(&self) -> impl Iterator<Item = Case> + '_ {
        self.turns.keys().copied()
    }

    /// Median latency of a case in each round; `None` where no round of it succeeded.
    pub(crate) fn halves(&self, way: Way, payload: Kind) -> Option<Series> {
        let turns = self.turns.get(&Case { way, payload })?;
        let half =
            |(round, turn): (&u32, &Turn)| Some((*round, median(&turn.paced.report.latency_us)?));
        Some(turns.iter().filter_map(half).collect())
    }

    /// A figure in each round.
    pub(crate) fn figure_rounds(&self, name: &str) -> Option<&Series> {
        Some(&self.micro.iter().find(|(known, _)| known == name)?.1)
    }

    /// Median over the rounds of a figure.
    pub(crate) fn figure(&self, name: &str) -> Option<f64> {
        middle(self.figure_rounds(name)?)
    }

    /// Names of the figures.
    pub(crate) fn figures(&self) -> impl Iterator<Item = &str> {
        self.micro.iter().map(|(name, _)| name.as_str())
    }

    /// Our coding for ZeroMQ in each round: encode, decode.
    pub(crate) fn our_rounds(&self, kind: Kind) -> Option<(&Series, &Series)> {
        // A program has pixels before and after, and so has Python.
        let form = if kind == Kind::VgaJpeg { "pixels" } else { "ZeroMQ" };
        let one = |what: &str| self.figure_rounds(&format!("{what} {form} {}", kind.name()));
        Some((one("encode")?, one("decode")?))
    }

    /// Python's coding in each round: encode, decode.
    pub(crate) fn python_rounds(&self, kind: Kind) -> Option<(Series, Series)> {
        let all = self.coding.get(&kind)?;
        let over = |value: &dyn Fn(&Coding) -> f64| {
            all.iter().map(|(round, coding)| (*round, value(coding))).collect()
        };
        Some((over(&|c| c.encode_us), over(&|c| c.decode_us)))
    }

    /// Our coding, medians in microseconds: encode, decode.
    pub(crate) fn our_coding(&self, kind: Kind) -> Option<(f64, f64)> {
        let (encode, decode) = self.our_rounds(kind)?;
        Some((middle(encode)?, middle(decode)?))
    }

    /// Python's coding: encode, decode.
    pub(crate) fn python_coding(&self, kind: Kind) -> Option<(f64, f64)> {
        let (encode, decode) = self.python_rounds(kind)?;
        Some((middle(&encode)?, middle(&decode)?))
    }
}

/// Median of the rounds.
fn middle(series: &Series) -> Option<f64> {
    median(&series.values().copied().collect::<Vec<_>>())
}
