//! One turn of a case: its processes are started, warmed up, measured and ended.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use anyhow::{Context as _, Result, bail};
use serde::Deserialize;

use crate::case::{Case, Way};
use crate::child::Child;
use crate::payload::name;
use crate::proc;
use crate::wire::Wire;
use crate::worker::{Order, Report};

/// Figures of one phase of a turn.
#[derive(Debug, Clone, Default)]
pub(crate) struct Phase {
    /// The source's account.
    pub(crate) report: Report,
    /// CPU microseconds a message, all processes, without the source's waiting.
    pub(crate) cpu_us: f64,
    /// CPU microseconds a message of what is between the ends: broker and bridge.
    pub(crate) middle_us: f64,
    /// The same of the source alone.
    pub(crate) source_us: f64,
}

/// CPU nanoseconds of processes: all, those between the ends, the source.
pub(crate) type Cpu = (u64, u64, u64);

/// Figures of one turn.
#[derive(Debug, Clone, Default)]
pub(crate) struct Turn {
    pub(crate) paced: Phase,
    pub(crate) window: Phase,
    /// Resident memory at the end, in MiB: all processes, and what is between the ends.
    pub(crate) rss_mib: f64,
    pub(crate) middle_rss_mib: f64,
}

/// Programs and folders of a run.
pub(crate) struct Bench {
    /// Path of this program.
    pub(crate) own: PathBuf,
    /// The `wrapyfi` program, and another one that is measured beside it.
    pub(crate) wrapyfi: PathBuf,
    pub(crate) other: Option<PathBuf>,
    /// Logs and configurations.
    pub(crate) folder: PathBuf,
    /// DDS domain of the next turn.
    domain: std::cell::Cell<u32>,
}

/// The processes of a turn. Ends first when dropped, then what is between them.
pub(crate) struct Line {
    pub(crate) source: Child,
    pub(crate) sink: Child,
    pub(crate) middle: Vec<Child>,
}

#[derive(Deserialize)]
pub(crate) struct Acks {
    pub(crate) acks: u16,
}

/// Two free ports.
pub(crate) fn ports() -> Result<(u16, u16)> {
    let bind = || std::net::TcpListener::bind(("127.0.0.1", 0));
    let (one, two) = (bind()?, bind()?);
    Ok((one.local_addr()?.port(), two.local_addr()?.port()))
}

impl Bench {
    /// Finds the programs.
    pub(crate) fn new(folder: &Path, other: Option<PathBuf>) -> Result<Self> {
        let own = std::env::current_exe()?;
        let wrapyfi = own.with_file_name("wrapyfi");
        if !wrapyfi.is_file() {
            bail!("no program at {}: cargo build --release -p wrapyfi_bridge", wrapyfi.display());
        }
        let domain = std::process::id() % 100;
        let folder = folder.to_owned();
        Ok(Self { own, wrapyfi, other, folder, domain: domain.into() })
    }

    /// A DDS domain from 1 to 100 that the last turns did not use.
    pub(crate) fn domain(&self) -> u32 {
        let domain = self.domain.get() % 100 + 1;
        self.domain.set(domain);
        domain
    }

    /// A program, confined to this host.
    pub(crate) fn command(&self, program: &Path) -> Command {
        let mut command = Command::new(program);
        command.env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST");
        for name in ["CYCLONEDDS_URI", "ROS_DOMAIN_ID", "ROS_DISTRO", "RMW_IMPLEMENTATION"] {
            command.env_remove(name);
        }
        command
    }

    /// The program that a case is about.
    fn program(&self, case: Case) -> &Path {
        self.other.as_deref().filter(|_| case.is_other).unwrap_or(&self.wrapyfi)
    }

