//! Processes that a test starts, listens to and ends.

use std::collections::BTreeSet;
use std::io::{BufRead as _, BufReader, Read, Write as _};
use std::os::unix::process::CommandExt as _;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use anyhow::{Context as _, bail};
use rustix::process::{Signal, WaitId, WaitIdOptions, WaitIdStatus, waitid};
use serde_json::Value;

use crate::{Result, TIMEOUT};

/// Everything a process printed so far.
#[derive(Debug, Default)]
pub struct Output {
    /// Lines on stdout.
    pub out: Vec<String>,
    /// Lines on stderr.
    pub err: Vec<String>,
    open: usize,
}

impl Output {
    /// The lines of stdout that are JSON objects.
    pub fn objects(&self) -> impl DoubleEndedIterator<Item = Value> + '_ {
        self.out.iter().filter_map(|line| serde_json::from_str(line).ok()).filter(Value::is_object)
    }

    /// The objects whose `event` is this.
    pub fn events(&self, event: &str) -> Vec<Value> {
        self.objects()
            .filter(|object| object.get("event").and_then(Value::as_str) == Some(event))
            .collect()
    }
}

#[derive(Debug, Default)]
pub(crate) struct ProcessState {
    name: String,
    output: Mutex<Output>,
    changed: Condvar,
    /// Cleared when the test ends the process, or waits for its end.
    should_run: AtomicBool,
}

/// Processes that the rest of a test depends on: where one ends early, every wait ends at once.
pub(crate) type Pillars = Arc<Mutex<Vec<Arc<ProcessState>>>>;

impl ProcessState {
    fn lock(&self) -> MutexGuard<'_, Output> {
        lock(&self.output)
    }
}

/// Locks, also after a panic elsewhere: what a process printed stays readable.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A running program. Dropping it ends it.
#[derive(Debug)]
pub struct Process {
    name: String,
    child: Child,
    stdin: Option<ChildStdin>,
    shared: Arc<ProcessState>,
    pillars: Pillars,
    /// Signal that asks the process to end.
    end: Signal,
}

impl Process {
    /// Starts `command` and reads along.
    pub(crate) fn start(name: &str, mut command: Command, pillars: &Pillars) -> Result<Self> {
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        // Fifteen last lines are shown of a program that failed: the trace of its error would push the error out.
        command.env("RUST_LIB_BACKTRACE", "0");
        // Programs that it starts are ended with it: Wrapyfi's scripts leave their brokers behind.
        command.process_group(0);
        let mut child = command.spawn().with_context(|| format!("starting {name}: {command:?}"))?;
        let shared = Arc::new(ProcessState {
            name: name.to_owned(),
            should_run: true.into(),
            ..ProcessState::default()
        });
        shared.lock().open = 2;
        if let Some(stream) = child.stdout.take() {
            read_along(stream, &shared, |output| &mut output.out);
        }
        if let Some(stream) = child.stderr.take() {
            read_along(stream, &shared, |output| &mut output.err);
        }
        let stdin = child.stdin.take();
        let pillars = Arc::clone(pillars);
        Ok(Self { name: name.to_owned(), child, stdin, shared, pillars, end: Signal::TERM })
    }

    /// SIGINT asks it to end: a program that leaves its children alone at SIGTERM, as `ros2 launch` does.
    #[must_use]
    pub(crate) fn ends_at_interrupt(mut self) -> Self {
        self.end = Signal::INT;
        self
    }

    /// The rest of the test depends on this process: while it should run, its end is a failure.
    #[must_use]
    pub fn pillar(self) -> Self {
        lock(&self.pillars).push(Arc::clone(&self.shared));
        self
    }

