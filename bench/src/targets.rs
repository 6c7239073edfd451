//! Promises, judged by this run.
//!
//! Each ratio has a bootstrap interval over the rounds, and the interval decides: a limit inside it
//! is neither met nor missed. Beside the promise for a bridged way stands a figure that nobody
//! promised and that explains it: the minimal relay, which is the least that two hops in one chain
//! can take.

mod ros1;
mod yarp;

use crate::asked::Asked;
use crate::case::Way::{
    self, PythonHop, RawDds, RawZmq, RelayToRos, RelayToZmq, RosToZmq, RustHop, ZmqToRos,
};
use crate::coding::{
    ARRAY_TEXT, DECODE, DECODE_ALONE, DECODE_MEMORY, ENCODE, ENCODE_ALONE, ENCODE_MEMORY, MEMCPY,
};
use crate::crowd::Rest;
use crate::dynamic;
use crate::estimate::{Estimate, Limit, Series, Verdict};
use crate::many::Many;
use crate::payload::Kind::{self, F32Mib, U8Rgb200, VgaJpeg, VgaRgb};
use crate::registered;
use crate::results::Results;
use crate::trip::{Load, Trip, Way as TripWay};

/// Outcome of a promise in this run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Outcome {
    Judged(Verdict),
    /// Nothing was promised.
    Shown,
    /// A part was not measured.
    NotMeasured,
}

/// One promise.
#[derive(Debug, Clone)]
pub(crate) struct Target {
    pub(crate) what: String,
    /// Promise in words; empty where there is none.
    pub(crate) promised: String,
    /// Figure that was found, with its parts.
    pub(crate) found: String,
    /// Interval that holds the ratio with a probability of 95 %.
    pub(crate) interval: Option<(f64, f64)>,
    pub(crate) outcome: Outcome,
}

impl Target {
    /// A ratio; `found` says its parts.
    fn ratio<const N: usize>(
        what: String,
        limit: Option<Limit>,
        estimate: Option<Estimate<N>>,
        found: impl Fn([f64; N]) -> String,
    ) -> Self {
        let promised = limit.map_or_else(String::new, |limit| limit.to_string());
        let Some(Estimate { parts, value, interval }) = estimate else {
            let outcome = Outcome::NotMeasured;
            return Self { what, promised, found: String::new(), interval: None, outcome };
        };
        let outcome = limit.map_or(Outcome::Shown, |limit| Outcome::Judged(limit.judge(interval)));
        Self { what, promised, found: format!("{value:.2}: {}", found(parts)), interval, outcome }
    }

    /// Two measurements, combined.
    fn two(
        what: impl Into<String>,
        limit: Option<Limit>,
        [one, other]: [Option<Series>; 2],
        combine: fn([f64; 2]) -> f64,
        found: fn([f64; 2]) -> String,
    ) -> Self {
        let both = one.zip(other);
        let estimate = both.and_then(|(one, other)| Estimate::of([&one, &other], combine));
        Self::ratio(what.into(), limit, estimate, found)
    }

    /// A count that needs no interval: it is of the whole stream.
    fn counted(what: &str, promised: &str, found: Option<(String, bool)>) -> Self {
        let outcome = match found {
            Some((_, true)) => Outcome::Judged(Verdict::Met),
            Some((_, false)) => Outcome::Judged(Verdict::Missed),
            None => Outcome::NotMeasured,
        };
        let found = found.map_or_else(String::new, |(found, _)| found);
        Self {
            what: what.to_owned(),
            promised: promised.to_owned(),
            found,
            interval: None,
            outcome,
        }
    }
}

/// A bridged way over its parts: bridge, ZeroMQ hop, DDS hop, base64.
pub(crate) fn bridged(results: &Results, way: Way, kind: Kind) -> Option<Estimate<4>> {
    let [bridge, zmq, dds] = [way, RawZmq, RawDds].map(|way| results.halves(way, kind));
    let code = if matches!(way, ZmqToRos | RelayToRos) { "decode" } else { "encode" };
    let none: Series = (1..=results.rounds).map(|round| (round, 0.0)).collect();
    let base64 = match kind {
        VgaRgb => results.figure_rounds(&format!("base64-simd {code} 640x480 RGB"))?,
        Kind::FullHdRgb => results.figure_rounds(&format!("base64-simd {code} 1080p RGB"))?,
        _ => &none,
    };
    Estimate::of([&bridge?, &zmq?, &dds?, base64], |[bridge, zmq, dds, base64]| {
        bridge / (zmq + dds + base64)
    })
}

