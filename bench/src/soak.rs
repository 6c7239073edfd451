//! Full-HD frames at 30 Hz through the bridge for a minute: losses and growth of memory.

use std::time::{Duration, Instant};

use anyhow::Result;

use crate::case::{Case, Way};
use crate::payload::Kind;
use crate::proc;
use crate::stats;
use crate::turn::Bench;
use crate::worker::{Order, Report};

/// Figures of the soak.
#[derive(Debug, Clone, Default)]
pub(crate) struct Soak {
    /// Duration of the soak in seconds.
    pub(crate) seconds: u32,
    /// The first seconds are not looked at for growth.
    pub(crate) settle: u32,
    /// The source's account.
    pub(crate) report: Report,
    /// Memory of each process: its name, memory at the end in MiB, growth in MiB a minute.
    pub(crate) memory: Vec<(&'static str, f64, f64)>,
}

/// Runs it.
pub(crate) fn run(bench: &Bench, seconds: u32, settle: u32) -> Result<Soak> {
    let mut line = bench.line(Case { way: Way::ZmqToRos, payload: Kind::FullHdRgb })?;
    line.ask(&Order::Warm)?;
    let processes = [
        ("source", line.source.id()),
        ("broker", line.middle.first().map_or(0, crate::child::Child::id)),
        ("bridge", line.middle.get(1).map_or(0, crate::child::Child::id)),
        ("sink", line.sink.id()),
    ];
    let mut seen: [Vec<(f64, f64)>; 4] = Default::default();
    line.source.tell(&Order::Paced { count: seconds * 30, hz: 30.0 })?;
    let start = Instant::now();
    let pause = Duration::from_millis(500);
    while start.elapsed() < Duration::from_secs(u64::from(seconds)) {
        std::thread::sleep(pause);
        let minutes = start.elapsed().as_secs_f64() / 60.0;
        for ((_, pid), points) in processes.iter().zip(&mut seen) {
            points.push((minutes, proc::rss_mib(*pid)));
        }
    }
    let report = line.source.answer()?;
    let from = f64::from(settle) / 60.0;
    let memory = processes
        .iter()
        .zip(&seen)
        .map(|((name, _), points)| {
            let settled: Vec<_> = points.iter().copied().filter(|(x, _)| *x >= from).collect();
            let last = points.last().map_or(0.0, |(_, y)| *y);
            (*name, last, stats::slope(&settled).unwrap_or(f64::NAN))
        })
        .collect();
    Ok(Soak { seconds, settle, report, memory })
}
