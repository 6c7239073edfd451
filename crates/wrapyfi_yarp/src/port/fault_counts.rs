//! Counts of everything that a port refused, lost or dropped, by reason.

use std::collections::BTreeMap;

use wrapyfi_retry::Mutex;

use crate::wire::Fault;

/// Counts by reason. Reasons are rare: data on their way are counted elsewhere.
#[derive(Debug, Default)]
pub struct FaultCounts(Mutex<BTreeMap<&'static str, u64>>);

impl FaultCounts {
    /// Counts what a peer did wrong, and says it to the log.
    pub fn count(&self, fault: &Fault) {
        let count = self.add_up(fault.name());
        // The program that connected so waits for messages; peers cannot fill the log with it.
        if count == 1 && fault.is_refusal() {
            tracing::warn!(target: "wrapyfi_yarp::port", "a connection was refused: {fault}");
        } else {
            tracing::debug!(target: "wrapyfi_yarp::port", %fault, "counted");
        }
    }

    /// Counts one under any name.
    pub fn add(&self, reason: &'static str) {
        self.add_up(reason);
    }

    /// Counts one; how many there are now.
    fn add_up(&self, reason: &'static str) -> u64 {
        let mut counts = self.0.lock();
        let count = counts.entry(reason).or_default();
        *count += 1;
        *count
    }

    /// Number of times that one reason was counted.
    pub fn get(&self, reason: &str) -> u64 {
        self.0.lock().get(reason).copied().unwrap_or(0)
    }

    /// All counts.
    pub fn all(&self) -> BTreeMap<&'static str, u64> {
        self.0.lock().clone()
    }
}
