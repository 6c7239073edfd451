//! Losses, told by the numbers that writers give their samples: RustDDS 0.15 reports none.
//!
//! ```text
//!   writer, number ─▶ Numbers ─▶ how many between it and the highest before
//! ```

use std::collections::BTreeMap;

use crate::discovery_info::Gid;

/// Writers whose highest number is remembered.
const MAX_NUMBERED: usize = 4096;

/// The highest number taken from each remote writer.
#[derive(Debug, Default)]
pub(super) struct Numbers(BTreeMap<Gid, i64>);

impl Numbers {
    /// Notes a sample; how many before it never came. One that comes after a higher one has been
    /// overtaken: it is no news.
    pub(super) fn note(&mut self, writer: Gid, number: i64) -> u64 {
        if self.0.len() >= MAX_NUMBERED && !self.0.contains_key(&writer) {
            return 0;
        }
        let highest = self.0.entry(writer).or_insert(number);
        let skipped = number.saturating_sub(*highest).saturating_sub(1);
        *highest = number.max(*highest);
        u64::try_from(skipped).unwrap_or(0)
    }

    /// Forgets the writers that `stays` does not name.
    pub(super) fn retain(&mut self, stays: impl Fn(&Gid) -> bool) {
        self.0.retain(|gid, _| stays(gid));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WRITER: Gid = [7; 16];

    #[test]
    fn gaps_are_losses_whatever_the_order() {
        let mut numbers = Numbers::default();
        let lost: Vec<_> = [5, 6, 9, 8, 9, 10, i64::MAX, i64::MIN]
            .into_iter()
            .map(|number| numbers.note(WRITER, number))
            .collect();
        let far = i64::MAX as u64 - 11;
        assert_eq!(lost, [0, 0, 2, 0, 0, 0, far, 0]);
    }

    #[test]
    fn those_that_left_make_room() {
        let nth = |n: usize| {
            let mut gid = [0; 16];
            gid[..8].copy_from_slice(&n.to_le_bytes());
            gid
        };
        let mut numbers = Numbers::default();
        (0..MAX_NUMBERED).for_each(|n| _ = numbers.note(nth(n), 1));
        assert_eq!((numbers.note(WRITER, 1), numbers.note(WRITER, 5)), (0, 0), "not remembered");
        assert_eq!(numbers.note(nth(0), 3), 1, "known already");
        numbers.retain(|gid| *gid != nth(1));
        assert_eq!((numbers.note(WRITER, 1), numbers.note(WRITER, 5)), (0, 3));
    }
}
