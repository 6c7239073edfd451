//! VGA frames at 30 Hz through the bridge into a reader on Fast DDS for a minute: gaps, and what the
//! kernel dropped of it.
//!
//! ```text
//!   source ─▶ broker ─▶ bridge ═ RTPS ═▶ fast_peer (C++, the kernel's socket buffer)
//!      ▲                                    │ a line for each message
//!      └──────── arrivals, over TCP ────────┘
//! ```

use std::io::Write as _;
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Result, bail, ensure};
use serde::Deserialize;

use crate::case::{Case, Way};
use crate::child::Child;
use crate::clock;
use crate::payload::{Kind, number_in_cdr};
use crate::turn::Bench;
use crate::worker::{Order, Report};

/// Messages before the measurement: a second to find out who subscribes, one in the way that is then
/// taken.
const SETTLE: u32 = 75;

/// A header that Fast DDS 2 has, and neither 1 nor 3.
const PROBE: &str = "#include <fastdds/dds/domain/DomainParticipant.hpp>\n\
                     #include <fastrtps/utils/IPLocator.h>\n";

/// Figures of the stream.
#[derive(Debug, Clone, Default)]
pub(crate) struct Stream {
    /// Duration of the stream in seconds.
    pub(crate) seconds: u32,
    /// The source's account.
    pub(crate) report: Report,
    /// Datagrams that no socket had room for, of all processes.
    pub(crate) dropped: u64,
    /// Receive buffer of a socket that asks for nothing, in bytes.
    pub(crate) rmem_default: u64,
}

impl Stream {
    /// Messages that were sent and did not come.
    pub(crate) fn gaps(&self) -> u32 {
        (self.report.sent + self.report.refused).saturating_sub(self.report.received)
    }
}

/// A line of the peer.
#[derive(Deserialize)]
struct Said {
    event: String,
    /// The first bytes of a message, in hex.
    #[serde(default)]
    head: String,
}

/// Compiles the peer.
fn peer(folder: &Path) -> Result<PathBuf> {
    let repository = Path::new(env!("CARGO_MANIFEST_DIR")).parent().context("no repository")?;
    let compiler = || Command::new(std::env::var_os("CXX").unwrap_or_else(|| "c++".into()));
    let probe = folder.join("probe.hpp");
    std::fs::write(&probe, PROBE)?;
    let ran = compiler().args(["-x", "c++", "-E", "-o", "/dev/null"]).arg(probe).output()?;
    ensure!(
        ran.status.success(),
        "no Fast DDS 2 for C++ (Debian 12: apt-get install libfastrtps-dev libfastcdr-dev)"
    );
    let program = folder.join("fast_peer");
    let mut command = compiler();
    command.args(["-std=c++17", "-O2", "-o"]).arg(&program);
    command.arg(repository.join("test/peers/fast_peer/main.cpp"));
    command.args(["-lfastrtps", "-lfastcdr", "-pthread"]);
    let ran = command.output()?;
    ensure!(ran.status.success(), "{command:?}: {}", String::from_utf8_lossy(&ran.stderr));
    Ok(program)
}

/// Runs it.
pub(crate) fn run(bench: &Bench, seconds: u32) -> Result<Stream> {
    let kind = Kind::VgaRgb;
    let program = peer(&bench.folder)?;
    let mut line = bench.line_to(Case { way: Way::ZmqToRos, payload: kind }, |domain| {
        let mut command = bench.command(&program);
        command.args(["subscribe", "--topic", "/out", "--type", "sensor_msgs/msg/Image"]);
        // ROS 2's depth for sensors.
        command.args(["--depth", "5"]).env("ROS_DOMAIN_ID", domain.to_string());
        command
    })?;
    let acks = TcpStream::connect(("127.0.0.1", line.acks))?;
    acks.set_nodelay(true)?;
    let sink = line.sink;
    let pid = i32::try_from(sink.id()).ok().and_then(rustix::process::Pid::from_raw);
    let pid = pid.context("a process without a number")?;
    let teller = std::thread::spawn(move || tell(sink, acks, kind));
    line.source.tell(&Order::Warm)?;
    let _: Report = line.source.answer()?;
    line.source.tell(&Order::Paced { count: SETTLE, hz: 30.0 })?;
    let _: Report = line.source.answer()?;
    let before = dropped();
    line.source.tell(&Order::Paced { count: seconds * 30, hz: 30.0 })?;
    let report = line.source.answer()?;
    let dropped = dropped().saturating_sub(before);
    // The thread ends with the peer.
    rustix::process::kill_process(pid, rustix::process::Signal::TERM)?;
    if teller.join().is_err() {
        bail!("the thread that reads the Fast DDS peer panicked");
    }
    let rmem_default =
        std::fs::read_to_string("/proc/sys/net/core/rmem_default")?.trim().parse()?;
    Ok(Stream { seconds, report, dropped, rmem_default })
}

/// Tells the source of what the peer says has arrived, until one of them ends.
fn tell(mut peer: Child, mut acks: TcpStream, kind: Kind) {
    while let Ok(Said { event, head }) = peer.answer() {
        let time = clock::now();
        if event != "message" {
            continue;
        }
        let bytes: Vec<u8> = (0..head.len() / 2)
            .filter_map(|at| u8::from_str_radix(head.get(2 * at..2 * at + 2)?, 16).ok())
            .collect();
        let Ok(number) = number_in_cdr(kind, &bytes) else { return };
        let ack = [u64::from(number).to_le_bytes(), time.to_le_bytes()].concat();
        if acks.write_all(&ack).is_err() {
            return;
        }
    }
}

/// `RcvbufErrors` of UDP in this network namespace.
fn dropped() -> u64 {
    let text = std::fs::read_to_string("/proc/net/snmp").unwrap_or_default();
    let mut lines = text.lines().filter_map(|line| line.strip_prefix("Udp:"));
    let (names, values) = (lines.next().unwrap_or_default(), lines.next().unwrap_or_default());
    let mut pairs = names.split_whitespace().zip(values.split_whitespace());
    pairs.find(|(name, _)| *name == "RcvbufErrors").map_or(0, |(_, v)| v.parse().unwrap_or(0))
}
