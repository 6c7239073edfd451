//! Processes of a measurement: started, told, asked, ended.

use std::fs::File;
use std::io::{BufRead as _, BufReader, Write as _};
use std::path::Path;
use std::process::{Child as Process, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail};
use serde::de::DeserializeOwned;

/// Longest time that an answer may take.
const TIMEOUT: Duration = Duration::from_secs(120);

/// A running program; dropping it ends it.
pub(crate) struct Child {
    name: String,
    process: Process,
    lines: Receiver<String>,
    log: std::path::PathBuf,
}

impl Child {
    /// Starts `command`; what it says on stderr goes to a file in `folder`.
    pub(crate) fn start(name: &str, mut command: Command, folder: &Path) -> Result<Self> {
        let log = folder.join(format!("{name}.log"));
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(File::create(&log)?);
        let mut process = command.spawn().with_context(|| format!("starting {name}"))?;
        let stdout = process.stdout.take().context("a process without stdout")?;
        let (sender, lines) = channel();
        std::thread::spawn(move || {
            for line in BufReader::new(stdout).lines() {
                let Ok(line) = line else { break };
                if sender.send(line).is_err() {
                    break;
                }
            }
        });
        Ok(Self { name: name.to_owned(), process, lines, log })
    }

    /// Id of the process.
    pub(crate) fn id(&self) -> u32 {
        self.process.id()
    }

    /// Writes a line to its stdin.
    pub(crate) fn tell(&mut self, order: &impl serde::Serialize) -> Result<()> {
        let stdin = self.process.stdin.as_mut().context("a process without stdin")?;
        writeln!(stdin, "{}", serde_json::to_string(order)?)
            .with_context(|| format!("telling {}", self.name))
    }

    /// The next JSON object it prints; other lines are passed over.
    pub(crate) fn answer<T: DeserializeOwned>(&mut self) -> Result<T> {
        let deadline = Instant::now() + TIMEOUT;
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            match self.lines.recv_timeout(left) {
                Ok(line) if line.starts_with('{') => {
                    let read = serde_json::from_str(&line);
                    return read.with_context(|| format!("{} says {line}", self.name));
                }
                Ok(_) => {}
                Err(RecvTimeoutError::Timeout) => bail!("{} does not answer", self.name),
                Err(RecvTimeoutError::Disconnected) => {
                    let log = std::fs::read_to_string(&self.log).unwrap_or_default();
                    let from = log.len().saturating_sub(600);
                    bail!("{} ended: {}", self.name, log.get(from..).unwrap_or_default());
                }
            }
        }
    }

    /// True while the process runs.
    pub(crate) fn runs(&mut self) -> bool {
        matches!(self.process.try_wait(), Ok(None))
    }
}

impl Drop for Child {
    fn drop(&mut self) {
        // Ours end when their stdin does; programs of the product are asked.
        drop(self.process.stdin.take());
        let pid = rustix::process::Pid::from_child(&self.process);
        let _gone = rustix::process::kill_process(pid, rustix::process::Signal::TERM);
        for _ in 0..400 {
            if !self.runs() {
                return;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        let _killed = self.process.kill();
        let _status = self.process.wait();
    }
}
