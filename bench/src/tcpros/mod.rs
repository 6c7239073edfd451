//! ROS 1: our bridge to ROS 2 beside a relay on rospy, and our nodes beside bare sockets.
//!
//! ```text
//!   direct   RawPublisher ═════════════════════════════════▶ RawSubscriber
//!   bridge   RawPublisher ═▶ wrapyfi bridge ═ RTPS ════════▶ CDR reader
//!   rospy    RawPublisher ═▶ rospy, AnyMsg ════════════════▶ RawSubscriber
//!   pair     our publisher ════════════════════════════════▶ our listener       or tokio, bare
//! ```
//!
//! The master is Debian's, and so is rospy: where they are missing, all of this is.

mod ends;
mod load;
mod pair;
mod raw;
mod streams;

use std::path::Path;
use std::process::Command;

use anyhow::{Context as _, Result, ensure};
use serde::Deserialize;

use crate::child::Child;
use crate::results::Results;
use crate::trip::Leg;
use crate::turn::{Bench, Line, Phase, in_turn};
use crate::worker::Order;

pub(crate) use ends::{Place, incoming, outgoing};
pub(crate) use load::Load;
pub(crate) use pair::{Pair, Place as PairPlace, far, near};
pub(crate) use streams::{Streams, streams};

/// The interpreter that Debian's packages are for.
const PYTHON: &str = "/usr/bin/python3";
/// Messages of 200 bytes of one turn, and how many a second.
const COUNT: u32 = 2000;
const HZ: f64 = 1000.0;
/// Batches of images of one turn.
const BATCHES: u32 = 5;

/// Station between publisher and subscriber.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Way {
    /// No station: publisher and subscriber connect.
    Direct,
    /// Our bridge: the subscriber is on ROS 2.
    Bridge,
    /// A relay on rospy.
    Rospy,
}

impl Way {
    /// All of them.
    pub(crate) const ALL: [Self; 3] = [Self::Direct, Self::Bridge, Self::Rospy];

    /// Name in files.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Direct => "direct",
            Self::Bridge => "bridge",
            Self::Rospy => "rospy",
        }
    }

    /// Title of the way, for people.
    pub(crate) fn title(self) -> &'static str {
        match self {
            Self::Direct => "ROS 1, publisher to subscriber",
            Self::Bridge => "bridge ROS 1 to ROS 2",
            Self::Rospy => "rospy relay ROS 1 to ROS 1",
        }
    }
}

/// Measurement that has a turn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Hop {
    /// Messages of 200 bytes, 1000 a second.
    Text(Way),
    /// Images by hundreds.
    Images(Pair),
}

impl Hop {
    /// All of them, those that are compared next to each other.
    pub(crate) const ALL: [Self; 5] = [
        Self::Text(Way::Direct),
        Self::Text(Way::Bridge),
        Self::Text(Way::Rospy),
        Self::Images(Pair::Tokio),
        Self::Images(Pair::Ours),
    ];

    /// Titles of way and load, for people.
    pub(crate) fn titles(self) -> (&'static str, &'static str) {
        match self {
            Self::Text(way) => (way.title(), "text of 200 bytes at 1000 Hz"),
            Self::Images(Pair::Tokio) => ("bare sockets of tokio", "640x480 RGB, one way, each"),
            Self::Images(Pair::Ours) => ("our two nodes on ROS 1", "640x480 RGB, one way, each"),
        }
    }

    /// `ros1-way/load`.
    pub(crate) fn name(self) -> String {
        match self {
            Self::Text(way) => format!("ros1-{}/text", way.name()),
            Self::Images(pair) => format!("ros1-{}/vga-rgb", pair.name()),
        }
    }

    fn turn(self, bench: &Bench, master: &mut Master) -> Result<Leg> {
        match self {
            Self::Text(way) => {
                let mut lines = Lines::start(bench, master, way, &[Load::Text])?;
                let line = lines.lines.first_mut().context("no line")?;
                let warm = line.ask(&Order::Warm).context("warming up")?;
                Ok(Leg { warm, calls: line.phase(&Order::Paced { count: COUNT, hz: HZ })? })
            }
            Self::Images(pair) => images(pair, bench, master),
        }
    }
}

/// Images from near to far.
fn images(pair: Pair, bench: &Bench, master: &Master) -> Result<Leg> {
    let start = |role: &str, peer: u16| {
        let mut command = bench.command(&bench.own);
        command.args([role, "--pair", pair.name(), "--master", &master.uri]);
        command.args(["--peer", &peer.to_string()]);
        Child::start(role, command, &bench.folder)
    };
    let mut sink = start("ros1-far", 0)?;
    let pair::Ready { peer } = sink.answer()?;
    let source = start("ros1-near", peer)?;
    let mut line = Line { source, sink, middle: Vec::new(), domain: 0, acks: 0 };
    let warm = line.ask(&Order::Warm).context("warming up")?;
    let calls: Phase = line.phase(&Order::Window { count: BATCHES, inflight: 1 })?;
    ensure!(calls.report.received == BATCHES * pair::BATCH, "images are missing");
    Ok(Leg { warm, calls })
}

/// A roscore of Debian.
pub(crate) struct Master {
    uri: String,
    script: std::path::PathBuf,
    /// Topics of a turn are its own: the master remembers nodes that ended without a word.
    turn: u32,
    _process: Child,
}

#[derive(Deserialize)]
struct Said {
    ready: bool,
}

fn python(bench: &Bench, script: &Path) -> Command {
    let mut command = bench.command(Path::new(PYTHON));
    command.arg(script).env("ROS_IP", "127.0.0.1").env("PYTHONDONTWRITEBYTECODE", "1");
    command.env("ROS_LOG_DIR", &bench.folder).env("ROS_HOME", &bench.folder);
    command.env_remove("ROS_HOSTNAME").env_remove("ROS_NAMESPACE");
    command
}

