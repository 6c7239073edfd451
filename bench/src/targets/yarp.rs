//! Promises about YARP's ports, beside bare sockets and libYARP.

use super::{Target, over};
use crate::estimate::Limit;
use crate::results::Results;
use crate::yarp::Load::{Bottle1k, VgaRgb};
use crate::yarp::Way::{
    Blocking, Data, FastTcp, LibraryFastTcp, LibraryShmem, LibraryTcp, LibraryUnixStream, Queue,
    Tcp, Tokio, UnixStream,
};
use crate::yarp::{Ports, Ride};

/// All of them.
pub(super) fn check(results: &Results, targets: &mut Vec<Target>) {
    let times = |way, load| results.times(&Ride { load, way }.name(), 0.5);
    for (ours, other, what, limit) in [
        (
            FastTcp,
            Tokio,
            "YARP request and reply over fast_tcp, a bottle with 1 KiB of text, p50 against bare sockets of tokio",
            Some(Limit::AtMost(1.5)),
        ),
        (FastTcp, Blocking, "the same against bare sockets that block", Some(Limit::AtMost(3.0))),
        (Queue, Tokio, "└ of this: a request answered out of a queue, against tokio", None),
        (Data, Tokio, "└ of this: a port each way, against tokio", None),
        (Tcp, Tokio, "└ of this: over tcp, with acknowledgements, against tokio", None),
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
        let figures = [ours, other].map(|way| times(way, Bottle1k));
        targets.push(Target::two(what, limit, figures, over, |[ours, other]| {
            format!("{ours:.1} / {other:.1} us")
        }));
    }
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
        targets.push(Target::two(
            what,
            limit,
            [ours, other].map(|way| times(way, VgaRgb)),
            |[ours, other]| other / ours,
            |[ours, other]| format!("{:.0} / {:.0}", 1e6 / ours, 1e6 / other),
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
