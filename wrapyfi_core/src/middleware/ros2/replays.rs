//! Samples that come a second time when a listener is opened again.
//!
//! ```text
//!   old reader ── 1 2 3 4 ┐                        per publisher: the newest source time
//!   new reader ── 2 3 4 5 ┴▶ passes ─▶ 1 2 3 4 5   so far; what is not newer came before
//! ```
//!
//! Two readers overlap for a while so that nothing is missed, and a transient-local publisher
//! replays what it keeps to every new one. A publisher's samples reach a reader in order, so one
//! number for a publisher is enough. Outside of such times nothing is looked at: a publisher whose
//! clock is set back is not silenced by it.

use std::collections::HashMap;
use std::time::{Duration, Instant};

/// Publishers that are remembered.
const MAX_PUBLISHERS: usize = 4096;
/// A replay that has not ended by then is none: its publisher's clock was set back.
const LONGEST_REPLAY: Duration = Duration::from_secs(60);

/// What was delivered, by publisher.
#[derive(Debug, Default)]
pub(super) struct Replays {
    publishers: HashMap<u64, Delivered>,
    overlapping: bool,
    ends: Option<Instant>,
}

#[derive(Debug)]
struct Delivered {
    newest_ns: i64,
    /// The new reader has not shown anything newer yet.
    replaying: bool,
}

impl Replays {
    /// A second reader is opened beside the first.
    pub(super) fn begin(&mut self, now: Instant) {
        self.overlapping = true;
        self.ends = Some(now + LONGEST_REPLAY);
        self.publishers.values_mut().for_each(|delivered| delivered.replaying = true);
    }

    /// The first reader is closed.
    pub(super) fn overlap_ended(&mut self) {
        self.overlapping = false;
    }

    /// Notes a sample; false when it was delivered before.
    pub(super) fn passes(&mut self, publisher: u64, timestamp_ns: i64, now: Instant) -> bool {
        let watching = self.ends.is_some_and(|ends| now < ends);
        if !watching {
            self.ends = None;
        }
        let overlapping = self.overlapping;
        if self.publishers.len() >= MAX_PUBLISHERS && !self.publishers.contains_key(&publisher) {
            self.forget_oldest();
        }
        let delivered = self
            .publishers
            .entry(publisher)
            .or_insert(Delivered { newest_ns: i64::MIN, replaying: overlapping });
        if watching && (overlapping || delivered.replaying) && timestamp_ns <= delivered.newest_ns {
            return false;
        }
        delivered.replaying &= overlapping;
        delivered.newest_ns = timestamp_ns;
        true
    }

    fn forget_oldest(&mut self) {
        let oldest = self.publishers.iter().min_by_key(|(_, delivered)| delivered.newest_ns);
        if let Some((&publisher, _)) = oldest {
            self.publishers.remove(&publisher);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: u64 = 1;
    const B: u64 = 2;

    #[test]
    fn while_readers_overlap_every_sample_passes_once() {
        let (mut replays, now) = (Replays::default(), Instant::now());
        assert!(replays.passes(A, 1, now));
        assert!(replays.passes(A, 2, now));
        replays.begin(now);
        let both = [(A, 1), (A, 2), (A, 3), (B, 1), (A, 3), (B, 1), (B, 2), (A, 4), (B, 2)];
        let passed: Vec<_> =
            both.into_iter().filter(|&(from, at)| replays.passes(from, at, now)).collect();
        assert_eq!(passed, [(A, 3), (B, 1), (B, 2), (A, 4)]);
    }

    #[test]
    fn a_replay_ends_with_the_first_new_sample() {
        let (mut replays, now) = (Replays::default(), Instant::now());
        assert!(replays.passes(A, 10, now));
        replays.begin(now);
        replays.overlap_ended();
        assert!(!replays.passes(A, 9, now));
        assert!(!replays.passes(A, 10, now));
        assert!(replays.passes(A, 11, now));
        // Its clock was set back.
        assert!(replays.passes(A, 5, now));
        // One that was not known has nothing to replay.
        assert!(replays.passes(B, 3, now) && replays.passes(B, 2, now));
    }

    #[test]
    fn nobody_is_silenced_for_long() {
        let (mut replays, now) = (Replays::default(), Instant::now());
        assert!(replays.passes(A, 10, now));
        assert!(replays.passes(A, 5, now));
        replays.begin(now);
        replays.overlap_ended();
        assert!(!replays.passes(A, 4, now));
        assert!(replays.passes(A, 4, now + LONGEST_REPLAY));
    }

    #[test]
    fn what_is_remembered_is_bounded() {
        let (mut replays, now) = (Replays::default(), Instant::now());
        for publisher in 0..2 * MAX_PUBLISHERS as u64 {
            assert!(replays.passes(publisher, i64::try_from(publisher).unwrap(), now));
        }
        assert_eq!(replays.publishers.len(), MAX_PUBLISHERS);
        assert!(!replays.publishers.contains_key(&0));
    }
}