    /// Number of the process at the system.
    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// Ports that it has bound: of `udp`, or those of `tcp` at which it listens.
    pub fn ports(&self, protocol: &str) -> Result<BTreeSet<u16>> {
        let pid = self.id();
        let files = std::fs::read_dir(format!("/proc/{pid}/fd"))?;
        let links = files.filter_map(|file| std::fs::read_link(file.ok()?.path()).ok());
        let sockets: BTreeSet<String> = links
            .filter_map(|link| {
                Some(link.to_str()?.strip_prefix("socket:[")?.strip_suffix(']')?.to_owned())
            })
            .collect();
        let mut ports = BTreeSet::new();
        let table = std::fs::read_to_string(format!("/proc/{pid}/net/{protocol}"))?;
        for line in table.lines().skip(1) {
            let columns: Vec<&str> = line.split_whitespace().collect();
            let [_, local, _, state, _, _, _, _, _, inode, ..] = columns[..] else { continue };
            let (_, port) = local.split_once(':').context("no port")?;
            if sockets.contains(inode) && (protocol != "tcp" || state == "0A") {
                ports.insert(u16::from_str_radix(port, 16)?);
            }
        }
        Ok(ports)
    }

    /// Writes one line to its stdin.
    pub fn tell(&mut self, line: &str) -> Result {
        let name = &self.name;
        let stdin = self.stdin.as_mut().with_context(|| format!("stdin of {name} is closed"))?;
        writeln!(stdin, "{line}").with_context(|| format!("writing to {name}"))
    }

    /// Closes its stdin: peers leave then.
    pub fn close_stdin(&mut self) {
        self.stdin = None;
    }

    /// Waits until `found` finds what it looks for in the output.
    ///
    /// # Errors
    /// With the end of its output, where the process ends or [`TIMEOUT`] does.
    pub fn wait_until<T>(
        &self,
        what: &str,
        mut found: impl FnMut(&Output) -> Option<T>,
    ) -> Result<T> {
        let deadline = Instant::now() + TIMEOUT;
        let mut output = self.shared.lock();
        loop {
            if let Some(result) = found(&output) {
                return Ok(result);
            }
            let seen = output.out.len() + output.err.len();
            let ended = output.open == 0;
            let said = tail(&output);
            drop(output);
            let fallen = self.fallen_pillar();
            if ended || fallen.is_some() || Instant::now() >= deadline {
                let why = match fallen {
                    _ if ended => self.end(),
                    Some(name) => format!("{name} ended before"),
                    None => "the time is over".to_owned(),
                };
                bail!("waiting for {what} from {}: {why}\n{said}{}", self.name, self.others());
            }
            output = self.shared.lock();
            // The look above was without the lock: what came since must not wait for more to come.
            if output.out.len() + output.err.len() == seen {
                // Pillars are looked at this often; what this process prints wakes at once.
                let pause = Duration::from_millis(200);
                let waited = self.shared.changed.wait_timeout(output, pause);
                output = waited.unwrap_or_else(PoisonError::into_inner).0;
            }
        }
    }

    /// The end of a process whose output is closed, in words: a signal that ended it is told nowhere else.
    fn end(&self) -> String {
        let Some(status) = self.status() else { return "it closed its output".to_owned() };
        match (status.exit_status(), status.terminating_signal()) {
            (Some(code), _) => format!("it ended with {code}"),
            (None, signal) => format!("signal {} ended it", signal.unwrap_or_default()),
        }
    }

    /// True where its output is closed and the system has ended it, for access to memory that it does not have.
    pub fn has_crashed(&self) -> bool {
        let signal = |status: WaitIdStatus| status.terminating_signal();
        self.shared.lock().open == 0
            && self.status().and_then(signal) == Some(Signal::SEGV.as_raw())
    }

    /// The status of a process whose output is closed. Whoever waits for it or drops it asks for it again.
    fn status(&self) -> Option<WaitIdStatus> {
        let pid = rustix::process::Pid::from_child(&self.child);
        let options = WaitIdOptions::EXITED | WaitIdOptions::NOHANG | WaitIdOptions::NOWAIT;
        // The system closes what a process has open before it says how it ended.
        let deadline = Instant::now() + Duration::from_secs(1);
        loop {
            match waitid(WaitId::Pid(pid), options) {
                Ok(None) if Instant::now() < deadline => {
                    std::thread::sleep(Duration::from_millis(10));
                }
                told => return told.ok().flatten(),
            }
        }
    }

