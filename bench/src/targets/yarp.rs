//! What was promised of YARP's ports, beside bare sockets.

use super::Target;
use crate::estimate::{Estimate, Limit};
use crate::results::Results;
use crate::yarp::Load::{Bottle1k, VgaRgb};
use crate::yarp::Way::{Blocking, Data, FastTcp, Queue, Tcp, Tokio};
use crate::yarp::{Ports, Ride};

/// All of them.
pub(super) fn check(results: &Results, targets: &mut Vec<Target>) {
    let halves = |way, load| results.ride_halves(Ride { load, way });
    for (ours, bare, limit) in [
        (FastTcp, Tokio, Some(Limit::AtMost(1.5))),
        (FastTcp, Blocking, Some(Limit::AtMost(3.0))),
        (Queue, Tokio, None),
        (Data, Tokio, None),
        (Tcp, Tokio, None),
    ] {
        let what = if ours == FastTcp {
            "YARP request and reply over fast_tcp, a bottle with 1 KiB of text, p50"
        } else {
            "└ of this:"
        };
        let way = if ours == FastTcp { "" } else { ours.title() };
        targets.push(Target::ratio(
            format!("{what} {way} against {}", bare.title()).replace("  ", " "),
            limit,
            halves(ours, Bottle1k)
                .zip(halves(bare, Bottle1k))
                .and_then(|(ours, bare)| Estimate::of([&ours, &bare], |[ours, bare]| ours / bare)),
            |[ours, bare]| format!("{ours:.1} / {bare:.1} us"),
        ));
    }
    let rate = |micros: f64| 1e6 / micros;
    for (ours, what, limit) in [
        (
            FastTcp,
            "YARP stream of 640x480 RGB over fast_tcp, port to port, against a tokio reader into one \
             buffer: images a second",
            Some(Limit::AtLeast(0.85)),
        ),
        (Tcp, "└ the same over tcp, with acknowledgements", None),
    ] {
        targets.push(Target::ratio(
            what.to_owned(),
            limit,
            halves(ours, VgaRgb)
                .zip(halves(Tokio, VgaRgb))
                .and_then(|(ours, bare)| Estimate::of([&ours, &bare], |[ours, bare]| bare / ours)),
            |[ours, bare]| format!("{:.0} / {:.0}", rate(ours), rate(bare)),
        ));
    }
    targets.push(Target::counted(
        "200 YARP ports, connected and silent: share of a core",
        "less than 1 %",
        results.ports.map(|ports| {
            let Ports { ports, share, seconds, .. } = ports;
            (format!("{share:.2} % with {ports}, {seconds} s"), ports >= 200 && share < 1.0)
        }),
    ));
}
