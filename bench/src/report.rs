//! `RESULTS.md`.

use std::fmt::Write as _;

use anyhow::Result;

use crate::asked::Asked;
use crate::case::Way;
use crate::crowd::Rest;
use crate::estimate::Verdict;
use crate::fast;
use crate::machine;
use crate::payload::Kind;
use crate::results::{Results, Summary};
use crate::soak::Soak;
use crate::stats::{FEWEST, RESAMPLES, median, quantile};
use crate::targets::{Outcome, Target, bridged, over_relay, relay_of};
use crate::tcpros::{self, Hop};
use crate::trip::{Leg, Trip};
use crate::turn::sizes;
use crate::worker::Report;
use crate::yarp::{Ports, Ride};

const KINDS: [Kind; 7] = [
    Kind::Small,
    Kind::Audio,
    Kind::U8Rgb200,
    Kind::VgaJpeg,
    Kind::F32Mib,
    Kind::VgaRgb,
    Kind::FullHdRgb,
];

/// Text of the whole report.
pub(crate) fn write(results: &Results, targets: &[Target]) -> Result<String> {
    let mut text = String::from(
        "# Results\n\n\
         Written by `make bench`; how it measures: [README.md](README.md). Every figure of every round:\n\
         [results.csv](results.csv). Times are microseconds. Compare ratios, and only within one run.\n\n\
         ![Latency of raw hops, bridge and Python Wrapyfi](plot.svg)\n",
    );
    machine_table(&mut text, results);
    _ = writeln!(
        text,
        "\n## Targets\n\n\
         The interval is where the ratio lies with a probability of 95 %: percentile bootstrap, whole rounds\n\
         drawn with replacement {RESAMPLES} times, from a fixed seed. The interval decides: met or missed where\n\
         all of it is on one side of what was promised, undecided where the limit is inside, or where there\n\
         are fewer than {FEWEST} rounds. What has no promise explains the line above it and decides nothing.\n\n\
         {}",
        target_table(targets)
    );
    bridge_table(&mut text, results);
    library_tables(&mut text, results);
    latency_table(&mut text, results);
    cost_table(&mut text, results);
    ends_table(&mut text, results);
    streams(&mut text, results);
    if let Some(found) = &results.rest {
        rest(&mut text, found);
    }
    if let Some(found) = &results.ports {
        ports(&mut text, found);
    }
    limits(&mut text, results);
    size_table(&mut text)?;
    if !results.failures.is_empty() {
        text.push_str("\n## Turns that failed\n\n");
        for failure in &results.failures {
            _ = writeln!(text, "* {}", failure.replace('\n', " "));
        }
    }
    Ok(text)
}

fn machine_table(text: &mut String, results: &Results) {
    text.push_str("\n## Machine\n\n| | |\n| --- | --- |\n");
    for (name, value) in machine::describe() {
        _ = writeln!(text, "| {name} | {value} |");
    }
    let loads: Vec<String> = results.loads.iter().map(|load| format!("{load:.1}")).collect();
    _ = writeln!(text, "| Rounds | {} |", results.rounds);
    _ = writeln!(
        text,
        "| Load average at their starts, this run's own included | {} |",
        loads.join(", ")
    );
}

/// The promises, as a table.
pub(crate) fn target_table(targets: &[Target]) -> String {
    let mut text = String::from(
        "| target | promised | found | 95 % interval | |\n| --- | --- | --- | --- | --- |\n",
    );
    for Target { what, promised, found, interval, outcome } in targets {
        let verdict = match outcome {
            Outcome::Judged(Verdict::Met) => "met",
            Outcome::Judged(Verdict::Missed) => "**missed**",
            Outcome::Judged(Verdict::Undecided) => "**undecided**",
            Outcome::Shown => "",
            Outcome::NotMeasured => "not measured",
        };
        let interval =
            interval.map_or_else(String::new, |(low, high)| format!("{low:.2} to {high:.2}"));
        _ = writeln!(text, "| {what} | {promised} | {found} | {interval} | {verdict} |");
    }
    text
}