/// The minimal relay the same way.
pub(crate) fn relay_of(way: Way) -> Way {
    if way == ZmqToRos { RelayToRos } else { RelayToZmq }
}

/// A bridged way over its minimal relay.
pub(crate) fn over_relay(results: &Results, way: Way, kind: Kind) -> Option<Estimate<2>> {
    let (bridge, relay) = (results.halves(way, kind)?, results.halves(relay_of(way), kind)?);
    Estimate::of([&bridge, &relay], |[bridge, relay]| bridge / relay)
}

/// A ratio.
fn over([above, below]: [f64; 2]) -> f64 {
    above / below
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
        hops(results, way, kind, limit, &mut targets);
    }
    coding(results, &mut targets);
    for (kind, least) in [(U8Rgb200, 4.0), (VgaJpeg, 1.0)] {
        targets.push(Target::two(
            format!("one hop of a {}, p50, Python against us", kind.title()),
            Some(Limit::AtLeast(least)),
            [PythonHop, RustHop].map(|way| results.halves(way, kind)),
            over,
            |[python, ours]| format!("{python:.0} / {ours:.0} us"),
        ));
    }
    trips(results, &mut targets);
    registered(results, &mut targets);
    asked(results, &mut targets);
    joint_state(results, &mut targets);
    ros1::check(results, &mut targets);
    stream(results, &mut targets);
    to_fast_dds(results, &mut targets);
    rest(results, &mut targets);
    many(results, &mut targets);
    yarp::check(results, &mut targets);
    targets
}

/// A bridged way: what was promised of it, and its minimal relay.
fn hops(results: &Results, way: Way, kind: Kind, limit: f64, targets: &mut Vec<Target>) {
    let parts = if kind == VgaRgb { "raw hops + base64" } else { "raw hops" };
    let found = |[whole, zmq, dds, base64]: [f64; 4]| {
        if kind == VgaRgb {
            format!("{whole:.0} / ({zmq:.0} + {dds:.0} + {base64:.0}) us")
        } else {
            format!("{whole:.0} / ({zmq:.0} + {dds:.0}) us")
        }
    };
    targets.push(Target::ratio(
        format!("{}, {}, p50 against {parts}", way.title(), kind.title()),
        Some(Limit::AtMost(limit)),
        bridged(results, way, kind),
        found,
    ));
    targets.push(Target::ratio(
        format!("└ of this: minimal relay against {parts}"),
        None,
        bridged(results, relay_of(way), kind),
        found,
    ));
    targets.push(Target::ratio(
        "└ of this: bridge against minimal relay".to_owned(),
        None,
        over_relay(results, way, kind),
        |[bridge, relay]| format!("{bridge:.0} / {relay:.0} us"),
    ));
}

