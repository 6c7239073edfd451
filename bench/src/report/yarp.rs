//! YARP in `RESULTS.md`.

use std::fmt::Write as _;

use crate::results::Results;
use crate::stats::{median, quantile};
use crate::yarp::{Ports, Ride};

/// Round trips and streams, and what ports at rest take.
pub(super) fn tables(text: &mut String, results: &Results) {
    rides(text, results);
    if let Some(found) = &results.ports {
        ports(text, found);
    }
}

fn rides(text: &mut String, results: &Results) {
    text.push_str(
        "\n## YARP\n\n\
         A round trip, or an image of a batch. p50: median of the rounds' medians, with their range; p99: of\n\
         all of them, batches for images. CPU microseconds of both processes for a round trip or an image.\n\n\
         | way | load | p50 | range of rounds | p99 | rounds | messages | CPU |\n\
         | --- | --- | --- | --- | --- | --- | --- | --- |\n",
    );
    for ride in Ride::ALL {
        let (Some(legs), Some(halves)) = (results.rides(ride), results.ride_halves(ride)) else {
            continue;
        };
        let halves: Vec<f64> = halves.into_values().collect();
        let all: Vec<f64> =
            legs.values().flat_map(|leg| leg.calls.report.latency_us.clone()).collect();
        let cpu: Vec<f64> = legs.values().map(|leg| leg.calls.cpu_us).collect();
        let messages: u32 = legs.values().map(|leg| leg.calls.report.received).sum();
        let of = |values: &[f64], fraction| quantile(values, fraction).unwrap_or(f64::NAN);
        let middle = |values: &[f64]| median(values).unwrap_or(f64::NAN);
        _ = writeln!(
            text,
            "| {} | {} | {:.1} | {:.1} to {:.1} | {:.1} | {} | {messages} | {:.1} |",
            ride.way.title(),
            ride.load.title(),
            middle(&halves),
            of(&halves, 0.0),
            of(&halves, 1.0),
            of(&all, 0.99),
            halves.len(),
            middle(&cpu)
        );
    }
}

fn ports(text: &mut String, found: &Ports) {
    let Ports { ports, share, seconds, opening_ms, rss_mib } = found;
    _ = writeln!(
        text,
        "\n{ports} ports of one process, connected in pairs over tcp and silent: {share:.2} % of a core over \
         {seconds} s, {rss_mib:.1} MiB resident. Opening, registering and connecting all of them took \
         {opening_ms:.0} ms."
    );
}