    /// The name of a process that should run and does not.
    fn fallen_pillar(&self) -> Option<String> {
        let pillars = lock(&self.pillars);
        let fallen = pillars.iter().find(|p| p.should_run.load(Relaxed) && p.lock().open == 0)?;
        Some(fallen.name.clone())
    }

    /// Last output of the pillars, for messages.
    fn others(&self) -> String {
        let pillars = lock(&self.pillars);
        let others = pillars.iter().filter(|p| !Arc::ptr_eq(p, &self.shared));
        others.map(|p| format!("\n{}:\n{}", p.name, tail(&p.lock()))).collect()
    }

    /// Waits for one event of a peer.
    ///
    /// # Errors
    /// As [`Process::wait_until`].
    pub fn event(&self, event: &str) -> Result<Value> {
        self.wait_until(&format!("event `{event}`"), |output| {
            output.events(event).into_iter().next()
        })
    }

    /// Waits for the first `count` messages of a peer.
    ///
    /// # Errors
    /// As [`Process::wait_until`].
    pub fn messages(&self, count: usize) -> Result<Vec<Value>> {
        self.wait_until(&format!("{count} messages"), |output| {
            let mut found = output.events("message");
            (found.len() >= count).then(|| {
                found.truncate(count);
                found
            })
        })
    }

    /// Waits for the first `count` JSON objects on stdout.
    ///
    /// # Errors
    /// As [`Process::wait_until`].
    pub fn objects(&self, count: usize) -> Result<Vec<Value>> {
        self.wait_until(&format!("{count} JSON lines"), |output| {
            let found: Vec<Value> = output.objects().take(count).collect();
            (found.len() >= count).then_some(found)
        })
    }

    /// Asserts that this publisher sent `received` one after the other, nothing missing in between.
    /// `key` names the hash in its messages.
    pub fn sent_in_a_row(&self, key: &str, received: &[String]) -> Result {
        self.compare(key, received, |sent, received| {
            sent.windows(received.len()).any(|run| run == received)
        })
    }

    /// Asserts that this publisher sent `received` in this order, perhaps with others in between.
    pub fn sent_in_order(&self, key: &str, received: &[String]) -> Result {
        self.compare(key, received, |sent, received| {
            let mut sent = sent.iter();
            received.iter().all(|one| sent.any(|other| other == one))
        })
    }

    fn compare(
        &self,
        key: &str,
        received: &[String],
        holds: impl Fn(&[String], &[String]) -> bool,
    ) -> Result {
        let last = received.last().context("nothing was received")?;
        // The receiver may be ahead of the line in which the sender tells what it sent.
        self.wait_until(&format!("the message that was received, {last}"), |output| {
            let sent = crate::texts(&output.events("message"), key);
            if holds(&sent, received) {
                return Some(Ok(()));
            }
            // Some more than were received: equal messages may be told apart by their number only.
            let told = (sent.contains(last) && sent.len() >= received.len() + 20)
                || sent.len() >= 400
                || !output.events("done").is_empty();
            told.then(|| {
                Err(anyhow::anyhow!("{} sent {sent:#?}\nreceived was {received:#?}", self.name))
            })
        })?
    }

    /// Sends the signal that asks it to end, SIGTERM.
    pub fn terminate(&self) -> Result {
        self.shared.should_run.store(false, Relaxed);
        self.send(self.end)
    }

    /// Sends SIGINT, as Ctrl-C does.
    pub fn interrupt(&self) -> Result {
        self.shared.should_run.store(false, Relaxed);
        self.send(Signal::INT)
    }

    /// Lets it stand still, with its connections open; [`Process::resume`] lets it go on.
    pub fn pause(&self) -> Result {
        self.send(Signal::STOP)
    }

    /// Lets it go on after [`Process::pause`].
    pub fn resume(&self) -> Result {
        self.send(Signal::CONT)
    }

    /// Sends SIGHUP: it reads its configuration again.
    pub fn hang_up(&self) -> Result {
        self.send(Signal::HUP)
    }

