//! Budget of the bytes that may wait in this process, in queues, begun messages and requests.
//!
//! ```text
//!   queue, begun message, pending request ── Share::take ──▶ one budget (limits: waiting_mib)
//! ```
//!
//! Each peer or queue has a share. One share may take a quarter of the budget; when all together
//! hold more than the budget, those that hold more than the average are refused first. There are no
//! locks: a message costs three atomic operations.

use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

use std::time::Duration;

use super::freed;
use wrapyfi_data::Limits;

/// Longest time until the next byte of a message that has begun.
pub const PROGRESS: Duration = Duration::from_secs(30);

/// Number of bytes that wait, and the limit on it.
///
/// ```
/// use wrapyfi_endpoint::{Budget, Share};
/// static BUDGET: Budget = Budget::new(100);
/// let (camera, microphone) = (Share::of(&BUDGET), Share::of(&BUDGET));
/// assert!(camera.take(60) && microphone.take(30));
/// assert_eq!(BUDGET.used(), 90);
/// drop(camera);
/// assert_eq!(BUDGET.used(), 30);
/// ```
#[derive(Debug)]
pub struct Budget {
    limit: AtomicUsize,
    used: AtomicUsize,
    /// Most bytes since [`Budget::take_peak`] was called last.
    peak: AtomicUsize,
    /// Number of shares that hold any bytes.
    holders: AtomicUsize,
    /// Budget of which this one is a part, and how many such parts it has.
    whole: Option<(&'static Self, usize)>,
}

/// The budget of this process.
pub static WAITING: Budget = Budget::new(Limits::WAITING_BYTES);

impl Budget {
    /// A budget of `limit` bytes, of which none are taken.
    pub const fn new(limit: usize) -> Self {
        Self {
            limit: AtomicUsize::new(limit),
            used: AtomicUsize::new(0),
            peak: AtomicUsize::new(0),
            holders: AtomicUsize::new(0),
            whole: None,
        }
    }

    /// A budget of one of so many `parts` of another, where its bytes count too: what peers have kept here as long as
    /// they like leaves room for what waits.
    pub const fn part_of(whole: &'static Self, parts: usize) -> Self {
        let whole = Some((whole, parts));
        Self { whole, ..Self::new(0) }
    }

    /// The limit in bytes.
    fn limit(&self) -> usize {
        match self.whole {
            Some((whole, parts)) => whole.limit() / parts.max(1),
            None => self.limit.load(Relaxed),
        }
    }

    /// Adds bytes; their number after that.
    fn add(&self, bytes: usize) -> usize {
        if let Some((whole, _)) = self.whole {
            whole.add(bytes);
        }
        let used = self.used.fetch_add(bytes, Relaxed).saturating_add(bytes);
        self.peak.fetch_max(used, Relaxed);
        used
    }

    fn remove(&self, bytes: usize) {
        if let Some((whole, _)) = self.whole {
            whole.remove(bytes);
        }
        self.used.fetch_sub(bytes, Relaxed);
    }

    /// Sets the limit in bytes, from now on.
    pub fn set_limit(&self, bytes: usize) {
        self.limit.store(bytes, Relaxed);
    }

    /// Number of bytes that wait.
    pub fn used(&self) -> usize {
        self.used.load(Relaxed)
    }

    /// Most bytes that waited since the last call, or wait now.
    pub(super) fn take_peak(&self) -> usize {
        let used = self.used();
        self.peak.swap(used, Relaxed).max(used)
    }
}

/// Bytes of the budget that wait for one peer, or in one queue. Dropping the share gives them back.
///
/// ```
/// use wrapyfi_endpoint::{Budget, Share};
/// static BUDGET: Budget = Budget::new(100);
/// let queue = Share::of(&BUDGET);
/// assert!(queue.take(200)); // a message that waits alone has room
/// assert!(!queue.take(1));
/// queue.give(200);
/// assert_eq!(queue.used(), 0);
/// ```
#[derive(Debug)]
pub struct Share {
    budget: &'static Budget,
    used: AtomicUsize,
}

impl Default for Share {
    /// A share of this process's budget.
    fn default() -> Self {
        Self::of(&WAITING)
    }
}

impl Share {
    /// A share that holds nothing.
    #[must_use]
    pub const fn of(budget: &'static Budget) -> Self {
        Self { budget, used: AtomicUsize::new(0) }
    }

