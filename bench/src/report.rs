//! `RESULTS.md`.

mod ros1;
mod yarp;

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
use crate::trip::Trip;
use crate::turn::sizes;

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
    trip_table(&mut text, results);
    asked_table(&mut text, results);
    if let Some(soak) = &results.soak {
        stream(&mut text, soak);
    }
    if let Some(found) = &results.fast {
        to_fast_dds(&mut text, found);
    }
    if let Some(found) = &results.rest {
        rest(&mut text, found);
    }
    yarp::tables(&mut text, results);
    ros1::tables(&mut text, results);
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

fn trip_table(text: &mut String, results: &Results) {
    text.push_str(
        "\n## Calls of services\n\n\
         Round trips one after the other, one under way at a time; who waits sleeps. Raw ways carry as many\n\
         bytes as the service puts on the wire. p50: median of the rounds' medians, with their range; p99: of\n\
         all calls. CPU microseconds a call, both processes. Opening: start to first answer.\n\n\
         | way | load | p50 | range of rounds | p99 | rounds | calls | CPU | opening ms |\n\
         | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n",
    );
    for trip in Trip::ALL {
        let (Some(legs), Some(halves)) = (results.legs(trip), results.trip_halves(trip)) else {
            continue;
        };
        let halves: Vec<f64> = halves.into_values().collect();
        let all: Vec<f64> =
            legs.values().flat_map(|leg| leg.calls.report.latency_us.clone()).collect();
        let cpu: Vec<f64> = legs.values().map(|leg| leg.calls.cpu_us).collect();
        #[allow(clippy::cast_precision_loss)]
        let opening: Vec<f64> = legs.values().map(|leg| leg.warm.opening_ns as f64 / 1e6).collect();
        let of = |values: &[f64], fraction| quantile(values, fraction).unwrap_or(f64::NAN);
        let middle = |values: &[f64]| median(values).unwrap_or(f64::NAN);
        _ = writeln!(
            text,
            "| {} | {} | {:.0} | {:.0} to {:.0} | {:.0} | {} | {} | {:.0} | {:.0} |",
            trip.way.title(),
            trip.load.title(),
            middle(&halves),
            of(&halves, 0.0),
            of(&halves, 1.0),
            of(&all, 0.99),
            halves.len(),
            all.len(),
            middle(&cpu),
            middle(&opening)
        );
    }
}

fn asked_table(text: &mut String, results: &Results) {
    text.push_str(
        "\n## Calls of a registered method that returns 640x480 RGB\n\n\
         Request and reply over ZeroMQ, one call under way at a time, from arguments to an image that can\n\
         be used. Our peers exchange pixels as they are, Python's decimal text. CPU microseconds a call of\n\
         the server's processes, its broker included.\n\n\
         | who | p50 | range of rounds | rounds | calls | server's CPU |\n\
         | --- | --- | --- | --- | --- | --- |\n",
    );
    for ask in Asked::ALL {
        let (Some(answers), Some((halves, used))) =
            (results.answers(ask), results.asked_rounds(ask))
        else {
            continue;
        };
        let halves: Vec<f64> = halves.into_values().collect();
        let used: Vec<f64> = used.into_values().collect();
        let calls: u32 = answers.values().map(|answers| answers.report.received).sum();
        let of = |values: &[f64], fraction| quantile(values, fraction).unwrap_or(f64::NAN);
        _ = writeln!(
            text,
            "| {} | {:.0} | {:.0} to {:.0} | {} | {calls} | {:.0} |",
            ask.title(),
            of(&halves, 0.5),
            of(&halves, 0.0),
            of(&halves, 1.0),
            halves.len(),
            of(&used, 0.5),
        );
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

fn stream(text: &mut String, soak: &Soak) {
    let Soak { seconds, settle, report, memory } = soak;
    let q = |fraction| crate::stats::quantile(&report.latency_us, fraction).unwrap_or(f64::NAN);
    _ = writeln!(
        text,
        "\n## 1080p RGB at 30 Hz for {seconds} s, ZeroMQ to ROS 2\n\n\
         {} sent, {} refused, {} arrived, {} twice; p50 {:.0}, p99 {:.0}, highest {:.0}. Memory, growth \
         by least squares from second {settle} on:\n\n\
         | process | RSS MiB at the end | growth MiB a minute |\n| --- | --- | --- |",
        report.sent,
        report.refused,
        report.received,
        report.duplicates,
        q(0.5),
        q(0.99),
        q(1.0)
    );
    for (name, last, growth) in memory {
        _ = writeln!(text, "| {name} | {last:.1} | {growth:+.2} |");
    }
}

fn to_fast_dds(text: &mut String, stream: &fast::Stream) {
    let fast::Stream { seconds, report, dropped, rmem_default } = stream;
    let q = |fraction| quantile(&report.latency_us, fraction).unwrap_or(f64::NAN);
    _ = writeln!(
        text,
        "\n## 640x480 RGB at 30 Hz for {seconds} s into a Fast DDS reader\n\n\
         Through the bridge, reliable, into a C++ program on Fast DDS with a history of 5 and the kernel's \
         receive buffer ({rmem_default} bytes): {} sent, {} refused, {} arrived, {} twice; {dropped} datagrams \
         found no room. p50 {:.0}, p99 {:.0}, highest {:.0}.",
        report.sent,
        report.refused,
        report.received,
        report.duplicates,
        q(0.5),
        q(0.99),
        q(1.0)
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
