//! Topics of a bag of ROS 1, in place of those of a graph.
//!
//! ```text
//!   BagReader ─ connections ─▶ Types ─▶ Learned, one for each publisher
//!       └────── messages, unread ─────▶ Traffic, one for each topic
//! ```

use std::collections::BTreeMap;
use std::fs::File;
use std::path::Path;

use wrapyfi_bag::ros1::{BagReader, Connection, Limits, OpenError};
use wrapyfi_endpoint::{Discovered, LearnError, Role};
use wrapyfi_interfaces::ros1::Types;

use super::facts::Traffic;
use crate::exit::{Failure, Result};
use crate::learned::Learned;
use crate::shutdown::Shutdown;

/// Messages between two looks whether the process is to end.
const LOOK_EVERY: u64 = 1024;

/// Topics and counts of a bag.
pub(super) struct InBag {
    pub(super) learned: Vec<Learned>,
    /// Messages of each topic.
    pub(super) traffic: BTreeMap<String, Traffic>,
    /// Topics with a publisher that latches.
    pub(super) latched: Vec<String>,
    /// Time from the first message to the last, in seconds.
    pub(super) seconds: f64,
    /// Places that could not be read, a line each.
    pub(super) damage: Vec<String>,
}

/// Reads a bag to its end, and gives its definitions to `types`.
///
/// # Errors
/// Exit code 2 for a file that is no bag, 1 where the system refuses to read.
pub(super) fn read(file: &Path, types: &mut Types, shutdown: &Shutdown) -> Result<InBag> {
    let shown = file.display();
    let usage = |error: &dyn std::fmt::Display| Failure::Usage(format!("{shown}: {error}"));
    let failed = |error: anyhow::Error| Failure::Failed(error.context(shown.to_string()));
    let opened = File::open(file).map_err(|error| usage(&error))?;
    let mut bag = BagReader::open(opened, Limits::default()).map_err(|error| match error {
        OpenError::Io(error) => failed(error.into()),
        other => usage(&other),
    })?;
    let mut counted = BTreeMap::<u32, (u64, u64)>::new();
    let (mut bounds, mut seen) = (None::<(u64, u64)>, 0_u64);
    while let Some(message) = bag.next_message().map_err(|error| failed(error.into()))? {
        let (messages, bytes) = counted.entry(message.connection).or_default();
        *messages += 1;
        *bytes = bytes.saturating_add(message.data.len() as u64);
        let (first, last) = bounds.unwrap_or((message.time_ns, message.time_ns));
        bounds = Some((first.min(message.time_ns), last.max(message.time_ns)));
        seen += 1;
        if seen.is_multiple_of(LOOK_EVERY) && shutdown.requested() {
            break;
        }
    }
    let seconds = bounds.map_or(0.0, |(first, last)| (last - first) as f64 / 1e9);
    let mut topics = BTreeMap::<String, (u64, u64)>::new();
    for (id, connection) in bag.connections() {
        let (messages, bytes) = counted.get(id).copied().unwrap_or_default();
        let sum = topics.entry(global(&connection.topic)).or_default();
        *sum = (sum.0 + messages, sum.1.saturating_add(bytes));
    }
    let traffic = topics.into_iter().map(|(topic, (messages, bytes))| {
        let rate_hz = if seconds > 0.0 { messages as f64 / seconds } else { 0.0 };
        let bytes = bytes.checked_div(messages).unwrap_or_default();
        (topic, Traffic { rate_hz, bytes })
    });
    let latching = bag.connections().values().filter(|one| one.latching);
    let latched = latching.map(|one| global(&one.topic)).collect();
    let damage = bag.damage().to_string().lines().map(str::to_owned).collect();
    let traffic = traffic.collect();
    let learned = bag.connections().values().map(|one| learn(one, types)).collect();
    Ok(InBag { learned, traffic, latched, seconds, damage })
}

/// Name of a topic as the master has it: a recording may have left out the first slash.
fn global(topic: &str) -> String {
    format!("/{}", topic.trim_start_matches('/'))
}

fn learn(connection: &Connection, types: &mut Types) -> Learned {
    let Connection { topic, type_name, md5sum, definition, caller, .. } = connection;
    let shown = types.show(type_name, md5sum, definition).map_err(|error| error.to_string());
    let told =
        shown.and_then(|shown| types.ros2_type(&shown.resolved).map_err(|error| error.to_string()));
    let told =
        told.map_err(|reason| LearnError::Undefined { type_name: type_name.clone(), reason });
    let endpoint = Discovered {
        node: caller.clone().filter(|name| !name.is_empty()),
        type_name: Some(type_name.clone()),
        ..Discovered::new(global(topic), Role::Publisher)
    };
    Learned { endpoint, told }
}
