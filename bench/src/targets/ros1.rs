//! Promises about ROS 1: coding beside memcpy, the bridge beside a relay on rospy, our nodes beside
//! bare sockets.

use super::{Outcome, Target, over};
use crate::estimate::Limit;
use crate::results::Results;
use crate::ros1;
use crate::tcpros::{Hop, Load, Pair, Streams, Way};

/// All of them.
pub(super) fn check(results: &Results, targets: &mut Vec<Target>) {
    coding(results, targets);
    latency(results, targets);
    images(results, targets);
    for way in [Way::Bridge, Way::Rospy] {
        targets.push(streams(results, way));
    }
}

/// Messages between ROS 1 and CDR; nothing is promised of those that are mostly strings.
fn coding(results: &Results, targets: &mut Vec<Target>) {
    for (name, limit) in ros1::CASES {
        for direction in ros1::DIRECTIONS {
            let figures = [direction, ros1::MEMCPY]
                .map(|what| results.figure_rounds(&ros1::figure(name, what)).cloned());
            targets.push(Target::two(
                format!("ROS 1 {name}, {direction}, against memcpy of the same bytes"),
                limit.map(Limit::AtMost),
                figures,
                over,
                |[ours, memcpy]| format!("{ours:.2} / {memcpy:.2} us"),
            ));
        }
    }
}

/// Latency that a station adds to 200 bytes: its 99th percentile, less the latency of the way
/// without one.
fn latency(results: &Results, targets: &mut Vec<Target>) {
    let times = |way, fraction| results.times(&Hop::Text(way).name(), fraction);
    for (way, what, limit) in [
        (
            Way::Bridge,
            "ROS 1 to ROS 2 through the bridge, 200 bytes at 1000 Hz: us added, p99 less the p50 of \
             the direct way",
            Some(Limit::AtMost(2000.0)),
        ),
        (Way::Rospy, "└ the same through a relay on rospy, ROS 1 to ROS 1", None),
    ] {
        targets.push(Target::two(
            what,
            limit,
            [times(way, 0.99), times(Way::Direct, 0.5)],
            |[whole, direct]| whole - direct,
            |[whole, direct]| format!("{whole:.0} - {direct:.0} us"),
        ));
    }
    for (fraction, what) in [(0.99, "p99"), (0.5, "p50")] {
        targets.push(Target::two(
            format!("└ the relay on rospy against the bridge, {what}"),
            None,
            [Way::Rospy, Way::Bridge].map(|way| times(way, fraction)),
            over,
            |[rospy, bridge]| format!("{rospy:.0} / {bridge:.0} us"),
        ));
    }
}

/// Images between two of our nodes.
fn images(results: &Results, targets: &mut Vec<Target>) {
    targets.push(Target::two(
        "TCPROS stream of 640x480 RGB, publisher to listener, against a tokio reader into one buffer: \
         images a second",
        Some(Limit::AtLeast(0.8)),
        [Pair::Ours, Pair::Tokio].map(|pair| results.times(&Hop::Images(pair).name(), 0.5)),
        |[ours, bare]| bare / ours,
        |[ours, bare]| format!("{:.0} / {:.0}", 1e6 / ours, 1e6 / bare),
    ));
}

/// Two streams together; nothing is promised of rospy.
fn streams(results: &Results, way: Way) -> Target {
    let what = format!(
        "{} at 30 Hz and {} at 200 Hz together, {}: losses",
        Load::Image.title(),
        Load::Tf.title(),
        way.title()
    );
    let found = results.streams_of(way).map(|streams| {
        let Streams { seconds, share, .. } = streams;
        let (lost, twice, sent) = (streams.lost(), streams.twice(), streams.sent());
        let found =
            format!("{lost} lost, {twice} twice, of {sent} in {seconds} s; {share:.0} % of a core");
        (found, lost == 0 && twice == 0)
    });
    let is_ours = way == Way::Bridge;
    let mut target = Target::counted(&what, if is_ours { "none" } else { "" }, found);
    if !is_ours && target.outcome != Outcome::NotMeasured {
        target.outcome = Outcome::Shown;
    }
    target
}
