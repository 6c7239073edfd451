//! Number, size and age of what came to the demo's ROS 2 node.

use std::fmt::Write as _;
use std::time::Duration;

use wrapyfi_endpoint::Latency;

/// Messages that came of one topic, or of the replies of one service.
#[derive(Default)]
pub(super) struct Tally {
    pub(super) count: u64,
    bytes: u64,
    /// Number and bytes when the row was written last.
    printed: (u64, u64),
    latency: Latency,
}

impl Tally {
    /// Counts one of `bytes`, which came `age` after it was sent.
    pub(super) fn add(&mut self, bytes: usize, age: Option<Duration>) {
        self.count += 1;
        self.bytes += bytes as u64;
        if let Some(age) = age {
            self.latency.record(age);
        }
    }

    /// Writes a row, with rates over `elapsed`, the time since the last one.
    pub(super) fn row(&mut self, out: &mut String, name: &str, type_name: &str, elapsed: Duration) {
        let seconds = elapsed.as_secs_f64().max(1e-9);
        let before = std::mem::replace(&mut self.printed, (self.count, self.bytes));
        let latency = self.latency.summary();
        // Writing to a String cannot fail.
        let _infallible = writeln!(
            out,
            "{name:<28}  {type_name:<27} {:>6} {:>6.1} {:>6.2} {:>6.2} {:>6.2}",
            self.count,
            (self.count - before.0) as f64 / seconds,
            (self.bytes - before.1) as f64 / seconds / 1e6,
            latency.p50_us as f64 / 1e3,
            latency.p99_us as f64 / 1e3,
        );
    }
}
