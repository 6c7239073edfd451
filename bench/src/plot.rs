//! The picture: latency of every case on a logarithmic axis, as SVG that suits light and dark pages.

use std::fmt::Write as _;

use crate::case::Way;
use crate::payload::Kind;
use crate::results::{Results, Summary};

const LEFT: f64 = 250.0;
const PLOT: f64 = 560.0;
const WIDTH: f64 = LEFT + PLOT + 120.0;
const BAR: f64 = 13.0;
const STEP: f64 = 17.0;
const TOP: f64 = 74.0;
/// Decades of the axis, in microseconds: 10 us to 1 s.
const FIRST: f64 = 1.0;
const LAST: f64 = 6.0;

/// Plain colours, said twice: not every program that draws SVG knows CSS variables.
const STYLE: &str = "\
    text{font:12px system-ui,sans-serif}.head{font-weight:600}.big{font-size:15px;font-weight:600}.whisker{stroke-width:1.2}\
    text{fill:#1f2328}.page{fill:#fff}.grid{stroke:#d8dee4}.whisker{stroke:#1f2328}.raw{fill:#8b949e}.bridge{fill:#0969da}.rust{fill:#1a7f37}.python{fill:#bc4c00}\
    @media(prefers-color-scheme:dark){text{fill:#e6edf3}.page{fill:#0d1117}.grid{stroke:#30363d}.whisker{stroke:#e6edf3}.raw{fill:#8b949e}.bridge{fill:#4493f8}.rust{fill:#3fb950}.python{fill:#f0883e}}";

const ORDER: [Way; 10] = [
    Way::RawZmq,
    Way::RawDds,
    Way::RelayToRos,
    Way::ZmqToRos,
    Way::RelayToZmq,
    Way::RosToZmq,
    Way::RustHop,
    Way::PythonHop,
    Way::RustForward,
    Way::PythonForward,
];

fn class(way: Way) -> &'static str {
    match way {
        Way::RawZmq | Way::RawDds | Way::RelayToRos | Way::RelayToZmq => "raw",
        Way::ZmqToRos | Way::RosToZmq => "bridge",
        Way::RustHop | Way::RustForward => "rust",
        Way::PythonHop | Way::PythonForward => "python",
    }
}

fn label(way: Way) -> &'static str {
    match way {
        Way::RawZmq => "raw ZeroMQ hop",
        Way::RawDds => "raw CycloneDDS hop",
        Way::ZmqToRos => "bridge ZeroMQ to ROS 2",
        Way::RosToZmq => "bridge ROS 2 to ZeroMQ",
        Way::RelayToRos => "minimal relay to ROS 2",
        Way::RelayToZmq => "minimal relay to ZeroMQ",
        Way::RustHop => "one hop with coding, ours",
        Way::PythonHop => "one hop with coding, Python",
        Way::RustForward => "forwarded with coding, ours",
        Way::PythonForward => "forwarded with coding, Python",
    }
}

/// Position of a latency on the axis.
fn x(micros: f64) -> f64 {
    LEFT + (micros.max(1.0).log10().clamp(FIRST, LAST) - FIRST) / (LAST - FIRST) * PLOT
}

/// Microseconds with the unit that suits them.
fn shown(micros: f64) -> String {
    match micros {
        m if m < 1000.0 => format!("{m:.0} us"),
        m if m < 10_000.0 => format!("{:.2} ms", m / 1e3),
        m => format!("{:.1} ms", m / 1e3),
    }
}

/// The whole picture.
pub(crate) fn draw(results: &Results) -> String {
    let kinds = [
        Kind::Small,
        Kind::Audio,
        Kind::U8Rgb200,
        Kind::VgaJpeg,
        Kind::F32Mib,
        Kind::VgaRgb,
        Kind::FullHdRgb,
    ];
    let mut body = String::new();
    let mut y = TOP;
    for kind in kinds {
        let bars: Vec<(Way, Summary)> =
            ORDER.into_iter().filter_map(|way| Some((way, results.summary(way, kind)?))).collect();
        if bars.is_empty() {
            continue;
        }
        _ = writeln!(
            body,
            "<text class=\"head\" x=\"12\" y=\"{:.0}\">{}</text>",
            y + 12.0,
            kind.title()
        );
        y += STEP + 2.0;
        for (way, summary) in bars {
            bar(&mut body, way, &summary, y);
            y += STEP;
        }
        y += 8.0;
    }
    let bottom = y;
    let mut axis = String::new();
    for decade in 1..=6_i32 {
        let micros = 10_f64.powi(decade);
        let at = x(micros);
        _ = writeln!(
            axis,
            "<line class=\"grid\" x1=\"{at:.1}\" x2=\"{at:.1}\" y1=\"{:.0}\" y2=\"{bottom:.0}\"/>\
             <text x=\"{at:.1}\" y=\"{:.0}\" text-anchor=\"middle\">{}</text>",
            TOP - 6.0,
            TOP - 12.0,
            match decade {
                1 | 2 => format!("{micros:.0} us"),
                6 => "1 s".to_owned(),
                _ => format!("{:.0} ms", micros / 1e3),
            }
        );
    }
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH:.0} {height:.0}\" width=\"{WIDTH:.0}\" \
         role=\"img\" aria-label=\"Latency of raw hops, bridge and Python Wrapyfi\">\n<style>{STYLE}</style>\n\
         <rect class=\"page\" width=\"100%\" height=\"100%\" rx=\"6\"/>\n\
         <text class=\"big\" x=\"12\" y=\"24\">Latency on one machine: median, whisker to the 99th percentile (logarithmic)</text>\n\
         {axis}{body}</svg>\n",
        height = bottom + 8.0
    )
}

fn bar(out: &mut String, way: Way, summary: &Summary, y: f64) {
    let (half, high) = (x(summary.p50), x(summary.p99));
    let middle = y + BAR / 2.0;
    _ = writeln!(
        out,
        "<text x=\"{:.0}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>\
         <rect class=\"{}\" x=\"{LEFT:.0}\" y=\"{y:.1}\" width=\"{:.1}\" height=\"{BAR:.0}\" rx=\"2\"/>\
         <path class=\"whisker\" fill=\"none\" d=\"M{half:.1} {middle:.1}H{high:.1}M{high:.1} {:.1}V{:.1}\"/>\
         <text x=\"{:.1}\" y=\"{:.1}\">{}</text>",
        LEFT - 8.0,
        y + 10.5,
        label(way),
        class(way),
        half - LEFT,
        y + 2.0,
        y + BAR - 2.0,
        high + 6.0,
        y + 10.5,
        shown(summary.p50),
    );
}
