//! Losses, told by the numbers that writers give their samples: no DDS stack here reports them all.
//!
//! ```text
//!   writer, number ─▶ Gaps ─▶ how many between it and the highest before
//! ```

use std::collections::HashMap;
use std::hash::Hash;

/// Writers whose highest number is remembered.
const MAX_WRITERS: usize = 4096;

/// Numbers that are missing between the samples of each writer.
#[derive(Debug)]
pub(super) struct Gaps<W> {
    highest: HashMap<W, i64>,
    missing: u64,
}

impl<W> Default for Gaps<W> {
    fn default() -> Self {
        Self { highest: HashMap::new(), missing: 0 }
    }
}

impl<W: Eq + Hash> Gaps<W> {
    /// Notes a sample of the writer `writer`. The first one of each begins the count: what was before
    /// it was not for this reader. One that comes after a higher one has been overtaken: it is no news.
    pub(super) fn note(&mut self, writer: W, number: i64) {
        if self.highest.len() >= MAX_WRITERS && !self.highest.contains_key(&writer) {
            self.highest.clear();
        }
        let highest = self.highest.entry(writer).or_insert(number);
        let missing = number.saturating_sub(*highest).saturating_sub(1);
        self.missing = self.missing.saturating_add(u64::try_from(missing).unwrap_or(0));
        *highest = number.max(*highest);
    }

    /// Number of missing samples that were not returned before.
    pub(super) fn take(&mut self) -> u64 {
        std::mem::take(&mut self.missing)
    }

    /// Forgets the writers that `stays` does not name.
    #[cfg(feature = "fastdds-services")]
    pub(super) fn retain(&mut self, stays: impl Fn(&W) -> bool) {
        self.highest.retain(|writer, _| stays(writer));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_missing_is_counted_per_writer_and_once() {
        let mut gaps = Gaps::default();
        for (writer, number) in [(1, 7), (2, 100), (1, 8), (1, 12), (2, 101), (1, 12), (1, 11)] {
            gaps.note(writer, number);
        }
        assert_eq!((gaps.take(), gaps.take()), (3, 0));
        gaps.note(1, 14);
        assert_eq!(gaps.take(), 1);
    }

    #[test]
    fn gaps_are_losses_whatever_the_order() {
        let mut gaps = Gaps::default();
        let lost: Vec<_> = [5, 6, 9, 8, 9, 10, i64::MAX, i64::MIN]
            .into_iter()
            .map(|number| {
                gaps.note([7; 16], number);
                gaps.take()
            })
            .collect();
        let far = i64::MAX as u64 - 11;
        assert_eq!(lost, [0, 0, 2, 0, 0, 0, far, 0]);
    }

    #[test]
    fn many_writers_take_bounded_room() {
        let mut gaps = Gaps::default();
        for writer in 0..3 * MAX_WRITERS as i64 {
            gaps.note(writer, writer);
        }
        assert!(gaps.highest.len() <= MAX_WRITERS);
        assert_eq!(gaps.take(), 0);
    }

    #[cfg(feature = "fastdds-services")]
    #[test]
    fn a_writer_that_left_begins_anew() {
        let mut gaps = Gaps::default();
        gaps.note(1, 1);
        gaps.note(2, 1);
        gaps.retain(|writer| *writer != 1);
        gaps.note(1, 5);
        gaps.note(2, 3);
        assert_eq!(gaps.take(), 1);
    }
}
