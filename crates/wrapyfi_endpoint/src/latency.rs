//! Latency distribution in constant memory.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::Duration;

use serde::Serialize;

/// Number of buckets per doubling: a quantile is off by at most 1/8 of its value.
const STEPS: u64 = 8;
/// Number of doublings covered: 1 µs to about 9 minutes.
const DOUBLINGS: u64 = 30;
const BUCKETS: usize = ((DOUBLINGS + 1) * STEPS) as usize;

/// A histogram of durations with logarithmic buckets from 1 µs, safe to share between threads.
///
/// ```
/// use std::time::Duration;
/// use wrapyfi_endpoint::Latency;
/// let latency = Latency::default();
/// (1..=100).for_each(|ms| latency.record(Duration::from_millis(ms)));
/// let summary = latency.summary();
/// assert!((44_000..57_000).contains(&summary.p50_us), "{summary:?}");
/// assert!(summary.p99_us > summary.p50_us);
/// ```
#[derive(Debug, Default)]
pub struct Latency {
    /// Made with the first duration: a route that has carried nothing keeps 2 KiB less.
    buckets: OnceLock<Box<[AtomicU64; BUCKETS]>>,
}

/// Quantiles of a [`Latency`], in microseconds; zero when nothing was recorded.
///
/// See [`Latency`].
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_endpoint as endpoint; }
/// use wrapyfi_core::endpoint::{Context, LatencySummary};
/// let none_yet = Context::default().counters.snapshot().latency;
/// assert_eq!(none_yet, LatencySummary { p50_us: 0, p99_us: 0 });
/// ```
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct LatencySummary {
    /// Median: half of the messages were faster.
    pub p50_us: u64,
    /// 99th percentile: 99 % of the messages were faster.
    pub p99_us: u64,
}

impl Latency {
    /// Adds one duration.
    pub fn record(&self, duration: Duration) {
        let micros = u64::try_from(duration.as_micros()).unwrap_or(u64::MAX);
        let buckets =
            self.buckets.get_or_init(|| Box::new(std::array::from_fn(|_| AtomicU64::new(0))));
        if let Some(bucket) = buckets.get(index_of(micros)) {
            bucket.fetch_add(1, Relaxed);
        }
    }

    /// Quantiles of the durations so far.
    pub fn summary(&self) -> LatencySummary {
        let Some(buckets) = self.buckets.get() else { return LatencySummary::default() };
        let counts = buckets.each_ref().map(|bucket| bucket.load(Relaxed));
        let total: u64 = counts.iter().sum();
        let quantile = |percent: u64| {
            let rank = total.saturating_mul(percent).div_ceil(100);
            let mut seen = 0;
            counts
                .iter()
                .position(|count| {
                    seen += count;
                    seen >= rank && rank > 0
                })
                .map_or(0, lower_bound)
        };
        LatencySummary { p50_us: quantile(50), p99_us: quantile(99) }
    }
}

/// Index of a duration's bucket: below `STEPS` µs every microsecond has its own, above there are
/// `STEPS` for each doubling.
fn index_of(micros: u64) -> usize {
    if micros < STEPS {
        return usize::try_from(micros).unwrap_or(0);
    }
    let doubling = u64::from(micros.ilog2() - STEPS.ilog2());
    let step = (micros >> doubling) - STEPS;
    let index = (doubling + 1).saturating_mul(STEPS) + step;
    usize::try_from(index).unwrap_or(usize::MAX).min(BUCKETS - 1)
}

fn lower_bound(index: usize) -> u64 {
    let index = index as u64;
    if index < STEPS { index } else { (STEPS + index % STEPS) << (index / STEPS - 1) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_within_an_eighth() {
        let latency = Latency::default();
        for micros in 1..=1000 {
            latency.record(Duration::from_micros(micros));
        }
        let LatencySummary { p50_us, p99_us } = latency.summary();
        assert!((440..=500).contains(&p50_us), "{p50_us}");
        assert!((868..=990).contains(&p99_us), "{p99_us}");
    }

    #[test]
    fn every_bucket_starts_where_the_last_ended() {
        for micros in (0..5000).chain([1 << 20, 1 << 30, (1 << 34) + 12345]) {
            let index = index_of(micros);
            if index < BUCKETS - 1 {
                assert!(
                    lower_bound(index) <= micros && micros < lower_bound(index + 1),
                    "{micros}"
                );
            }
        }
        assert_eq!(index_of(u64::MAX), BUCKETS - 1);
    }

    #[test]
    fn nothing_recorded_is_zero() {
        assert_eq!(Latency::default().summary(), LatencySummary::default());
    }
}