/// Coding without a transport: speed and memory.
fn coding(results: &Results, targets: &mut Vec<Target>) {
    let figure = |name: &str| results.figure_rounds(name).cloned();
    let micros = |[ours, alone]: [f64; 2]| format!("{ours:.0} / {alone:.0} us");
    for (what, ours, alone, limit) in
        [("encode", ENCODE, ENCODE_ALONE, 1.3), ("decode", DECODE, DECODE_ALONE, 1.5)]
    {
        targets.push(Target::two(
            format!("{what} a {}, against base64-simd alone on its text", F32Mib.title()),
            Some(Limit::AtMost(limit)),
            [ours, alone].map(figure),
            over,
            micros,
        ));
        targets.push(Target::two(
            "└ the same against memcpy of the text",
            None,
            [ours, MEMCPY].map(figure),
            over,
            micros,
        ));
    }
    let (encode, decode) = results.python_rounds(F32Mib).unzip();
    for (what, python, ours) in [("encode", encode, ENCODE), ("decode", decode, DECODE)] {
        targets.push(Target::two(
            format!("{what} a {}, Python against us", F32Mib.title()),
            Some(Limit::AtLeast(10.0)),
            [python, figure(ours)],
            over,
            micros,
        ));
    }
    let all = results.python_rounds(U8Rgb200).zip(results.our_rounds(U8Rgb200));
    targets.push(Target::ratio(
        format!("coding of a {}, Python against us", U8Rgb200.title()),
        Some(Limit::AtLeast(10.0)),
        all.and_then(|((pe, pd), (oe, od))| {
            Estimate::of([&pe, &pd, oe, od], |[pe, pd, oe, od]| (pe + pd) / (oe + od))
        }),
        |[pe, pd, oe, od]| format!("{:.0} / {:.0} us", pe + pd, oe + od),
    ));
    let (encode, decode) = results.python_rounds(VgaJpeg).unzip();
    let (our_encode, our_decode) = results.our_rounds(VgaJpeg).unzip();
    for (what, python, ours) in
        [("pixels into", encode, our_encode), ("pixels out of", decode, our_decode)]
    {
        targets.push(Target::two(
            format!("{what} a {}, Python (OpenCV) against us", VgaJpeg.title()),
            Some(Limit::AtLeast(1.0)),
            [python, ours.cloned()],
            over,
            micros,
        ));
    }
    for (what, grown) in [("encode", ENCODE_MEMORY), ("decode", DECODE_MEMORY)] {
        targets.push(Target::two(
            format!("{what} an array of 100 MiB: peak memory, array and text in it, over the text"),
            Some(Limit::AtMost(2.5)),
            [grown, ARRAY_TEXT].map(figure),
            over,
            |[grown, text]| format!("{grown:.0} / {text:.0} MiB"),
        ));
    }
}

/// Calls of services over bare round trips.
fn trips(results: &Results, targets: &mut Vec<Target>) {
    for (service, raw, load) in [
        (TripWay::Cyclone, TripWay::RawCyclone, Load::AddTwoInts),
        (TripWay::Cyclone, TripWay::RawCyclone, Load::Text64k),
        (TripWay::Fastdds, TripWay::RawRustdds, Load::AddTwoInts),
    ] {
        targets.push(Target::two(
            format!("{}, {}, p50 against {}", service.title(), load.title(), raw.title()),
            Some(Limit::AtMost(2.0)),
            [service, raw].map(|way| results.times(&Trip { load, way }.name(), 0.5)),
            over,
            |[whole, raw]| format!("{whole:.0} / {raw:.0} us"),
        ));
    }
}

/// Registered methods above the method itself and above the raw endpoint.
fn registered(results: &Results, targets: &mut Vec<Target>) {
    let figures =
        |above: &str, below: &str| [above, below].map(|name| results.figure_rounds(name).cloned());
    for (what, above, limit) in [
        (
            "a registered call that publishes a small value, nobody listens: us above the method",
            registered::UNHEARD,
            Some(Limit::AtMost(1.0)),
        ),
        ("└ the same in mode none", registered::NONE, None),
    ] {
        targets.push(Target::two(
            what,
            limit,
            figures(above, registered::METHOD),
            |[above, below]| above - below,
            |[above, below]| format!("{above:.3} - {below:.3} us"),
        ));
    }
    for (what, above, below, limit) in [
        (
            "registered publish and listen of a small object over ZeroMQ, against raw endpoints",
            registered::ZMQ,
            registered::RAW_ZMQ,
            Some(Limit::AtMost(1.05)),
        ),
        ("└ the same in memory", registered::SMALL, registered::RAW_SMALL, None),
        ("└ 640x480 RGB in memory", registered::FRAME, registered::RAW_FRAME, None),
    ] {
        targets.push(Target::two(what, limit, figures(above, below), over, |[above, below]| {
            format!("{above:.2} / {below:.2} us")
        }));
    }
}

/// Calls of a registered method that returns an image.
fn asked(results: &Results, targets: &mut Vec<Target>) {
    let call = |ask: Asked| results.times(ask.name(), 0.5);
    targets.push(Target::two(
        "640x480 RGB by request and reply over ZeroMQ, p50, Python's peers against ours",
        Some(Limit::AtLeast(100.0)),
        [Asked::Python, Asked::Ours].map(call),
        over,
        |[python, ours]| format!("{python:.0} / {ours:.0} us"),
    ));
    let server = results.of_legs(Asked::Mixed.name(), |leg| Some(leg.calls.middle_us));
    targets.push(Target::two(
        "the same, Python's client and our server: percent of the call that our server takes",
        Some(Limit::AtMost(5.0)),
        [server, call(Asked::Mixed)],
        |[server, call]| server / call * 100.0,
        |[server, call]| format!("{server:.0} of {call:.0} us"),
    ));
}

