//! ROS 1 in `RESULTS.md`.

use std::fmt::Write as _;

use crate::results::Results;
use crate::stats::{median, quantile};
use crate::tcpros::{Hop, Way};

/// Messages one by one, images by hundreds, and two streams together.
pub(super) fn tables(text: &mut String, results: &Results) {
    text.push_str(
        "\n## ROS 1\n\n\
         A text of 200 bytes at 1000 Hz from due to arrived, or an image of a batch. p50: median of the rounds'\n\
         medians, with their range; p99: of all of them, batches for images. CPU microseconds of both ends\n\
         for a message.\n\n\
         | way | p50 | range of rounds | p99 | rounds | messages | lost | CPU of the ends |\n\
         | --- | --- | --- | --- | --- | --- | --- | --- |\n",
    );
    for hop in Hop::ALL {
        let (Some(legs), Some(halves)) = (results.hops(hop), results.hop_rounds(hop, 0.5)) else {
            continue;
        };
        let halves: Vec<f64> = halves.into_values().collect();
        let reports = legs.values().map(|leg| &leg.calls.report);
        let all: Vec<f64> = reports.clone().flat_map(|one| one.latency_us.clone()).collect();
        let sent: u32 = reports.clone().map(|report| report.sent + report.refused).sum();
        let received: u32 = reports.map(|report| report.received).sum();
        let cpu: Vec<f64> = legs.values().map(|leg| leg.calls.cpu_us).collect();
        let of = |values: &[f64], fraction| quantile(values, fraction).unwrap_or(f64::NAN);
        let middle = |values: &[f64]| median(values).unwrap_or(f64::NAN);
        _ = writeln!(
            text,
            "| {} | {:.1} | {:.1} to {:.1} | {:.1} | {} | {received} | {} | {:.1} |",
            hop.name(),
            middle(&halves),
            of(&halves, 0.0),
            of(&halves, 1.0),
            of(&all, 0.99),
            halves.len(),
            sent.saturating_sub(received),
            middle(&cpu)
        );
    }
    streams(text, results);
}

fn streams(text: &mut String, results: &Results) {
    let mut begun = false;
    for way in Way::ALL {
        let Some(streams) = results.streams_of(way) else { continue };
        if !begun {
            _ = writeln!(
                text,
                "\nTwo streams together for {} s:\n\n\
                 | way | stream | sent | refused | arrived | twice | p50 | p99 | highest |\n\
                 | --- | --- | --- | --- | --- | --- | --- | --- | --- |",
                streams.seconds
            );
            begun = true;
        }
        for (load, report) in &streams.reports {
            let q = |fraction| quantile(&report.latency_us, fraction).unwrap_or(f64::NAN);
            _ = writeln!(
                text,
                "| {} | {} | {} | {} | {} | {} | {:.0} | {:.0} | {:.0} |",
                way.title(),
                load.title(),
                report.sent,
                report.refused,
                report.received,
                report.duplicates,
                q(0.5),
                q(0.99),
                q(1.0)
            );
        }
    }
}