fn bridge_table(text: &mut String, results: &Results) {
    text.push_str(
        "\n## What the bridge adds\n\n\
         Median latency from source to sink process. Parts: the raw ZeroMQ hop through our broker, the\n\
         raw CycloneDDS hop, and base64 where the payload needs it, all at the same size and measured in\n\
         the same rounds. The parts count twice what a way has once (the source wakes up, the sink wakes\n\
         up), so a ratio may be below 1; on the other hand two hops in one chain wake more threads than two\n\
         hops apart, so it may be above 1 before anything of ours runs. The minimal relay shows how much: one\n\
         thread between the same ends that does nothing but what must be done.\n\n\
         | payload | direction | raw ZeroMQ | raw DDS | base64 | parts | bridge | bridge / parts | minimal relay | relay / parts | bridge / relay |\n\
         | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n",
    );
    for kind in KINDS {
        for way in [Way::ZmqToRos, Way::RosToZmq] {
            let Some(whole) = bridged(results, way, kind) else { continue };
            let [bridge, zmq, dds, base64] = whole.parts;
            let relay = over_relay(results, way, kind);
            let of_parts = bridged(results, relay_of(way), kind);
            let direction = if way == Way::ZmqToRos { "to ROS 2" } else { "to ZeroMQ" };
            _ = writeln!(
                text,
                "| {} | {direction} | {zmq:.0} | {dds:.0} | {base64:.0} | {:.0} | {bridge:.0} | {:.2} | {} |",
                kind.title(),
                zmq + dds + base64,
                whole.value,
                relay.zip(of_parts).map_or("- | - | -".to_owned(), |(ours, least)| {
                    let [_, relay] = ours.parts;
                    format!("{relay:.0} | {:.2} | {:.2}", least.value, ours.value)
                })
            );
        }
    }
}

fn library_tables(text: &mut String, results: &Results) {
    text.push_str("\n## Against Python Wrapyfi\n\n");
    if let Some(reason) = &results.no_python {
        _ = writeln!(text, "Not measured: {reason}.\n");
    }
    text.push_str(
        "Median latency from the call of publish to the decoded value, coding included. Python runs with\n\
         its own broker, ours with ours. A JPEG is pixels at both ends; our forwarder passes the file on,\n\
         where Python's, having no other way, decompresses and compresses it again.\n\n\
         | payload | one hop: Python | ours | times | forwarded: Python | ours | times |\n\
         | --- | --- | --- | --- | --- | --- | --- |\n",
    );
    let cell = |value: Option<f64>| value.map_or("-".to_owned(), |value| format!("{value:.0}"));
    let times = |a: Option<f64>, b: Option<f64>| {
        a.zip(b).map_or("-".to_owned(), |(a, b)| format!("{:.1} x", a / b))
    };
    for kind in KINDS {
        let half = |way| results.summary(way, kind).map(|summary| summary.p50);
        let [python, ours] = [half(Way::PythonHop), half(Way::RustHop)];
        let [python_two, ours_two] = [half(Way::PythonForward), half(Way::RustForward)];
        _ = writeln!(
            text,
            "| {} | {} | {} | {} | {} | {} | {} |",
            kind.title(),
            cell(python),
            cell(ours),
            times(python, ours),
            cell(python_two),
            cell(ours_two),
            times(python_two, ours_two)
        );
    }
    text.push_str(
        "\nCoding alone, one thread, no transport (ours: a whole message of frames; JPEG from pixels and to pixels):\n\n\
         | payload | encode: Python | ours | times | decode: Python | ours | times |\n\
         | --- | --- | --- | --- | --- | --- | --- |\n",
    );
    for kind in KINDS {
        let (python, ours) = (results.python_coding(kind), results.our_coding(kind));
        let (encode, decode) = (python.map(|c| c.0), python.map(|c| c.1));
        let (our_encode, our_decode) = (ours.map(|c| c.0), ours.map(|c| c.1));
        if our_encode.is_none() {
            continue;
        }
        let micros = |value: Option<f64>| value.map_or("-".to_owned(), |v| format!("{v:.1}"));
        _ = writeln!(
            text,
            "| {} | {} | {} | {} | {} | {} | {} |",
            kind.title(),
            micros(encode),
            micros(our_encode),
            times(encode, our_encode),
            micros(decode),
            micros(our_decode),
            times(decode, our_decode)
        );
    }
}

/// Every case that was measured, with its summary.
fn all(results: &Results) -> Vec<(Way, Kind, Summary)> {
    results
        .cases()
        .filter_map(|case| Some((case.way, case.payload, results.summary(case.way, case.payload)?)))
        .collect()
}

