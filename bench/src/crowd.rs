//! A bridge at rest among many foreign endpoints: what their presence costs it.
//!
//! ```text
//!   source ─▶ broker ─▶ bridge ─▶ sink       one route, open, nothing on it
//!                          ▲
//!                          │ discovery
//!   crowd: 250 writers, 250 readers of a participant of their own, nothing on them either
//! ```

use std::io::Read as _;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, ensure};
use serde::{Deserialize, Serialize};
use wrapyfi_core::codec::ros;
use wrapyfi_core::endpoint::{Qos, Wake};
use wrapyfi_core::middleware::ros2::graph::{
    Graph as _, ServiceMapping, TopicDescription, wait_until,
};
use wrapyfi_core::types::MessageType;

use crate::case::{Case, Way};
use crate::child::Child;
use crate::payload::Kind;
use crate::proc;
use crate::turn::Bench;
use crate::wire::dds::graph;
use crate::worker::{Order, say};

/// Writers, and as many readers.
const EACH: usize = 250;
/// Longest time that discovery may take.
const TIMEOUT: Duration = Duration::from_secs(60);
/// Pause between discovery and the measurement, and before the rest without a crowd.
const SETTLE: Duration = Duration::from_secs(3);

/// Figures of the bridge among foreign endpoints. Shares are of one core, in percent.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rest {
    /// Time for which each share was measured.
    pub(crate) seconds: u32,
    /// Foreign endpoints.
    pub(crate) endpoints: usize,
    /// Share of the bridge before they came.
    pub(crate) alone: f64,
    /// Share of the bridge with them there.
    pub(crate) among: f64,
    /// CPU milliseconds that the bridge took while it got to know them.
    pub(crate) meeting_ms: f64,
    /// Resident memory of the bridge that came with them, in MiB: it knows them.
    pub(crate) grown_mib: f64,
}

#[derive(Serialize, Deserialize)]
struct Told {
    endpoints: usize,
}

/// Measures it, twice for so many seconds.
pub(crate) fn run(bench: &Bench, seconds: u32) -> Result<Rest> {
    let mut line = bench.line(Case { way: Way::ZmqToRos, payload: Kind::Small })?;
    // Proves that the route is open: what follows is a bridge with matched endpoints.
    line.ask(&Order::Warm)?;
    let bridge = line.middle.get(1).context("a line without bridge")?.id();
    std::thread::sleep(SETTLE);
    let alone = share(bridge, seconds);
    let (before, rss) = (proc::cpu_of(bridge), proc::rss_mib(bridge));
    let domain = line.domain.to_string();
    let start = |role: &str| {
        let mut command = bench.command(&bench.own);
        command.args([role, "--domain", &domain]);
        Child::start(role, command, &bench.folder)
    };
    let mut crowd = start("crowd")?;
    let Told { endpoints } = crowd.answer()?;
    // Another participant counts what discovery brings; the bridge hears the same as soon.
    let Told { endpoints: seen } = start("onlooker")?.answer()?;
    ensure!(seen >= endpoints, "{seen} of {endpoints} endpoints were found");
    std::thread::sleep(SETTLE);
    #[allow(clippy::cast_precision_loss)]
    let meeting_ms = proc::cpu_of(bridge).saturating_sub(before) as f64 / 1e6;
    let grown_mib = proc::rss_mib(bridge) - rss;
    let among = share(bridge, seconds);
    ensure!(crowd.runs() && line.middle.iter_mut().all(Child::runs), "a process ended");
    Ok(Rest { seconds, endpoints, alone, among, meeting_ms, grown_mib })
}

/// Percent of one core that a process takes now.
#[allow(clippy::cast_precision_loss)]
fn share(pid: u32, seconds: u32) -> f64 {
    let (before, start) = (proc::cpu_of(pid), Instant::now());
    std::thread::sleep(Duration::from_secs(u64::from(seconds)));
    let used = proc::cpu_of(pid).saturating_sub(before) as f64;
    used / 1e9 / start.elapsed().as_secs_f64() * 100.0
}

/// Runs the crowd until its stdin ends.
pub(crate) fn crowd(domain: u32) -> Result<()> {
    let graph = graph("crowd", domain, ServiceMapping::Cyclone)?;
    let topic = |name: String| TopicDescription {
        name,
        type_name: MessageType::StringJson.ros_type().to_owned(),
        type_hash: Some(ros::type_hash(MessageType::StringJson).to_owned()),
        qos: Qos::default(),
        max_bytes: 1 << 20,
    };
    let mut ends = Vec::new();
    for index in 0..EACH {
        let writer = graph.advertise(&topic(format!("/crowd/out_{index}")), Arc::new(|| {}))?;
        let reader = graph.subscribe(&topic(format!("/crowd/in_{index}")), Arc::new(|| {}))?;
        ends.push((writer, reader));
    }
    say(&serde_json::to_value(Told { endpoints: 2 * ends.len() })?)?;
    let _end = std::io::stdin().read(&mut [0; 1]);
    Ok(())
}

/// Counts the crowd as discovery brings it, and ends.
pub(crate) fn onlooker(domain: u32) -> Result<()> {
    let graph = graph("onlooker", domain, ServiceMapping::Cyclone)?;
    let count = || {
        let found = graph.endpoints().unwrap_or_default();
        found.iter().filter(|found| found.topic.starts_with("/crowd/")).count()
    };
    wait_until(&Wake::new(), TIMEOUT, || count() >= 2 * EACH);
    say(&serde_json::to_value(Told { endpoints: count() })?)
}
