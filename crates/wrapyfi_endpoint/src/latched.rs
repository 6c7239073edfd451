//! The last message of each origin, for listeners that come later.
//!
//! ```text
//!   origin 1 ─▶ a1 ─▶ a2        [ b1, a2 ]  the last of each origin, the one that is kept longest first
//!   origin 2 ─▶ b1              forget(2) ─▶ [ a2 ]
//! ```
//!
//! Publishers keep messages for which their subscribers may come too late, and listeners keep
//! messages that no route wants yet.

use std::collections::VecDeque;

use super::budget::Share;
use super::inbox::Waits;

/// Largest number of origins whose last message is kept.
pub const MAX_ORIGINS: usize = 256;

/// The last message of each origin, oldest first. Its bytes count as waiting in this process.
#[derive(Debug)]
pub struct Latched<K, T> {
    kept: VecDeque<(K, T)>,
    max_bytes: usize,
    share: Share,
}

impl<K: PartialEq, T: Waits> Latched<K, T> {
    /// An empty store, which never holds more than `max_bytes` bytes, but for a single message.
    pub fn new(max_bytes: usize) -> Self {
        Self { kept: VecDeque::new(), max_bytes, share: Share::default() }
    }

    /// Keeps a message in place of the one before it of the same origin; number of messages that
    /// were dropped for it.
    pub fn keep(&mut self, origin: K, message: T) -> u64 {
        let mut gone = u64::from(self.forget(&origin));
        self.kept.push_back((origin, message));
        while self.kept.len() > 1
            && (self.kept.len() > MAX_ORIGINS || self.bytes() > self.max_bytes || !self.counts())
        {
            self.kept.pop_front();
            gone += 1;
        }
        if self.kept.len() == 1 {
            // Alone in its share it always has room.
            _ = self.share.hold(0);
            _ = self.counts();
        }
        gone
    }

    /// Takes the message that was kept longest.
    pub fn pop(&mut self) -> Option<T> {
        let next = self.kept.pop_front().map(|(_, message)| message);
        _ = self.counts();
        next
    }

    /// Drops the message of this origin; true where there was one.
    pub fn forget(&mut self, origin: &K) -> bool {
        let before = self.kept.len();
        self.retain(|kept| kept != origin);
        self.kept.len() < before
    }

    /// Drops the messages of all origins for which `stays` is false.
    pub fn retain(&mut self, stays: impl Fn(&K) -> bool) {
        self.kept.retain(|(origin, _)| stays(origin));
        _ = self.counts();
    }

    /// Messages kept, oldest first.
    pub fn messages(&self) -> impl ExactSizeIterator<Item = &T> {
        self.kept.iter().map(|(_, message)| message)
    }

    fn bytes(&self) -> usize {
        self.messages().map(Waits::bytes).sum()
    }

    /// Counts what is kept as waiting; false when there is no room for it.
    fn counts(&self) -> bool {
        self.share.hold(self.bytes())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Budget;

    struct Message(usize);

    impl Waits for Message {
        fn bytes(&self) -> usize {
            self.0
        }
    }

    fn sizes<K: PartialEq>(kept: &Latched<K, Message>) -> Vec<usize> {
        kept.messages().map(|message| message.0).collect()
    }

    #[test]
    fn the_last_of_each_origin_is_kept_until_it_goes() {
        let mut kept = Latched::new(1000);
        let gone = [(Some(1), 10), (Some(2), 20), (None, 5), (Some(1), 11)]
            .map(|(origin, size)| kept.keep(origin, Message(size)));
        assert_eq!((gone, sizes(&kept)), ([0, 0, 0, 1], vec![20, 5, 11]));
        assert_eq!([kept.forget(&Some(2)), kept.forget(&Some(7))], [true, false]);
        assert_eq!(sizes(&kept), [5, 11]);
        kept.retain(Option::is_none);
        assert_eq!(kept.pop().map(|message| message.0), Some(5));
        assert!(kept.pop().is_none());
    }

    #[test]
    fn what_is_kept_counts_as_waiting_and_gives_way_where_there_is_no_room() {
        static BUDGET: Budget = Budget::new(400);
        let mut kept = Latched { share: Share::of(&BUDGET), ..Latched::new(1000) };
        let gone =
            [(1, 50), (2, 40), (3, 30)].map(|(origin, size)| kept.keep(origin, Message(size)));
        assert_eq!((gone, sizes(&kept), BUDGET.used()), ([0, 0, 1], vec![40, 30], 70));
        assert_eq!((kept.keep(4, Message(500)), BUDGET.used()), (2, 500));
        assert!(kept.pop().is_some());
        assert_eq!(BUDGET.used(), 0);
        kept.keep(5, Message(60));
        drop(kept);
        assert_eq!(BUDGET.used(), 0);
    }

    #[test]
    fn bytes_and_origins_are_bounded_and_one_message_always_stays() {
        let mut kept = Latched::new(100);
        let gone = [(1, 50), (2, 30), (3, 40), (4, 500)]
            .map(|(origin, size)| kept.keep(origin, Message(size)));
        assert_eq!((gone, sizes(&kept)), ([0, 0, 1, 2], vec![500]));
        let mut kept = Latched::new(1 << 20);
        let gone: u64 = (0..MAX_ORIGINS + 3).map(|origin| kept.keep(origin, Message(1))).sum();
        assert_eq!((gone, kept.messages().len()), (3, MAX_ORIGINS));
    }
}
