//! Many routes of one bridge: what it takes to open them, to have them, and to change one.
//!
//! ```text
//!   /many/0 … /many/999 ─▶ broker of the bridge ─▶ 1000 routes ─▶ ros2:/many/r0 … /many/r999
//!   PUB ─▶ every tenth of them, while the file has another queue for one
//!
//!   400 topics of rospy ─▶ one pattern, 400 routes ─▶ ros2:/many/t0 … /many/t399
//! ```
//!
//! When a route is open, and open again, the bridge's log tells to the microsecond. No program listens: messages are
//! counted as they are taken.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use anyhow::{Context as _, Result, ensure};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;

use crate::child::Child;
use crate::proc;
use crate::report::Limit::{AtMost, Shown};
use crate::report::{Row, Target};
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

/// Resident memory of the bridge, and its number of threads.
fn size(bridge: &Child) -> Result<(f64, f64)> {
    let tasks = std::fs::read_dir(format!("/proc/{}/task", bridge.id()))?;
    Ok((tasks.count() as f64, proc::rss_mib(bridge.id())))
}

/// Percent of a core that the bridge takes over so many seconds.
fn share(bridge: &Child, seconds: u32) -> f64 {
    let before = (proc::cpu_of(bridge.id()), Instant::now());
    std::thread::sleep(Duration::from_secs(u64::from(seconds)));
    let used = proc::cpu_of(bridge.id()).saturating_sub(before.0) as f64;
    used / 1e7 / before.1.elapsed().as_secs_f64()
}

/// Routes from ZeroMQ that the file names one by one; the share over so many seconds.
pub(crate) fn zeromq(bench: &Bench, seconds: u32) -> Result<Vec<Target>> {
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
    let log = bench.folder.join("many.log");
    let open = |options: &[&str]| -> Result<(Child, f64)> {
        let mut command = bench.command(&bench.wrapyfi);
        command.arg("bridge").args(options).arg("--config").arg(&file);
        let start = now();
        let bridge = Child::start("many", command, &bench.folder)?;
        let last = until(|| {
            let open = opened(&log, start);
            (open.len() == ROUTES).then(|| open.into_values().fold(0.0, f64::max))
        });
        let opening_ms = (last.context("routes that do not open")? - start) * 1e3;
        std::thread::sleep(SETTLE);
        Ok((bridge, opening_ms))
    };
    let (bridge, opening_ms) = open(&[])?;
    let at_rest = share(&bridge, seconds);
    let (threads, rss_mib) = size(&bridge)?;
    drop(bridge);
    let (mut bridge, _) = open(&["--json"])?;
    let telling = share(&bridge, seconds);

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
    let lost = sent.saturating_sub(taken) as f64;
    let row = |unit, what: &str| {
        Row::new("routes", unit, format!("1000 routes, ZeroMQ to ROS 2, at rest: {what}"))
    };
    let once = |unit, what: &str, limit, found, parts: String| {
        Target::once(row(unit, what), AtMost(limit), found, parts)
    };
    let over = format!("over {seconds} s");
    Ok(vec![
        once(
            "ms",
            "ms from the program's start until all are open",
            3000.0,
            opening_ms,
            String::new(),
        ),
        Target::once(row("%", "percent of a core").in_readme(), AtMost(2.0), at_rest, &over),
        once("%", "percent of a core with --json, all of it each second", 3.0, telling, over),
        once("", "threads", 64.0, threads, String::new()),
        once("MiB", "resident memory, MiB", 200.0, rss_mib, String::new()),
        once(
            "ms",
            "ms from SIGHUP until a changed one is open again",
            100.0,
            reload_ms,
            String::new(),
        ),
        once("", "messages lost on others meanwhile", 0.0, lost, format!("of {sent}")),
    ])
}

/// Topics of ROS 1 that one pattern means.
const TOPICS: usize = 400;

