//! Images of 6 MB at 30 Hz and transforms at 200 Hz together, through our bridge and through rospy:
//! what is lost.

use std::time::Duration;

use anyhow::{Context as _, Result};

use super::{Lines, Load, Master, Way};
use crate::turn::Bench;
use crate::worker::{Order, Report};

/// Loads that are sent together, and messages of each a second.
const LOADS: [(Load, u32); 2] = [(Load::Image, 30), (Load::Tf, 200)];

/// Figures of both streams.
#[derive(Debug, Clone)]
pub(crate) struct Streams {
    /// Duration of the streams in seconds.
    pub(crate) seconds: u32,
    /// The accounts of the sources.
    pub(crate) reports: Vec<(Load, Report)>,
    /// Percent of a core that stood between the ends took.
    pub(crate) share: f64,
}

impl Streams {
    /// Messages that were sent and did not come.
    pub(crate) fn lost(&self) -> u32 {
        let lost = |report: &Report| (report.sent + report.refused).saturating_sub(report.received);
        self.reports.iter().map(|(_, report)| lost(report)).sum()
    }

    /// Messages that came twice.
    pub(crate) fn twice(&self) -> u32 {
        self.reports.iter().map(|(_, report)| report.duplicates).sum()
    }

    /// Messages that were sent.
    pub(crate) fn sent(&self) -> u32 {
        self.reports.iter().map(|(_, report)| report.sent + report.refused).sum()
    }
}

/// Runs them.
pub(crate) fn streams(
    bench: &Bench,
    master: &mut Master,
    way: Way,
    seconds: u32,
) -> Result<Streams> {
    let loads = LOADS.map(|(load, _)| load);
    let mut lines = Lines::start(bench, master, way, &loads)?;
    for line in &mut lines.lines {
        line.ask(&Order::Warm).context("warming up")?;
    }
    let middle = lines.middle.as_ref().map(crate::child::Child::id);
    let used = || middle.map_or(0, crate::proc::cpu_ns);
    let before = used();
    for (line, (_, hz)) in lines.lines.iter_mut().zip(LOADS) {
        line.source.tell(&Order::Paced { count: seconds * hz, hz: hz.into() })?;
    }
    std::thread::sleep(Duration::from_secs(seconds.into()));
    #[allow(clippy::cast_precision_loss)]
    let share = (used() - before) as f64 / 1e7 / f64::from(seconds.max(1));
    let mut reports = Vec::new();
    for (line, load) in lines.lines.iter_mut().zip(loads) {
        reports.push((load, line.source.answer()?));
    }
    Ok(Streams { seconds, reports, share })
}
