//! Promises about YARP's ports, beside bare sockets and libYARP.

use super::Target;
use crate::estimate::{Estimate, Limit};
use crate::results::Results;
use crate::yarp::Load::{Bottle1k, VgaRgb};
use crate::yarp::Way::{
    Blocking, Data, FastTcp, LibraryFastTcp, LibraryShmem, LibraryTcp, LibraryUnixStream, Queue,
    Tcp, Tokio, UnixStream,
};
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
    for (ours, theirs, what, limit) in [
        (
            Tcp,
            LibraryTcp,
            "YARP request and reply over tcp, a bottle with 1 KiB of text, p50 against libYARP",
            Some(Limit::AtMost(1.2)),
        ),
        (FastTcp, LibraryFastTcp, "└ the same over fast_tcp", None),
        (UnixStream, LibraryUnixStream, "└ the same over unix_stream", None),
        (UnixStream, Tcp, "└ ours over unix_stream against ours over tcp", None),
        (LibraryShmem, LibraryTcp, "└ libYARP over shmem against libYARP over tcp", None),
    ] {
        targets.push(Target::ratio(
            what.to_owned(),
            limit,
            halves(ours, Bottle1k)
                .zip(halves(theirs, Bottle1k))
                .and_then(|(ours, lib)| Estimate::of([&ours, &lib], |[ours, lib]| ours / lib)),
            |[ours, lib]| format!("{ours:.1} / {lib:.1} us"),
        ));
    }
    let rate = |micros: f64| 1e6 / micros;
    for (ours, other, what, limit) in [
        (
            FastTcp,
            Tokio,
            "YARP stream of 640x480 RGB over fast_tcp, port to port, against a tokio reader into one \
             buffer: images a second",
            Some(Limit::AtLeast(0.85)),
        ),
        (Tcp, Tokio, "└ the same over tcp, with acknowledgements", None),
        (
            Tcp,
            LibraryTcp,
            "YARP stream of 640x480 RGB over tcp, port to port, against libYARP: images a second",
            Some(Limit::AtLeast(1.0)),
        ),
        (FastTcp, LibraryFastTcp, "└ the same over fast_tcp", None),
        (UnixStream, LibraryUnixStream, "└ the same over unix_stream", None),
        (UnixStream, Tcp, "└ ours over unix_stream against ours over tcp", None),
        (LibraryShmem, LibraryTcp, "└ libYARP over shmem against libYARP over tcp", None),
    ] {
        targets.push(Target::ratio(
            what.to_owned(),
            limit,
            halves(ours, VgaRgb)
                .zip(halves(other, VgaRgb))
                .and_then(|(ours, one)| Estimate::of([&ours, &one], |[ours, one]| one / ours)),
            |[ours, one]| format!("{:.0} / {:.0}", rate(ours), rate(one)),
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