fn latency_table(text: &mut String, results: &Results) {
    text.push_str(
        "\n## Latency and delivery\n\n\
         Fixed rate, latency from the time a message was due. p50: median of the rounds' medians, with\n\
         their range; p99: of all messages of all rounds. Lost and twice also count the messages sent at\n\
         full rate. Warm-up, not counted elsewhere: time until something arrived, and the median of the\n\
         first messages.\n\n\
         | way | payload | p50 | range of rounds | p99 | rounds | messages | lost | twice | opening ms | warm-up p50 |\n\
         | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n",
    );
    for (way, kind, s) in all(results) {
        _ = writeln!(
            text,
            "| {} | {} | {:.0} | {:.0} to {:.0} | {:.0} | {} | {} | {} | {} | {:.0} | {:.0} |",
            way.title(),
            kind.title(),
            s.p50,
            s.p50_range.0,
            s.p50_range.1,
            s.p99,
            s.rounds,
            s.messages,
            s.lost,
            s.duplicates,
            s.opening_ms,
            s.warm
        );
    }
}

fn cost_table(text: &mut String, results: &Results) {
    text.push_str(
        "\n## Throughput, CPU, memory\n\n\
         Rate with at most four messages under way. CPU microseconds a message at the fixed rate: all\n\
         processes, and those between the ends (broker, bridge or forwarder). Python's listeners never\n\
         sleep, which is in their CPU. Resident memory in MiB at the end of a turn.\n\n\
         | way | payload | messages/s | CPU all | CPU between | RSS all | RSS between |\n\
         | --- | --- | --- | --- | --- | --- | --- |\n",
    );
    for (way, kind, s) in all(results) {
        _ = writeln!(
            text,
            "| {} | {} | {:.0} | {:.0} | {:.0} | {:.0} | {:.0} |",
            way.title(),
            kind.title(),
            s.rate,
            s.cpu_us,
            s.middle_us,
            s.rss_mib,
            s.middle_rss_mib
        );
    }
}

/// Everything with two ends, one row each.
fn ends_table(text: &mut String, results: &Results) {
    text.push_str(
        "\n## There and back, and streams\n\n\
         Services and registered methods are called one at a time; who waits sleeps, and raw ways carry as many\n\
         bytes as the service puts on the wire. A call of a registered method goes from arguments to an image\n\
         that can be used: our peers exchange pixels as they are, Python's decimal text. Images go one way, a\n\
         batch at a time. p50: median of the rounds' medians, with their range; p99: of all, of batches for\n\
         images. CPU microseconds of both ends for a message, and of the end that answers where it was told\n\
         apart, its broker included. Opening: start to first answer.\n\n\
         | way | load | p50 | range of rounds | p99 | rounds | messages | lost | CPU | CPU of far | opening ms |\n\
         | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n",
    );
    let trips = Trip::ALL.map(|trip| (trip.name(), (trip.way.title(), trip.load.title())));
    let asked =
        Asked::ALL.map(|ask| (ask.name().to_owned(), (ask.title(), "640x480 RGB, returned")));
    let rides = Ride::ALL.map(|ride| (ride.name(), (ride.way.title(), ride.load.title())));
    let hops = Hop::ALL.map(|hop| (hop.name(), hop.titles()));
    for (name, (way, load)) in trips.into_iter().chain(asked).chain(rides).chain(hops) {
        let Some(legs) = results.legs(&name) else { continue };
        let over = |figure: &dyn Fn(&Leg) -> f64| legs.values().map(figure).collect::<Vec<_>>();
        let of = |values: &[f64], fraction| quantile(values, fraction).unwrap_or(f64::NAN);
        let middle = |values: &[f64]| median(values).unwrap_or(f64::NAN);
        let halves = over(&|leg| of(&leg.calls.report.latency_us, 0.5));
        let reports = || legs.values().map(|leg| &leg.calls.report);
        let all: Vec<f64> = reports().flat_map(|one| one.latency_us.clone()).collect();
        let sent: u32 = reports().map(|report| report.sent + report.refused).sum();
        let received: u32 = reports().map(|report| report.received).sum();
        let cpu = |figure: &dyn Fn(&Leg) -> f64| match middle(&over(figure)) {
            told if told > 0.0 => format!("{told:.1}"),
            _ => "-".to_owned(),
        };
        _ = writeln!(
            text,
            "| {way} | {load} | {:.1} | {:.1} to {:.1} | {:.1} | {} | {received} | {} | {} | {} | {:.0} |",
            middle(&halves),
            of(&halves, 0.0),
            of(&halves, 1.0),
            of(&all, 0.99),
            halves.len(),
            sent.saturating_sub(received),
            cpu(&|leg| leg.calls.cpu_us),
            cpu(&|leg| leg.calls.middle_us),
            middle(&over(&Leg::opening_ms))
        );
    }
}