impl Master {
    /// Starts it.
    pub(crate) fn start(bench: &Bench, repository: &Path) -> Result<Self> {
        let probe = "import rospy, rosmaster";
        let found = Command::new(PYTHON).args(["-c", probe]).output();
        ensure!(
            found.is_ok_and(|found| found.status.success()),
            "no ROS 1 (Debian 12: apt-get install python3-rosmaster python3-rospy)"
        );
        let script = repository.join("bench/peers/rospy_relay.py");
        let port = crate::turn::ports()?.0;
        let mut command = python(bench, &script);
        command.args(["master", "--port", &port.to_string()]);
        let mut process = Child::start("rosmaster", command, &bench.folder)?;
        let Said { ready } = process.answer()?;
        ensure!(ready, "the master does not start");
        Ok(Self { uri: format!("http://127.0.0.1:{port}"), script, turn: 0, _process: process })
    }
}

/// Lines that share what is between their ends.
struct Lines {
    lines: Vec<Line>,
    /// Ends after the lines.
    middle: Option<Child>,
}

impl Lines {
    fn start(bench: &Bench, master: &mut Master, way: Way, loads: &[Load]) -> Result<Self> {
        master.turn += 1;
        let (turn, domain) = (master.turn, bench.domain());
        let topic = |load: Load, end: &str| format!("/turn_{turn}/{}_{end}", load.name());
        let middle = match way {
            Way::Direct => None,
            Way::Bridge => Some(bridge(bench, master, domain, loads, topic)?),
            Way::Rospy => {
                let mut command = python(bench, &master.script);
                command.arg("relay").env("ROS_MASTER_URI", &master.uri);
                for load in loads {
                    command.args([topic(*load, "in"), topic(*load, "out")]);
                }
                command.args(["--node", &format!("rospy_relay_{turn}")]);
                let mut child = Child::start("rospy", command, &bench.folder)?;
                let Said { ready } = child.answer()?;
                ensure!(ready, "the relay does not start");
                Some(child)
            }
        };
        let mut lines = Vec::new();
        for load in loads {
            let end = |role: &str, topic: &str| {
                let mut command = bench.command(&bench.own);
                command.args([role, "--load", load.name(), "--topic", topic]);
                command.args(["--master", &master.uri]);
                command
            };
            let from = topic(*load, "in");
            let to = if way == Way::Direct { from.clone() } else { topic(*load, "out") };
            let mut source = Child::start("ros1-source", end("ros1-source", &from), &bench.folder)?;
            let Acks { acks } = source.answer()?;
            let mut command = end("ros1-sink", &to);
            command.args(["--acks", &acks.to_string()]);
            if way == Way::Bridge {
                command.args(["--domain", &domain.to_string()]);
            }
            let sink = Child::start("ros1-sink", command, &bench.folder)?;
            lines.push(Line { source, sink, middle: Vec::new(), domain, acks });
        }
        Ok(Self { lines, middle })
    }
}

#[derive(Deserialize)]
struct Acks {
    acks: u16,
}

/// Definitions that an installed ROS 2 has, and that this program does not bring.
const DEFINITIONS: [(&str, &str); 5] = [
    ("tf2_msgs/msg/TFMessage.msg", "geometry_msgs/TransformStamped[] transforms\n"),
    (
        "geometry_msgs/msg/TransformStamped.msg",
        "std_msgs/Header header\nstring child_frame_id\nTransform transform\n",
    ),
    ("geometry_msgs/msg/Transform.msg", "Vector3 translation\nQuaternion rotation\n"),
    ("geometry_msgs/msg/Vector3.msg", "float64 x\nfloat64 y\nfloat64 z\n"),
    ("geometry_msgs/msg/Quaternion.msg", "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1\n"),
];

/// The bridge with defaults, but for the depth that a listener of `/tf` has.
fn bridge(
    bench: &Bench,
    master: &Master,
    domain: u32,
    loads: &[Load],
    topic: impl Fn(Load, &str) -> String,
) -> Result<Child> {
    let mut text = format!(
        "definitions: [definitions]\nendpoints:\n  ros: {{ master_uri: \"{}\", hostname: 127.0.0.1, node: bridge_{} }}\n  \
         ros2: {{ domain_id: {domain}, interface: lo }}\nroutes:\n",
        master.uri, master.turn
    );
    for load in loads {
        let (from, to) = (topic(*load, "in"), topic(*load, "out"));
        let depth = if *load == Load::Tf { ", qos: { depth: 100 }" } else { "" };
        text += &format!(
            "  - {{ from: \"ros:{from}\", to: \"ros2:{to}\", type: {}{depth} }}\n",
            load.route_type()
        );
    }
    for (path, definition) in DEFINITIONS {
        let path = bench.folder.join("definitions").join(path);
        path.parent().map_or(Ok(()), std::fs::create_dir_all)?;
        std::fs::write(path, definition)?;
    }
    let file = bench.folder.join("ros1_bridge.yaml");
    std::fs::write(&file, text)?;
    let mut command = bench.command(&bench.wrapyfi);
    command.args(["--log-level", "warn", "bridge", "--config"]).arg(file);
    Child::start("bridge", command, &bench.folder)
}

/// All of it, as every round has it: backwards in every other one.
pub(crate) fn round(
    bench: &Bench,
    master: &mut Master,
    hops: &[Hop],
    round: u32,
    results: &mut Results,
) {
    for hop in in_turn(hops, round.is_multiple_of(2)) {
        results.leg(round, &hop.name(), hop.turn(bench, master));
    }
}