    /// Another share of the same budget, which holds nothing.
    #[must_use]
    pub fn beside(&self) -> Self {
        Self::of(self.budget)
    }

    /// Takes room for a message that will wait; false when there is none. A message that waits
    /// alone in its share always has room, so that a budget that is too small slows down and does
    /// not stop.
    #[must_use]
    pub fn take(&self, bytes: usize) -> bool {
        if bytes == 0 {
            return true;
        }
        freed::note_message(bytes);
        let budget = self.budget;
        let mine = self.used.fetch_add(bytes, Relaxed);
        let all = budget.add(bytes);
        if mine == 0 {
            budget.holders.fetch_add(1, Relaxed);
            return true;
        }
        let mine = mine.saturating_add(bytes);
        let limit = budget.limit();
        let average = limit / budget.holders.load(Relaxed).max(1);
        if mine > limit / 4 || (all > limit && mine > average) {
            self.give(bytes);
            return false;
        }
        true
    }

    /// Takes or gives bytes until the share holds `bytes`; false when there is no room.
    #[must_use]
    pub fn hold(&self, bytes: usize) -> bool {
        freed::note_message(bytes);
        let held = self.used();
        self.give(held.saturating_sub(bytes));
        self.take(bytes.saturating_sub(held))
    }

    /// Gives room back.
    pub fn give(&self, bytes: usize) {
        let before = self.used.fetch_sub(bytes, Relaxed);
        self.budget.remove(bytes);
        if before == bytes && bytes > 0 {
            self.budget.holders.fetch_sub(1, Relaxed);
        }
    }

    /// Number of bytes that the share holds.
    pub fn used(&self) -> usize {
        self.used.load(Relaxed)
    }
}

impl Drop for Share {
    fn drop(&mut self) {
        self.give(self.used());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_share_takes_a_quarter_and_one_message_always() {
        static BUDGET: Budget = Budget::new(100);
        let (one, other) = (Share::of(&BUDGET), Share::of(&BUDGET));
        assert!(one.take(60), "alone");
        assert!(!one.take(1));
        one.give(60);
        assert!(one.take(10) && one.take(15));
        assert!(!one.take(1), "a quarter is held");
        assert!(other.take(25));
        assert_eq!(BUDGET.used(), 50);
        drop(one);
        assert_eq!((BUDGET.used(), BUDGET.holders.load(Relaxed)), (25, 1));
    }

    #[test]
    fn a_part_has_a_limit_of_its_own_and_counts_in_the_whole() {
        static WHOLE: Budget = Budget::new(1600);
        static PART: Budget = Budget::part_of(&WHOLE, 16);
        let (kept, waiting) = (Share::of(&PART), Share::of(&WHOLE));
        assert!(kept.take(20) && kept.take(5) && waiting.take(300));
        assert!(!kept.take(1), "a quarter of the part is held");
        assert_eq!((PART.used(), WHOLE.used()), (25, 325));
        WHOLE.set_limit(3200);
        assert!(kept.take(1), "it follows the whole");
        drop(kept);
        assert_eq!((PART.used(), WHOLE.used()), (0, 300));
    }

    #[test]
    fn who_holds_most_is_refused_first() {
        static BUDGET: Budget = Budget::new(100);
        let shares: [Share; 5] = std::array::from_fn(|_| Share::of(&BUDGET));
        for share in &shares[..4] {
            assert!(share.take(10) && share.take(14));
        }
        assert_eq!(BUDGET.used(), 96);
        assert!(shares[4].take(5), "over the budget, but below the average of 20");
        assert!(shares[4].take(5));
        assert!(!shares[0].take(1), "above the average");
    }

    #[test]
    fn the_peak_is_of_the_time_since_it_was_asked_for() {
        static BUDGET: Budget = Budget::new(100);
        let share = Share::of(&BUDGET);
        assert!(share.take(70));
        share.give(60);
        assert_eq!([BUDGET.take_peak(), BUDGET.take_peak(), BUDGET.used()], [70, 10, 10]);
    }
}
