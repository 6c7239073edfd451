//! A bridge with a thousand routes at rest: what it takes to open them, to have them, and to change one.
//!
//! ```text
//!   /many/0 … /many/999 ─▶ broker of the bridge ─▶ 1000 routes ─▶ ros2:/many/0 … /many/999
//!   PUB ─▶ every tenth of them, while the file has another queue for one
//! ```
//!
//! When a route is open, and open again, the bridge's log tells to the microsecond. Nobody listens: messages are
//! counted as they are taken.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use anyhow::{Context as _, Result, ensure};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;

use crate::child::Child;
use crate::proc;
use crate::turn::{Bench, ports};
use crate::wire::zmq::connect_publisher;

/// Routes.
const ROUTES: usize = 1000;
/// The one that changes.
const CHANGED: usize = 500;
/// Every so many carry messages meanwhile.
const STEP: usize = 10;
/// Time for which messages flow, with the change in the middle.
const FLOW: Duration = Duration::from_secs(2);
/// Pause between two measurements.
const SETTLE: Duration = Duration::from_secs(3);
/// Longest time that opening may take.
const TIMEOUT: Duration = Duration::from_secs(60);

/// Results of one run.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Many {
    /// Time from the start of the process to the last route that opened, in milliseconds.
    pub(crate) opening_ms: f64,
    pub(crate) threads: usize,
    pub(crate) rss_mib: f64,
    /// Percent of one core at rest, and for how long it was measured.
    pub(crate) share: f64,
    pub(crate) seconds: u32,
    /// Time from the signal to the changed route that is open again, in milliseconds.
    pub(crate) reload_ms: f64,
    /// Messages on the other routes around the change, and those of them that were not taken.
    pub(crate) sent: u64,
    pub(crate) lost: u64,
}

/// Measures it; the share over so many seconds.
pub(crate) fn run(bench: &Bench, seconds: u32) -> Result<Many> {
    let (pub_port, sub_port) = ports()?;
    let domain = bench.domain();
    let file = bench.folder.join("many.yaml");
    let write = |queue: usize| {
        let mut text = format!(
            "endpoints:\n  zeromq: {{ pub_port: {pub_port}, sub_port: {sub_port}, broker: embedded }}\n  \
             ros2: {{ domain_id: {domain}, interface: lo }}\nroutes:\n"
        );
        for n in 0..ROUTES {
            let depth = if n == CHANGED { queue } else { 100 };
            text.push_str(&format!(
                "  - {{ name: many_{n}, from: \"zeromq:/many/{n}\", to: \"ros2:/many/r{n}\", type: NativeObject, \
                 queue_depth: {depth} }}\n"
            ));
        }
        let beside = bench.folder.join("many_new.yaml");
        std::fs::write(&beside, text)?;
        std::fs::rename(beside, &file)
    };
    write(100)?;
    let mut command = bench.command(&bench.wrapyfi);
    command.args(["bridge", "--json", "--config"]).arg(&file);
    let log = bench.folder.join("many.log");
    let start = now();
    let mut bridge = Child::start("many", command, &bench.folder)?;
    let last = until(|| {
        let open = opened(&log, start);
        (open.len() == ROUTES).then(|| open.into_values().fold(0.0, f64::max))
    });
    let opening_ms = (last.context("routes that do not open")? - start) * 1e3;
    std::thread::sleep(SETTLE);
    let before = (proc::cpu_of(bridge.id()), Instant::now());
    std::thread::sleep(Duration::from_secs(u64::from(seconds)));
    #[allow(clippy::cast_precision_loss)]
    let used = proc::cpu_of(bridge.id()).saturating_sub(before.0) as f64;
    let share = used / 1e9 / before.1.elapsed().as_secs_f64() * 100.0;
    let tasks = std::fs::read_dir(format!("/proc/{}/task", bridge.id()))?;
    let (threads, rss_mib) = (tasks.count(), proc::rss_mib(bridge.id()));

    let publisher = connect_publisher(sub_port)?;
    std::thread::sleep(SETTLE);
    let topics: Vec<String> = (0..ROUTES).step_by(STEP).map(|n| format!("/many/{n}")).collect();
    let (mut sent, mut turned) = (0, None);
    let begin = Instant::now();
    while begin.elapsed() < FLOW {
        if turned.is_none() && begin.elapsed() > FLOW / 2 {
            write(200)?;
            turned = Some(now());
            let pid = Pid::from_raw(i32::try_from(bridge.id())?).context("no process")?;
            kill_process(pid, Signal::HUP)?;
        }
        for topic in &topics {
            publisher.send_multipart([topic.as_bytes(), b"{}", b"[1]"], 0)?;
        }
        sent += 1;
        std::thread::sleep(Duration::from_millis(2));
    }
    let turned = turned.context("too short")?;
    let again = until(|| opened(&log, turned).get(&format!("many_{CHANGED}")).copied());
    let reload_ms = (again.context("the changed route does not open again")? - turned) * 1e3;
    // All but the one that begins anew.
    let sent = sent * (topics.len() as u64 - 1);
    let taken = until(|| {
        let taken = received(&mut bridge).ok()?;
        (taken == sent).then_some(taken)
    });
    let taken = taken.map_or_else(|| received(&mut bridge), Ok)?;
    ensure!(bridge.runs(), "the bridge ended");
    let lost = sent.saturating_sub(taken);
    Ok(Many { opening_ms, threads, rss_mib, share, seconds, reload_ms, sent, lost })
}

/// Seconds since 1970, as the log has them.
fn now() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs_f64()
}

/// Result of `look`, if one comes within [`TIMEOUT`].
fn until<T>(mut look: impl FnMut() -> Option<T>) -> Option<T> {
    let end = Instant::now() + TIMEOUT;
    while Instant::now() < end {
        let found = look();
        if found.is_some() {
            return found;
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    None
}

/// Routes that the log says to be open, and when the last of each was, after `since`.
fn opened(log: &Path, since: f64) -> BTreeMap<String, f64> {
    let text = std::fs::read_to_string(log).unwrap_or_default();
    let open = text.lines().filter_map(|line| {
        let (head, state) = line.split_once("]: ")?;
        let mut parts = head.split("] [");
        let (_level, stamp, logger) = (parts.next()?, parts.next()?, parts.next()?);
        let stamp: f64 = stamp.parse().ok()?;
        // Open, and nobody at one of its ends.
        let is_open = [
            "waiting for a publisher",
            "waiting for a listener",
            "waiting for a subscriber",
            "active",
        ]
        .iter()
        .any(|word| state.starts_with(word));
        (is_open && stamp >= since).then(|| (logger.rsplit('.').next().unwrap_or(logger), stamp))
    });
    open.map(|(route, stamp)| (route.to_owned(), stamp)).collect()
}

/// Messages that routes have taken, but for the one that begins anew.
fn received(bridge: &mut Child) -> Result<u64> {
    let status: Value = bridge.answer()?;
    let routes = status.get("routes").and_then(Value::as_array).context("no routes")?;
    let changed = format!("many_{CHANGED}");
    let taken = routes.iter().filter(|route| route.get("name").is_some_and(|it| *it != changed));
    let count = |route: &Value| route.pointer("/counters/received").and_then(Value::as_u64);
    Ok(taken.filter_map(count).sum())
}
