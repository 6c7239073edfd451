//! Python Wrapyfi and our package for Python, measured by the same orders to the same script: `peers/python_wrapyfi.py`.
//!
//! Its processes take seconds to start, so they are started once and rest between their turns.

use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail};
use serde::Deserialize;
use serde_json::json;

use crate::case::{Case, Way};
use crate::child::Child;
use crate::payload::{Kind, name};
use crate::proc;
use crate::report::quantile;
use crate::turn::{Acks, Cpu, Phase, Turn, ports};
use crate::worker::{Order, Report};

/// Library that `import wrapyfi` means in the script.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Library {
    Wrapyfi,
    /// `wrapyfi_rs`, by `python -m wrapyfi_rs`.
    Package,
}

/// Source with its broker, forwarder, sink, a server with its broker, and one that only codes.
pub(crate) struct Python {
    library: Library,
    interpreter: PathBuf,
    package: PathBuf,
    source: Child,
    forward: Child,
    sink: Child,
    _server: Child,
    coder: Option<Child>,
}

/// Medians of Wrapyfi's own coding.
#[derive(Debug, Clone, Copy, Deserialize)]
pub(crate) struct Coding {
    pub(crate) encode_us: f64,
    pub(crate) decode_us: f64,
}

/// A folder below this one where Python finds the package `wrapyfi_rs`, as a wheel has it.
fn package(repository: &Path, folder: &Path) -> Result<PathBuf> {
    let (all, sources) = (folder.join("python"), repository.join("wrapyfi_rs/python/wrapyfi_rs"));
    let package = all.join("wrapyfi_rs");
    if package.exists() {
        return Ok(all);
    }
    let library = std::env::current_exe()?.with_file_name("libwrapyfi_python.so");
    if !library.is_file() {
        bail!("no library at {}: cargo build --release -p wrapyfi_python", library.display());
    }
    std::fs::create_dir_all(&package)?;
    symlink(library, package.join("_native.abi3.so"))?;
    for entry in std::fs::read_dir(&sources)? {
        let entry = entry?;
        symlink(entry.path(), package.join(entry.file_name()))?;
    }
    Ok(all)
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
    pub(crate) fn start(library: Library, repository: &Path, folder: &Path) -> Result<Self> {
        let (interpreter, package) = (interpreter(repository)?, package(repository, folder)?);
        let ((pub_port, sub_port), (rep_port, req_port)) = (ports()?, ports()?);
        let start = |role: &str, acks: u16| {
            let mut command = Command::new(&interpreter);
            if library == Library::Package {
                command.env("PYTHONPATH", &package).args(["-m", "wrapyfi_rs"]);
            }
            command.arg(repository.join("bench/peers/python_wrapyfi.py")).arg(role);
            for (option, port) in [
                ("--pub-port", pub_port),
                ("--sub-port", sub_port),
                ("--rep-port", rep_port),
                ("--req-port", req_port),
                ("--acks", acks),
            ] {
                command.args([option, &port.to_string()]);
            }
            Child::start(&format!("{library:?}-{role}"), command, folder)
        };
        let mut server = start("serve", 0)?;
        server.answer::<serde_json::Value>()?;
        let mut source = start("source", 0)?;
        let Acks { acks } = source.answer()?;
        let (sink, forward) = (start("sink", acks)?, start("forward", 0)?);
        let coder = (library == Library::Wrapyfi).then(|| start("code", 0)).transpose()?;
        Ok(Self { library, interpreter, package, source, sink, forward, _server: server, coder })
    }

    /// Median time of requests for a picture, in microseconds.
    pub(crate) fn asked(&mut self, payload: Kind, count: u32) -> Result<f64> {
        self.source.tell(&json!({ "do": "ask", "payload": name(&payload), "count": count }))?;
        Ok(quantile(&self.source.answer::<Report>()?.latency_us, 0.5))
    }

    /// Percent of a core that a listener takes to which nothing comes.
    pub(crate) fn waiting(&mut self, time: Duration) -> Result<f64> {
        self.sink.tell(&json!({ "way": "hop", "payload": "silent" }))?;
        std::thread::sleep(Duration::from_secs(1));
        let (before, begin) = (proc::cpu_ns(self.sink.id()), Instant::now());
        std::thread::sleep(time);
        let used = proc::cpu_ns(self.sink.id()).saturating_sub(before);
        let share = used as f64 / begin.elapsed().as_nanos() as f64;
        self.sink.tell(&())?;
        Ok(share * 100.0)
    }

    /// Milliseconds that the import takes which scripts begin with.
    pub(crate) fn import(&self) -> Result<f64> {
        let library = if self.library == Library::Wrapyfi { "wrapyfi" } else { "wrapyfi_rs" };
        let text = format!(
            "import time; before = time.perf_counter(); \
             from {library}.connect.wrapper import MiddlewareCommunicator; \
             print((time.perf_counter() - before) * 1000)"
        );
        let mut command = Command::new(&self.interpreter);
        let output = command.env("PYTHONPATH", &self.package).args(["-c", &text]).output()?;
        let said = String::from_utf8_lossy(&output.stdout);
        let found = said.trim().parse();
        found.with_context(|| String::from_utf8_lossy(&output.stderr).into_owned())
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
        let coder = self.coder.as_mut().context("a library whose coding is not measured")?;
        coder.tell(&json!({ "payload": name(&kind), "repeats": repeats }))?;
        coder.answer()
    }
}