/// Routes that a pattern makes of topics of rospy, on Debian's master.
pub(crate) fn ros1(bench: &Bench, repository: &Path, seconds: u32) -> Result<Vec<Target>> {
    let python = |args: &[&str], master: &str| {
        let mut command = bench.command(Path::new("/usr/bin/python3"));
        command.arg(repository.join("bench/peers/ros1_topics.py")).args(args);
        command.env("ROS_MASTER_URI", master).env("ROS_IP", "127.0.0.1");
        command.env("ROS_LOG_DIR", &bench.folder).env("ROS_HOME", &bench.folder);
        command
    };
    let found = Command::new("/usr/bin/python3").args(["-c", "import rospy, rosmaster"]).output();
    ensure!(
        found.is_ok_and(|found| found.status.success()),
        "no ROS 1 (Debian 12: apt-get install python3-rosmaster python3-rospy)"
    );
    let port = ports()?.0.to_string();
    let master = format!("http://127.0.0.1:{port}");
    let start = |name: &str, args: &[&str]| -> Result<Child> {
        let mut child = Child::start(name, python(args, &master), &bench.folder)?;
        child.answer::<Value>().map(|_ready| child)
    };
    let _rosmaster = start("rosmaster", &["master", "--port", &port])?;
    let _topics = start("topics", &["topics", "--count", &TOPICS.to_string()])?;
    let (file, log) = (bench.folder.join("ros1.yaml"), bench.folder.join("ros1.log"));
    let domain = bench.domain();
    let mut targets = Vec::new();
    for (is_lazy, title) in [(false, "all open at once"), (true, "lazy, nobody listens")] {
        std::fs::write(
            &file,
            format!(
                "endpoints:\n  ros: {{ master_uri: \"{master}\" }}\n  ros2: {{ domain_id: {domain}, interface: lo }}\n\
                 routes:\n  - {{ from: \"ros:/many/(.*)\", to: \"ros2:/many/$1\", lazy: {is_lazy} }}\n"
            ),
        )?;
        let mut command = bench.command(&bench.wrapyfi);
        // Routes of a pattern tell their state at level debug.
        command
            .args(["--log-level", "debug", "bridge", "--config"])
            .arg(&file)
            .env("ROS_IP", "127.0.0.1");
        let begin = now();
        let bridge = Child::start("ros1", command, &bench.folder)?;
        let all = until(|| {
            let open = opened(&log, begin);
            (open.len() >= TOPICS).then_some(open)
        });
        let open = all.with_context(|| format!("not all of {TOPICS} routes open, {title}"))?;
        let last = open.values().copied().fold(0.0, f64::max);
        let early = open.values().filter(|at| **at <= begin + 3.0).count();
        std::thread::sleep(SETTLE);
        let share = share(&bridge, seconds);
        let (threads, rss_mib) = size(&bridge)?;
        let once = |unit, what: &str, limit, found, parts: String| {
            let what = format!("400 routes of ROS 1 by a pattern, {title}: {what}");
            Target::once(Row::new("routes", unit, what), limit, found, parts)
        };
        targets.extend([
            once(
                "s",
                "seconds from the bridge's start until the last is open",
                AtMost(3.0),
                last - begin,
                format!("{early} of {TOPICS} after 3 s"),
            ),
            once("", "threads", AtMost(64.0), threads, String::new()),
            once("%", "percent of a core at rest", Shown, share, format!("over {seconds} s")),
            once("MiB", "resident memory, MiB", Shown, rss_mib, String::new()),
        ]);
    }
    Ok(targets)
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

/// Routes that the log says to be open, and when each was first, after `since`.
fn opened(log: &Path, since: f64) -> BTreeMap<String, f64> {
    let text = std::fs::read_to_string(log).unwrap_or_default();
    let open = text.lines().filter_map(|line| {
        let (head, state) = line.split_once("]: ")?;
        let mut parts = head.split("] [");
        let (_level, stamp, logger) = (parts.next()?, parts.next()?, parts.next()?);
        let stamp: f64 = stamp.parse().ok()?;
        // Open, and no program at one of its ends.
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
    let mut first = BTreeMap::new();
    for (route, stamp) in open {
        first.entry(route.to_owned()).or_insert(stamp);
    }
    first
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