/// Messages of a type known at run time.
fn joint_state(results: &Results, targets: &mut Vec<Target>) {
    let share = |[micros]: [f64; 1]| micros * dynamic::RATE / 1e6 * 100.0;
    targets.push(Target::ratio(
        "10 000 dynamic decodes a second of a JointState (12 joints, 628 bytes): percent of a core"
            .to_owned(),
        Some(Limit::AtMost(5.0)),
        results.figure_rounds(dynamic::DECODE).and_then(|decode| Estimate::of([decode], share)),
        |[decode]| format!("{decode:.2} us each"),
    ));
}

/// A bridge among foreign endpoints.
fn rest(results: &Results, targets: &mut Vec<Target>) {
    targets.push(Target::counted(
        "bridge with one open route, at rest among 500 foreign endpoints: share of a core",
        "less than 5 %",
        results.rest.map(|rest| {
            let Rest { seconds, endpoints, alone, among, .. } = rest;
            let found =
                format!("{among:.2} % with {endpoints}, {alone:.2} % without, {seconds} s each");
            (found, among < 5.0)
        }),
    ));
}

/// A bridge of a thousand routes.
fn many(results: &Results, targets: &mut Vec<Target>) {
    let mut target = |what: &str, limit: &str, judge: fn(Many) -> (String, bool)| {
        let name = format!("1000 idle routes, ZeroMQ to ROS 2: {what}");
        targets.push(Target::counted(&name, limit, results.many.map(judge)));
    };
    target("all open, from the start of the program", "within 3 s", |many| {
        (format!("{:.0} ms", many.opening_ms), many.opening_ms <= 3000.0)
    });
    target("share of a core", "less than 3 %", |many| {
        (format!("{:.2} % over {} s", many.share, many.seconds), many.share < 3.0)
    });
    target("threads and memory", "at most 64, less than 200 MiB", |many| {
        let Many { threads, rss_mib, .. } = many;
        (format!("{threads}, {rss_mib:.0} MiB"), threads <= 64 && rss_mib < 200.0)
    });
    target(
        "reload of one, until it is open again",
        "less than 100 ms, none lost on others",
        |many| {
            let Many { reload_ms, sent, lost, .. } = many;
            (format!("{reload_ms:.0} ms, {lost} of {sent} lost"), reload_ms < 100.0 && lost == 0)
        },
    );
}

/// Frames into a reader on Fast DDS.
fn to_fast_dds(results: &Results, targets: &mut Vec<Target>) {
    targets.push(Target::counted(
        "640x480 RGB at 30 Hz, ZeroMQ to ROS 2, reliable, into a Fast DDS reader of depth 5: gaps",
        "none",
        results.fast.as_ref().map(|stream| {
            let (gaps, dropped, seconds) = (stream.gaps(), stream.dropped, stream.seconds);
            let (sent, twice) = (stream.report.sent, stream.report.duplicates);
            let found = format!(
                "{gaps} missing, {twice} twice, of {sent} in {seconds} s; {dropped} datagrams dropped"
            );
            (found, gaps == 0 && twice == 0)
        }),
    ));
}

/// The stream: losses, and growth of memory.
fn stream(results: &Results, targets: &mut Vec<Target>) {
    let soak = results.soak.as_ref();
    targets.push(Target::counted(
        "1080p RGB at 30 Hz, ZeroMQ to ROS 2, reliable: losses",
        "none",
        soak.map(|soak| {
            let (report, seconds) = (&soak.report, soak.seconds);
            let lost = report.sent + report.refused - report.received;
            let (sent, twice) = (report.sent, report.duplicates);
            let found = format!("{lost} lost, {twice} twice, of {sent} in {seconds} s");
            (found, lost == 0 && twice == 0)
        }),
    ));
    let growth = soak
        .and_then(|soak| soak.memory.iter().find(|(name, ..)| *name == "bridge"))
        .map(|(_, _, growth)| *growth);
    targets.push(Target::counted(
        "the same: growth of the bridge's memory",
        "less than 1 MiB a minute",
        growth.map(|growth| (format!("{growth:+.2} MiB a minute"), growth < 1.0)),
    ));
}
