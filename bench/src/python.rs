//! Python Wrapyfi, measured by the same orders: `peers/python_wrapyfi.py`.
//!
//! Its processes take seconds to start, so they are started once and rest between their turns.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Result, bail};
use serde::Deserialize;
use serde_json::json;

use crate::case::{Case, Way};
use crate::child::Child;
use crate::payload::{Kind, name};
use crate::proc;
use crate::turn::{Acks, Cpu, Phase, Turn, ports};
use crate::worker::{Order, Report};

/// Source with Wrapyfi's broker, forwarder, sink, and one that only codes.
pub(crate) struct Python {
    source: Child,
    forward: Child,
    sink: Child,
    coder: Child,
}

/// Medians of Wrapyfi's own coding.
#[derive(Debug, Clone, Copy, Deserialize)]
pub(crate) struct Coding {
    pub(crate) encode_us: f64,
    pub(crate) decode_us: f64,
}

/// The interpreter: `WRAPYFI_PYTHON`, else the one `make test` installs.
fn interpreter(repository: &Path) -> Result<PathBuf> {
    let path = std::env::var_os("WRAPYFI_PYTHON")
        .map_or_else(|| repository.join(".venv/bin/python"), PathBuf::from);
    let probe = "import importlib.util as u, sys; sys.exit(not all(u.find_spec(m) for m in ('wrapyfi', 'zmq')))";
    let ran = Command::new(&path).args(["-c", probe]).status();
    if ran.is_ok_and(|status| status.success()) {
        return Ok(path);
    }
    bail!(
        "Python Wrapyfi is not installed at {}: run `make test`, or set WRAPYFI_PYTHON",
        path.display()
    )
}

impl Python {
    /// Starts all of it.
    pub(crate) fn start(repository: &Path, folder: &Path) -> Result<Self> {
        let python = interpreter(repository)?;
        let (pub_port, sub_port) = ports()?;
        let start = |role: &str, acks: u16| {
            let mut command = Command::new(&python);
            command.arg(repository.join("bench/peers/python_wrapyfi.py")).arg(role);
            command.args(["--pub-port", &pub_port.to_string()]);
            command.args(["--sub-port", &sub_port.to_string()]);
            command.args(["--acks", &acks.to_string()]);
            Child::start(&format!("python-{role}"), command, folder)
        };
        let mut source = start("source", 0)?;
        let Acks { acks } = source.answer()?;
        let sink = start("sink", acks)?;
        Ok(Self { source, sink, forward: start("forward", 0)?, coder: start("code", 0)? })
    }

    /// Measures a case once.
    pub(crate) fn turn(&mut self, case: Case) -> Result<Turn> {
        let way = if case.way == Way::PythonForward { "forward" } else { "hop" };
        let target = json!({ "way": way, "payload": name(&case.payload) });
        self.sink.tell(&target)?;
        if case.way == Way::PythonForward {
            self.forward.tell(&target)?;
        }
        let done = self.measure(case, way);
        self.sink.tell(&())?;
        self.forward.tell(&())?;
        done
    }

    fn measure(&mut self, case: Case, way: &str) -> Result<Turn> {
        self.ask(&Order::Warm, case, way)?;
        let paced = self.phase(&case.paced(), case, way)?;
        let window = self.phase(&case.window(), case, way)?;
        let rss = |child: &Child| proc::rss_mib(child.id());
        let middle_rss_mib = if way == "hop" { 0.0 } else { rss(&self.forward) };
        let rss_mib = rss(&self.source) + rss(&self.sink) + middle_rss_mib;
        Ok(Turn { paced, window, rss_mib, middle_rss_mib })
    }

    fn ask(&mut self, order: &Order, case: Case, way: &str) -> Result<Report> {
        let mut order = serde_json::to_value(order)?;
        if let Some(order) = order.as_object_mut() {
            order.insert("way".to_owned(), way.into());
            order.insert("payload".to_owned(), name(&case.payload).into());
        }
        self.source.tell(&order)?;
        self.source.answer()
    }

    fn phase(&mut self, order: &Order, case: Case, way: &str) -> Result<Phase> {
        let before = self.cpu();
        let report = self.ask(order, case, way)?;
        Ok(Phase::new(report, before, self.cpu()))
    }

    /// Broker and forwarder are between the ends.
    fn cpu(&self) -> Cpu {
        let (source, with_broker) =
            (proc::cpu_of(self.source.id()), proc::cpu_ns(self.source.id()));
        let forward = proc::cpu_ns(self.forward.id());
        let middle = with_broker.saturating_sub(source) + forward;
        (with_broker + forward + proc::cpu_ns(self.sink.id()), middle, source)
    }

    /// Coding alone, without a transport.
    pub(crate) fn coding(&mut self, kind: Kind, repeats: u32) -> Result<Coding> {
        self.coder.tell(&json!({ "payload": name(&kind), "repeats": repeats }))?;
        self.coder.answer()
    }
}
