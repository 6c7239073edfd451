//! Samples that come a second time when a listener is opened again.
//!
//! ```text
//!   old reader ── 1 2 3 4 ┐                        per publisher: the newest source time
//!   new reader ── 2 3 4 5 ┴▶ passes ─▶ 1 2 3 4 5   so far; what is not newer came before
//! ```
//!
//! Two readers overlap for a while so that nothing is missed, and a transient-local publisher
//! replays what it keeps to every new one. A publisher's samples reach a reader in order, so one
//! position for a publisher is enough: the source time, and a number where several samples have the
//! same. Outside of such times nothing is refused: a publisher whose clock is set back is not
//! silenced by it. One that sends no times is heard through the old reader while there are two.

use std::collections::HashMap;
use std::time::{Duration, Instant};

/// Publishers that are remembered.
const MAX_PUBLISHERS: usize = 4096;
/// A replay that has not ended by then is none: its publisher's clock was set back.
const LONGEST_REPLAY: Duration = Duration::from_secs(60);

/// Reader, of two, that a sample came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Through {
    /// The one that stays, or the only one.
    New,
    /// The one that goes.
    Old,
}

/// Source time in nanoseconds, and the how-manieth sample in a row with it.
type Position = (i64, u32);

const NOWHERE: Position = (i64::MIN, 0);

/// Newest sample that was delivered, by publisher.
#[derive(Debug, Default)]
pub(super) struct Replays {
    publishers: HashMap<u64, Delivered>,
    overlapping: bool,
    ends: Option<Instant>,
}

#[derive(Debug)]
struct Delivered {
    newest: Position,
    /// Positions of the new reader and of the old one.
    new: Position,
    old: Position,
    /// Was known before the new reader, which has not shown anything newer yet.
    replaying: bool,
}

impl Replays {
    /// A second reader is opened beside the first.
    pub(super) fn begin(&mut self, now: Instant) {
        self.overlapping = true;
        self.ends = Some(now + LONGEST_REPLAY);
        self.publishers.values_mut().for_each(|delivered| {
            delivered.old = std::mem::replace(&mut delivered.new, NOWHERE);
            delivered.replaying = true;
        });
    }

    /// The first reader is closed.
    pub(super) fn overlap_ended(&mut self) {
        self.overlapping = false;
    }

    /// Notes a sample; false when it was delivered before.
    pub(super) fn passes(
        &mut self,
        through: Through,
        publisher: u64,
        timestamp_ns: i64,
        now: Instant,
    ) -> bool {
        let watching = self.ends.is_some_and(|ends| now < ends);
        if !watching {
            self.ends = None;
        }
        let overlapping = self.overlapping;
        if self.publishers.len() >= MAX_PUBLISHERS && !self.publishers.contains_key(&publisher) {
            self.forget_oldest();
        }
        let delivered = self.publishers.entry(publisher).or_insert(Delivered {
            newest: NOWHERE,
            new: NOWHERE,
            old: NOWHERE,
            replaying: false,
        });
        let reader = match through {
            Through::New => &mut delivered.new,
            Through::Old => &mut delivered.old,
        };
        let same = if reader.0 == timestamp_ns { reader.1 } else { 0 };
        *reader = (timestamp_ns, same.saturating_add(1));
        let position = *reader;
        let stamped = timestamp_ns > 0;
        if watching && (overlapping || delivered.replaying) {
            let before = if stamped {
                position <= delivered.newest
            } else {
                overlapping && delivered.replaying && through == Through::New
            };
            if before {
                return false;
            }
        }
        delivered.replaying &= overlapping;
        delivered.newest = position;
        true
    }

    fn forget_oldest(&mut self) {
        let oldest = self.publishers.iter().min_by_key(|(_, delivered)| delivered.newest);
        if let Some((&publisher, _)) = oldest {
            self.publishers.remove(&publisher);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Through::{New, Old};
    use super::*;

    const A: u64 = 1;
    const B: u64 = 2;

    #[test]
    fn while_readers_overlap_every_sample_passes_once() {
        let (mut replays, now) = (Replays::default(), Instant::now());
        assert!(replays.passes(New, A, 1, now));
        assert!(replays.passes(New, A, 2, now));
        replays.begin(now);
        let both = [
            (New, A, 1),
            (New, A, 2),
            (Old, A, 3),
            (New, B, 1),
            (New, A, 3),
            (Old, B, 1),
            (New, B, 2),
            (New, A, 4),
            (Old, A, 4),
            (Old, B, 2),
        ];
        let passed: Vec<_> = both
            .into_iter()
            .filter(|&(through, from, at)| replays.passes(through, from, at, now))
            .collect();
        assert_eq!(passed, [(Old, A, 3), (New, B, 1), (New, B, 2), (New, A, 4)]);
    }

    #[test]
    fn a_replay_ends_with_the_first_new_sample() {
        let (mut replays, now) = (Replays::default(), Instant::now());
        assert!(replays.passes(New, A, 10, now));
        replays.begin(now);
        replays.overlap_ended();
        assert!(!replays.passes(New, A, 9, now));
        assert!(!replays.passes(New, A, 10, now));
        assert!(replays.passes(New, A, 11, now));
        // Its clock was set back.
        assert!(replays.passes(New, A, 5, now));
        // One that was not known has nothing to replay.
        assert!(replays.passes(New, B, 3, now) && replays.passes(New, B, 2, now));
    }

    #[test]
    fn samples_of_one_moment_are_told_apart() {
        let (mut replays, now) = (Replays::default(), Instant::now());
        assert!(replays.passes(New, A, 10, now) && replays.passes(New, A, 10, now));
        replays.begin(now);
        assert!(replays.passes(Old, A, 10, now));
        for _ in 0..3 {
            assert!(!replays.passes(New, A, 10, now));
        }
        assert!(replays.passes(New, A, 10, now));
        assert!(!replays.passes(Old, A, 10, now));
    }

    #[test]
    fn a_publisher_without_a_clock_is_heard_once() {
        let (mut replays, now) = (Replays::default(), Instant::now());
        assert!(replays.passes(New, A, 0, now));
        replays.begin(now);
        for _ in 0..3 {
            assert!(replays.passes(Old, A, 0, now));
            assert!(!replays.passes(New, A, 0, now));
        }
        // Only the new reader matches this one.
        assert!(replays.passes(New, B, 0, now) && replays.passes(New, B, 0, now));
        replays.overlap_ended();
        assert!(replays.passes(New, A, 0, now) && replays.passes(New, B, 0, now));
    }

    #[test]
    fn nobody_is_silenced_for_long() {
        let (mut replays, now) = (Replays::default(), Instant::now());
        assert!(replays.passes(New, A, 10, now));
        assert!(replays.passes(New, A, 5, now));
        replays.begin(now);
        replays.overlap_ended();
        assert!(!replays.passes(New, A, 4, now));
        assert!(replays.passes(New, A, 4, now + LONGEST_REPLAY));
    }

    #[test]
    fn what_is_remembered_is_bounded() {
        let (mut replays, now) = (Replays::default(), Instant::now());
        for publisher in 0..2 * MAX_PUBLISHERS as u64 {
            let timestamp = i64::try_from(publisher + 1).unwrap();
            assert!(replays.passes(New, publisher, timestamp, now));
        }
        assert_eq!(replays.publishers.len(), MAX_PUBLISHERS);
        assert!(!replays.publishers.contains_key(&0));
    }
}