/// Streams of a minute, and what became of them.
fn streams(text: &mut String, results: &Results) {
    let mut rows = Vec::new();
    if let Some(Soak { seconds, report, .. }) = &results.soak {
        rows.push(("ZeroMQ to ROS 2", "1080p RGB at 30 Hz", *seconds, report));
    }
    if let Some(fast::Stream { seconds, report, .. }) = &results.fast {
        rows.push(("ZeroMQ to a Fast DDS reader", "640x480 RGB at 30 Hz", *seconds, report));
    }
    for way in tcpros::Way::ALL {
        for (load, report) in results.streams_of(way).iter().flat_map(|found| &found.reports) {
            let seconds = results.streams_of(way).map_or(0, |found| found.seconds);
            rows.push((way.title(), load.title(), seconds, report));
        }
    }
    if rows.is_empty() {
        return;
    }
    text.push_str(
        "\n## Streams\n\n\
         All reliable; those of ROS 1 run two together. The reader on Fast DDS is a C++ program with a history of 5.\n\n\
         | way | stream | seconds | sent | refused | arrived | twice | p50 | p99 | highest |\n\
         | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n",
    );
    for (way, load, seconds, report) in rows {
        let q = |fraction| quantile(&report.latency_us, fraction).unwrap_or(f64::NAN);
        let Report { sent, refused, received, duplicates, .. } = report;
        let times = format!("{:.0} | {:.0} | {:.0}", q(0.5), q(0.99), q(1.0));
        _ = writeln!(
            text,
            "| {way} | {load} | {seconds} | {sent} | {refused} | {received} | {duplicates} | {times} |"
        );
    }
    if let Some(fast::Stream { dropped, rmem_default, .. }) = &results.fast {
        _ = writeln!(
            text,
            "\nThe kernel's receive buffer of {rmem_default} bytes had no room for {dropped} datagrams to Fast DDS."
        );
    }
    if let Some(Soak { settle, memory, .. }) = &results.soak {
        _ = writeln!(
            text,
            "\nMemory during the first, growth by least squares from second {settle} on:\n\n\
             | process | RSS MiB at the end | growth MiB a minute |\n| --- | --- | --- |"
        );
        for (name, last, growth) in memory {
            _ = writeln!(text, "| {name} | {last:.1} | {growth:+.2} |");
        }
    }
}

fn rest(text: &mut String, rest: &Rest) {
    let Rest { seconds, endpoints, alone, among, meeting_ms, grown_mib } = rest;
    _ = writeln!(
        text,
        "\n## A bridge at rest among {endpoints} foreign endpoints\n\n\
         One route, open and silent. Share of a core over {seconds} s: {alone:.2} % before they came, \
         {among:.2} % with them there. Getting to know them took the bridge {meeting_ms:.0} ms of CPU and \
         {grown_mib:.2} MiB of memory."
    );
}

fn ports(text: &mut String, found: &Ports) {
    let Ports { ports, share, seconds, opening_ms, rss_mib } = found;
    _ = writeln!(
        text,
        "\n## YARP ports at rest\n\n{ports} ports of one process, connected in pairs over tcp and silent: {share:.2} % of a core over \
         {seconds} s, {rss_mib:.1} MiB resident. Opening, registering and connecting all of them took \
         {opening_ms:.0} ms."
    );
}

fn limits(text: &mut String, results: &Results) {
    text.push_str(
        "\n## What the machine can do\n\nMedians over the rounds, microseconds unless said.\n\n\
         | | |\n| --- | --- |\n",
    );
    for name in results.figures() {
        let value = results.figure(name).unwrap_or(f64::NAN);
        _ = writeln!(text, "| {name} | {value:.1} |");
    }
}

fn size_table(text: &mut String) -> Result<()> {
    text.push_str(
        "\n## Sizes\n\n| payload | ZeroMQ body, bytes | CDR, bytes |\n| --- | --- | --- |\n",
    );
    for kind in KINDS {
        let (body, cdr) = sizes(kind)?;
        _ = writeln!(text, "| {} | {body} | {cdr} |", kind.title());
    }
    Ok(())
}