    fn send(&self, signal: Signal) -> Result {
        let pid = rustix::process::Pid::from_child(&self.child);
        rustix::process::kill_process(pid, signal)
            .with_context(|| format!("signalling {}", self.name))
    }

    /// Sends SIGKILL and waits for the end: the process cannot announce it.
    pub fn kill(&mut self) -> Result {
        self.shared.should_run.store(false, Relaxed);
        self.child.kill().with_context(|| format!("killing {}", self.name))?;
        let status = self.child.wait()?;
        if status.code().is_some() {
            bail!("{} had ended before: {status}\n{}", self.name, self.tail());
        }
        Ok(())
    }

    /// Waits for its end and returns the exit code.
    pub fn exit_code(&mut self) -> Result<i32> {
        self.shared.should_run.store(false, Relaxed);
        if !self.ended_within(TIMEOUT)? {
            bail!("{} does not end\n{}", self.name, tail(&self.shared.lock()));
        }
        // The last output may still be on its way.
        self.wait_until("the end of its output", |output| (output.open == 0).then_some(()))?;
        let status = self.child.wait()?;
        status.code().with_context(|| {
            format!("{} was ended by a signal: {status}\n{}", self.name, self.tail())
        })
    }

    /// Waits for its end and asserts the exit code.
    pub fn exits_with(&mut self, expected: i32) -> Result {
        let code = self.exit_code()?;
        if code != expected {
            bail!("{} ended with {code}, expected {expected}\n{}", self.name, self.tail());
        }
        Ok(())
    }

    /// All of stderr so far.
    pub fn stderr(&self) -> String {
        self.shared.lock().err.join("\n")
    }

    /// All of stdout so far.
    pub fn stdout(&self) -> String {
        self.shared.lock().out.join("\n")
    }

    /// The end of its output, for messages.
    pub fn tail(&self) -> String {
        tail(&self.shared.lock())
    }

    fn ended_within(&mut self, limit: Duration) -> Result<bool> {
        let deadline = Instant::now() + limit;
        loop {
            if self.child.try_wait()?.is_some() {
                return Ok(true);
            }
            if Instant::now() >= deadline {
                return Ok(false);
            }
            std::thread::sleep(Duration::from_millis(10));
        }
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        self.shared.should_run.store(false, Relaxed);
        self.stdin = None;
        let ended = self.ended_within(Duration::ZERO).unwrap_or(false)
            || (self.terminate().is_ok()
                && self.ended_within(Duration::from_secs(10)).unwrap_or(false));
        if !ended {
            // Nothing is left to do about a failure here.
            let _killed: std::io::Result<()> = self.child.kill();
            let _status: std::io::Result<_> = self.child.wait();
        }
        let group = rustix::process::Pid::from_child(&self.child);
        // Most groups have no process left.
        let _killed: rustix::io::Result<()> =
            rustix::process::kill_process_group(group, rustix::process::Signal::KILL);
    }
}

fn read_along(
    stream: impl Read + Send + 'static,
    shared: &Arc<ProcessState>,
    lines: impl Fn(&mut Output) -> &mut Vec<String> + Send + 'static,
) {
    let shared = Arc::clone(shared);
    std::thread::spawn(move || {
        let mut reader = BufReader::new(stream);
        let mut line = Vec::new();
        while reader.read_until(b'\n', &mut line).is_ok_and(|read| read > 0) {
            let text = String::from_utf8_lossy(&line).trim_end().to_owned();
            lines(&mut shared.lock()).push(text);
            shared.changed.notify_all();
            line.clear();
        }
        shared.lock().open -= 1;
        shared.changed.notify_all();
    });
}

fn tail(output: &Output) -> String {
    let last = |lines: &[String]| {
        let from = lines.len().saturating_sub(15);
        lines
            .iter()
            .skip(from)
            .map(|l| format!("    {}", l.chars().take(400).collect::<String>()))
            .collect::<Vec<_>>()
    };
    format!(
        "  stdout ends:\n{}\n  stderr ends:\n{}",
        last(&output.out).join("\n"),
        last(&output.err).join("\n")
    )
}
