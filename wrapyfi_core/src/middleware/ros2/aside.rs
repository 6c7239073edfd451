//! Messages of transient-local publishers that came when nobody wanted them.
//!
//! ```text
//!   nobody wants it ─▶ keep ─▶ the newest of each publisher ─▶ pop ─ somebody does ─▶ delivered
//!                                └─ an older one, one too many ─▶ dropped, counted
//! ```
//!
//! Such a publisher says with its durability that what it sent last is for whoever comes later. DDS
//! gives it to a subscription once, so the subscription keeps it for its own side.

use std::collections::VecDeque;

use super::inlet::Arrived;

/// Publishers whose last message is kept.
const MAX_PUBLISHERS: usize = 64;

/// The newest message of each publisher, oldest first.
#[derive(Debug)]
pub(super) struct Aside {
    kept: VecDeque<Arrived>,
    bytes: usize,
    max_bytes: usize,
}

impl Aside {
    /// Nothing yet, and never more than `max_bytes` bytes.
    pub(super) fn new(max_bytes: usize) -> Self {
        Self { kept: VecDeque::new(), bytes: 0, max_bytes }
    }

    /// Keeps a message instead of the one before it of the same publisher; how many were dropped.
    pub(super) fn keep(&mut self, message: Arrived) -> u64 {
        let mut dropped = 0;
        let before = self.kept.iter().position(|kept| kept.publisher == message.publisher);
        if let Some(before) = before.and_then(|at| self.kept.remove(at)) {
            self.bytes -= before.cdr.len();
            dropped += 1;
        }
        self.bytes += message.cdr.len();
        self.kept.push_back(message);
        while self.kept.len() > MAX_PUBLISHERS || self.bytes > self.max_bytes {
            if self.pop().is_none() {
                break;
            }
            dropped += 1;
        }
        dropped
    }

    /// The one that came first.
    pub(super) fn pop(&mut self) -> Option<Arrived> {
        let message = self.kept.pop_front()?;
        self.bytes -= message.cdr.len();
        Some(message)
    }

    /// Drops the message of a publisher that is gone; false where there is none.
    pub(super) fn forget(&mut self, publisher: u64) -> bool {
        let at = self.kept.iter().position(|kept| kept.publisher == publisher);
        let Some(message) = at.and_then(|at| self.kept.remove(at)) else { return false };
        self.bytes -= message.cdr.len();
        true
    }

    /// How many are kept.
    pub(super) fn len(&self) -> usize {
        self.kept.len()
    }
}

#[cfg(test)]
mod tests {
    use std::time::Instant;

    use super::*;

    fn message(publisher: u64, size: usize) -> Arrived {
        Arrived { cdr: vec![0; size].into(), at: Instant::now(), publisher }
    }

    fn all(aside: &mut Aside) -> Vec<(u64, usize)> {
        std::iter::from_fn(|| aside.pop()).map(|kept| (kept.publisher, kept.cdr.len())).collect()
    }

    #[test]
    fn the_newest_of_each_publisher_stays() {
        let mut aside = Aside::new(100);
        let dropped =
            [(1, 10), (2, 20), (1, 11), (1, 12)].map(|(who, n)| aside.keep(message(who, n)));
        assert_eq!((dropped, aside.len()), ([0, 0, 1, 1], 2));
        assert_eq!(all(&mut aside), [(2, 20), (1, 12)]);
        assert_eq!((aside.len(), aside.bytes), (0, 0));
        aside.keep(message(3, 30));
        assert_eq!([aside.forget(4), aside.forget(3), aside.forget(3)], [false, true, false]);
        assert_eq!((aside.len(), aside.bytes), (0, 0));
    }

    #[test]
    fn bytes_and_publishers_are_bounded() {
        let mut aside = Aside::new(100);
        let dropped =
            [(1, 60), (2, 40), (3, 50), (4, 101)].map(|(who, n)| aside.keep(message(who, n)));
        assert_eq!(dropped, [0, 0, 1, 3]);
        assert_eq!(all(&mut aside), []);
        let many = MAX_PUBLISHERS as u64;
        let dropped: u64 = (0..many + 3).map(|who| aside.keep(message(who, 1))).sum();
        assert_eq!((dropped, aside.len(), aside.bytes), (3, MAX_PUBLISHERS, MAX_PUBLISHERS));
        assert_eq!(aside.pop().map(|kept| kept.publisher), Some(3));
    }
}