    /// Starts the broker of `program` on free ports.
    fn broker(&self, program: &Path) -> Result<(Child, (u16, u16))> {
        let (pub_port, sub_port) = ports()?;
        let mut command = self.command(program);
        command.args(["--log-level", "warn", "broker", "--ip", "127.0.0.1"]);
        command.args(["--pub-port", &pub_port.to_string(), "--sub-port", &sub_port.to_string()]);
        let broker = Child::start("broker", command, &self.folder)?;
        for _ in 0..200 {
            if std::net::TcpStream::connect(("127.0.0.1", sub_port)).is_ok() {
                return Ok((broker, (pub_port, sub_port)));
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        bail!("the broker does not start")
    }

    /// Starts the bridge with one route.
    fn bridge(&self, case: Case, ports: (u16, u16), domain: u32) -> Result<Child> {
        let (from, to) = match case.way {
            Way::ZmqToRos => ("zeromq:/in", "ros2:/out"),
            Way::RosToZmq => ("ros2:/in", "zeromq:/out"),
            _ => ("zeromq:/in", "zeromq:/out"),
        };
        let depth = case.payload.depth();
        let qos = match case.way {
            Way::RustForward => String::new(),
            _ => format!(", qos: {{ depth: {depth} }}"),
        };
        let text = format!(
            "endpoints:\n  zeromq: {{ pub_port: {}, sub_port: {}, broker: foreign }}\n  \
             ros2: {{ domain_id: {domain}, interface: lo }}\nroutes:\n  \
             - {{ from: \"{from}\", to: \"{to}\", type: {}, queue_depth: {depth}{qos} }}\n",
            ports.0,
            ports.1,
            case.payload.message_type(),
        );
        let file = self.folder.join("bridge.yaml");
        std::fs::write(&file, text)?;
        let mut command = self.command(self.program(case));
        command.args(["--log-level", "warn", "bridge", "--config"]).arg(file);
        Child::start("bridge", command, &self.folder)
    }

    fn worker(&self, role: &str, wire: Wire, place: &[String]) -> Command {
        let mut command = self.command(&self.own);
        command.args([role, "--wire", &name(&wire)]).args(place);
        command
    }

    /// Starts the processes of a case on our programs.
    pub(crate) fn line(&self, case: Case) -> Result<Line> {
        let domain = self.domain();
        let mut middle = Vec::new();
        let mut ports = (0, 0);
        if case.way != Way::RawDds {
            let (broker, found) = self.broker(self.program(case))?;
            middle.push(broker);
            ports = found;
        }
        let (from, to) = match case.way {
            Way::RawDds => (Wire::Dds, Wire::Dds),
            Way::ZmqToRos => (Wire::Zmq, Wire::Dds),
            Way::RosToZmq => (Wire::Dds, Wire::Zmq),
            Way::OurPublisher => (Wire::Wrapyfi, Wire::Zmq),
            Way::RustHop | Way::RustForward => (Wire::Wrapyfi, Wire::Wrapyfi),
            _ => (Wire::Zmq, Wire::Zmq),
        };
        let place = |topic: &str| -> Vec<String> {
            [
                ("--payload", name(&case.payload)),
                ("--topic", topic.to_owned()),
                ("--pub-port", ports.0.to_string()),
                ("--sub-port", ports.1.to_string()),
                ("--domain", domain.to_string()),
            ]
            .into_iter()
            .flat_map(|(key, value)| [key.to_owned(), value])
            .collect()
        };
        if case.way.is_bridged() {
            middle.push(self.bridge(case, ports, domain)?);
        }
        let command = self.worker("source", from, &place("/in"));
        let mut source = Child::start("source", command, &self.folder)?;
        let Acks { acks } = source.answer()?;
        let topic = if case.way.is_bridged() { "/out" } else { "/in" };
        let mut command = self.worker("sink", to, &place(topic));
        command.args(["--acks", &acks.to_string()]);
        let sink = Child::start("sink", command, &self.folder)?;
        Ok(Line { source, sink, middle })
    }

    /// Measures a case on our programs once.
    pub(crate) fn turn(&self, case: Case) -> Result<Turn> {
        let mut line = self.line(case)?;
        line.ask(&Order::Warm).context("warming up")?;
        let paced = line.phase(&case.paced())?;
        let window = line.phase(&case.window())?;
        let (rss_mib, middle_rss_mib) = line.rss();
        Ok(Turn { paced, window, rss_mib, middle_rss_mib })
    }
}

impl Line {
    /// Has the source do something.
    pub(crate) fn ask(&mut self, order: &Order) -> Result<Report> {
        self.source.tell(order)?;
        self.source.answer()
    }

    /// The same, with the CPU time it took.
    pub(crate) fn phase(&mut self, order: &Order) -> Result<Phase> {
        let before = self.cpu();
        let report = self.ask(order)?;
        let after = self.cpu();
        Ok(Phase::new(report, before, after))
    }

    fn cpu(&self) -> Cpu {
        let of = |child: &Child| proc::cpu_ns(child.id());
        let (middle, source) = (self.middle.iter().map(of).sum(), of(&self.source));
        (source + of(&self.sink) + middle, middle, source)
    }

    /// Resident memory of all processes, and of those between the ends.
    fn rss(&self) -> (f64, f64) {
        let middle = self.middle.iter().map(|child| proc::rss_mib(child.id())).sum();
        (proc::rss_mib(self.source.id()) + proc::rss_mib(self.sink.id()) + middle, middle)
    }
}

impl Phase {
    /// Puts a report and CPU times before and after together.
    pub(crate) fn new(report: Report, before: Cpu, after: Cpu) -> Self {
        let per_message = |from: u64, to: u64, awake: u64| {
            to.saturating_sub(from).saturating_sub(awake) as f64
                / 1e3
                / f64::from(report.sent.max(1))
        };
        let awake = report.awake_ns;
        let cpu_us = per_message(before.0, after.0, awake);
        let middle_us = per_message(before.1, after.1, 0);
        let source_us = per_message(before.2, after.2, awake);
        Self { report, cpu_us, middle_us, source_us }
    }

    /// Messages a second.
    pub(crate) fn rate(&self) -> f64 {
        if self.report.span_ns == 0 {
            return 0.0;
        }
        f64::from(self.report.received) * 1e9 / self.report.span_ns as f64
    }
}
