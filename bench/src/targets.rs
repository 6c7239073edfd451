//! What was promised, and whether it holds in this run.

use crate::case::Way::{self, PythonHop, RawDds, RawZmq, RosToZmq, RustHop, ZmqToRos};
use crate::payload::Kind::{self, U8Rgb200, VgaJpeg, VgaRgb};
use crate::results::Results;

/// One promise.
#[derive(Debug, Clone)]
pub(crate) struct Target {
    pub(crate) what: String,
    /// What was found, with its parts.
    pub(crate) found: String,
    /// What was promised.
    pub(crate) promised: String,
    /// `None` where a part was not measured.
    pub(crate) pass: Option<bool>,
}

/// A bridged way against the two raw hops it is made of, in microseconds.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bridged {
    pub(crate) bridge: f64,
    pub(crate) zmq: f64,
    pub(crate) dds: f64,
    pub(crate) base64: f64,
}

impl Bridged {
    /// The least that the parts cost.
    pub(crate) fn parts(self) -> f64 {
        self.zmq + self.dds + self.base64
    }

    /// How many times its parts the bridge takes.
    pub(crate) fn ratio(self) -> f64 {
        self.bridge / self.parts()
    }
}

/// The parts of a bridged way.
pub(crate) fn bridged(results: &Results, way: Way, kind: Kind) -> Option<Bridged> {
    let half = |way| results.summary(way, kind).map(|summary| summary.p50);
    let code = if way == ZmqToRos { "decode" } else { "encode" };
    let base64 = match kind {
        VgaRgb => results.figure(&format!("base64-simd {code} 640x480 RGB"))?,
        Kind::FullHdRgb => results.figure(&format!("base64-simd {code} 1080p RGB"))?,
        _ => 0.0,
    };
    Some(Bridged { bridge: half(way)?, zmq: half(RawZmq)?, dds: half(RawDds)?, base64 })
}

/// All promises.
pub(crate) fn check(results: &Results) -> Vec<Target> {
    let mut targets = Vec::new();
    for (way, kind, limit) in [
        (ZmqToRos, VgaRgb, 1.3),
        (RosToZmq, VgaRgb, 1.3),
        (ZmqToRos, VgaJpeg, 1.15),
        (RosToZmq, VgaJpeg, 1.15),
    ] {
        let parts = if kind == VgaRgb { "raw hops + base64" } else { "raw hops" };
        let measured = bridged(results, way, kind);
        targets.push(Target {
            what: format!("{}, {}, p50 against {parts}", way.title(), kind.title()),
            found: measured.map_or_else(String::new, |b| {
                let Bridged { bridge, zmq, dds, base64 } = b;
                format!("{:.2}: {bridge:.0} / ({zmq:.0} + {dds:.0} + {base64:.0}) us", b.ratio())
            }),
            promised: format!("at most {limit}"),
            pass: measured.map(|b| b.ratio() <= limit),
        });
    }
    let coding = results.python_coding(U8Rgb200).zip(results.our_coding(U8Rgb200));
    let ratio = coding.map(|(python, ours)| (python.0 + python.1) / (ours.0 + ours.1));
    targets.push(Target {
        what: format!("coding of a {}, Python against us", U8Rgb200.title()),
        found: coding.zip(ratio).map_or_else(String::new, |((python, ours), ratio)| {
            let (python, ours) = (python.0 + python.1, ours.0 + ours.1);
            format!("{ratio:.1} x: {python:.0} / {ours:.0} us")
        }),
        promised: "at least 10 x".to_owned(),
        pass: ratio.map(|ratio| ratio >= 10.0),
    });
    let half = |way| results.summary(way, U8Rgb200).map(|summary| summary.p50);
    let hops = half(PythonHop).zip(half(RustHop));
    targets.push(Target {
        what: format!("one hop of a {}, p50, Python against us", U8Rgb200.title()),
        found: hops.map_or_else(String::new, |(python, ours)| {
            format!("{:.1} x: {python:.0} / {ours:.0} us", python / ours)
        }),
        promised: "at least 4 x".to_owned(),
        pass: hops.map(|(python, ours)| python / ours >= 4.0),
    });
    let soak = results.soak.as_ref();
    let lost = soak.map(|soak| {
        let report = &soak.report;
        (report.sent + report.refused - report.received, report.duplicates)
    });
    targets.push(Target {
        what: "1080p RGB at 30 Hz, ZeroMQ to ROS 2, reliable: losses".to_owned(),
        found: soak.zip(lost).map_or_else(String::new, |(soak, (lost, duplicates))| {
            let (sent, seconds) = (soak.report.sent, soak.seconds);
            format!("{lost} lost, {duplicates} twice, of {sent} in {seconds} s")
        }),
        promised: "none".to_owned(),
        pass: lost.map(|lost| lost == (0, 0)),
    });
    let growth = soak
        .and_then(|soak| soak.memory.iter().find(|(name, ..)| *name == "bridge"))
        .map(|(_, _, growth)| *growth);
    targets.push(Target {
        what: "the same: growth of the bridge's memory".to_owned(),
        found: growth.map_or_else(String::new, |growth| format!("{growth:+.2} MiB a minute")),
        promised: "less than 1 MiB a minute".to_owned(),
        pass: growth.map(|growth| growth < 1.0),
    });
    targets
}
