//! The bounded queue between the thread that receives and the thread that takes.
//!
//! ```text
//!  I/O thread ── push ──▶ [ oldest … newest ] ── take ──▶ relay
//!                 │              │
//!                 └─ full: drop oldest │ drop newest │ hand back (block)
//! ```
//!
//! What waits counts against the budget of the process, in bytes: see `budget`.
//!
//! The I/O thread never blocks here: under policy `block` it is handed its message back and must
//! stop reading that one source until there is room, so that other sources go on.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use super::budget::Share;
use super::counters::{Counters, DropReason};
use super::wake::Wake;

/// What a full queue does with the next message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Overflow {
    /// Drops the message that waited longest: right for streams, where the newest counts.
    DropOldest,
    /// Drops the message that just came.
    DropNewest,
    /// Stops reading the source until there is room, at most this long; then drops the newest.
    Block(Duration),
}

/// Length and policy of a route's queue.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct QueueSpec {
    /// Messages held at most; at least 1.
    pub depth: usize,
    /// What happens beyond that.
    pub overflow: Overflow,
}

impl Default for QueueSpec {
    fn default() -> Self {
        Self { depth: 10, overflow: Overflow::DropOldest }
    }
}

/// What may wait in a queue.
pub trait Waits {
    /// Bytes that it holds.
    fn bytes(&self) -> usize;
}

/// Opens a queue. `wake` is rung for every message accepted, drops are counted in `counters`.
#[must_use]
pub fn inbox<T: Waits>(
    spec: QueueSpec,
    counters: Arc<Counters>,
    wake: Wake,
) -> (Sender<T>, Receiver<T>) {
    let shared = Arc::new(Shared {
        share: Share::default(),
        queue: Mutex::new(VecDeque::with_capacity(spec.depth.min(1024))),
        closed: AtomicBool::new(false),
        spec,
        counters,
        wake,
    });
    (Sender(Arc::clone(&shared)), Receiver(shared))
}

#[derive(Debug)]
struct Shared<T> {
    share: Share,
    queue: Mutex<VecDeque<T>>,
    /// Set, under the lock of the queue, when the receiver goes.
    closed: AtomicBool,
    spec: QueueSpec,
    counters: Arc<Counters>,
    wake: Wake,
}

impl<T: Waits> Shared<T> {
    /// A message waits no more.
    fn leaves(&self, message: Option<&T>) {
        if let Some(message) = message {
            self.share.give(message.bytes());
        }
    }
}

impl<T> Shared<T> {
    fn lock(&self) -> MutexGuard<'_, VecDeque<T>> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Fills an inbox.
#[derive(Debug)]
pub struct Sender<T>(Arc<Shared<T>>);

/// Empties an inbox.
#[derive(Debug)]
pub struct Receiver<T: Waits>(Arc<Shared<T>>);

impl<T: Waits> Sender<T> {
    /// Queues `message`. It is dropped where the process holds as many bytes as it may.
    ///
    /// # Errors
    /// Hands the message back when there is no room under [`Overflow::Block`]: stop reading the
    /// source until [`Sender::has_room`], or give up with [`Sender::give_up`] after the deadline.
    pub fn push(&self, message: T) -> Result<(), T> {
        let shared = &*self.0;
        let mut queue = shared.lock();
        if shared.closed.load(Relaxed) {
            shared.counters.dropped(DropReason::Closed);
            return Ok(());
        }
        if queue.len() >= shared.spec.depth.max(1) {
            match shared.spec.overflow {
                Overflow::DropOldest => shared.leaves(queue.pop_front().as_ref()),
                Overflow::DropNewest => {
                    drop(queue);
                    shared.counters.dropped(DropReason::QueueFull);
                    return Ok(());
                }
                Overflow::Block(_) => return Err(message),
            }
            shared.counters.dropped(DropReason::QueueFull);
        }
        if !shared.share.take(message.bytes()) {
            if matches!(shared.spec.overflow, Overflow::Block(_)) {
                return Err(message);
            }
            shared.counters.dropped(DropReason::OverBudget);
            return Ok(());
        }
        queue.push_back(message);
        drop(queue);
        shared.wake.ring();
        Ok(())
    }

    /// Queues `message` where there is room, whatever the policy.
    ///
    /// # Errors
    /// Hands the message back when the queue is full.
    pub fn offer(&self, message: T) -> Result<(), T> {
        let shared = &*self.0;
        let mut queue = shared.lock();
        if shared.closed.load(Relaxed) {
            shared.counters.dropped(DropReason::Closed);
            return Ok(());
        }
        if queue.len() >= shared.spec.depth.max(1) || !shared.share.take(message.bytes()) {
            return Err(message);
        }
        queue.push_back(message);
        drop(queue);
        shared.wake.ring();
        Ok(())
    }

    /// True when the next push is accepted without a drop.
    #[must_use]
    pub fn has_room(&self) -> bool {
        self.0.lock().len() < self.0.spec.depth.max(1)
    }

    /// Counts a message that policy [`Overflow::Block`] could not place within its deadline.
    pub fn give_up(&self, message: T) {
        drop(message);
        self.0.counters.dropped(DropReason::BlockDeadline);
    }

    /// Length and policy.
    #[must_use]
    pub fn spec(&self) -> QueueSpec {
        self.0.spec
    }

    /// The counters drops go to.
    #[must_use]
    pub fn counters(&self) -> &Counters {
        &self.0.counters
    }

    /// True when the receiver is gone: nobody will take what is pushed.
    #[must_use]
    pub fn is_closed(&self) -> bool {
        Arc::strong_count(&self.0) < 2
    }
}

impl<T: Waits> Receiver<T> {
    /// The oldest message, if any.
    pub fn pop(&self) -> Option<T> {
        let message = self.0.lock().pop_front();
        self.0.leaves(message.as_ref());
        message
    }

    /// Messages waiting.
    #[must_use]
    pub fn len(&self) -> usize {
        self.0.lock().len()
    }

    /// True when nothing waits.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Messages that nobody took are lost, and counted.
impl<T: Waits> Drop for Receiver<T> {
    fn drop(&mut self) {
        let left = {
            let mut queue = self.0.lock();
            self.0.closed.store(true, Relaxed);
            std::mem::take(&mut *queue)
        };
        left.iter().for_each(|message| self.0.leaves(Some(message)));
        self.0.counters.dropped_many(DropReason::Closed, left.len() as u64);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    impl Waits for u32 {
        fn bytes(&self) -> usize {
            4
        }
    }

    fn open(depth: usize, overflow: Overflow) -> (Sender<u32>, Receiver<u32>, Arc<Counters>) {
        let counters = Arc::new(Counters::default());
        let (tx, rx) = inbox(QueueSpec { depth, overflow }, Arc::clone(&counters), Wake::new());
        (tx, rx, counters)
    }

    fn drain(rx: &Receiver<u32>) -> Vec<u32> {
        std::iter::from_fn(|| rx.pop()).collect()
    }

    #[test]
    fn drop_oldest_keeps_the_newest_and_counts() {
        let (tx, rx, counters) = open(2, Overflow::DropOldest);
        for n in 0..5 {
            tx.push(n).unwrap();
        }
        assert_eq!(drain(&rx), [3, 4]);
        assert_eq!(counters.snapshot().dropped_for(DropReason::QueueFull), 3);
    }

    #[test]
    fn drop_newest_keeps_the_oldest_and_counts() {
        let (tx, rx, counters) = open(2, Overflow::DropNewest);
        for n in 0..5 {
            tx.push(n).unwrap();
        }
        assert_eq!(drain(&rx), [0, 1]);
        assert_eq!(counters.snapshot().dropped_for(DropReason::QueueFull), 3);
    }

    #[test]
    fn block_hands_back_until_there_is_room() {
        let (tx, rx, counters) = open(1, Overflow::Block(Duration::from_secs(1)));
        tx.push(1).unwrap();
        let held = tx.push(2).unwrap_err();
        assert!(!tx.has_room());
        assert_eq!(rx.pop(), Some(1));
        assert!(tx.has_room());
        tx.push(held).unwrap();
        tx.give_up(3);
        assert_eq!(drain(&rx), [2]);
        assert_eq!(counters.snapshot().dropped_for(DropReason::BlockDeadline), 1);
        drop(rx);
        assert!(tx.is_closed());
    }

    #[test]
    fn what_nobody_took_is_counted_when_the_receiver_goes() {
        let (tx, rx, counters) = open(4, Overflow::DropOldest);
        (0..3).for_each(|n| tx.push(n).unwrap());
        assert_eq!(rx.pop(), Some(0));
        drop(rx);
        assert_eq!(counters.snapshot().dropped_for(DropReason::Closed), 2);
        tx.push(3).unwrap();
        tx.offer(4).unwrap();
        assert_eq!(counters.snapshot().dropped_for(DropReason::Closed), 4);
    }

    #[test]
    fn what_waits_holds_bytes_until_it_is_taken_or_lost() {
        let (tx, rx, _) = open(8, Overflow::DropOldest);
        (0..9).for_each(|n| tx.push(n).unwrap());
        assert_eq!(rx.0.share.used(), 32);
        assert_eq!(rx.pop(), Some(1));
        assert_eq!(rx.0.share.used(), 28);
        drop(rx);
        assert_eq!(tx.0.share.used(), 0);
    }

    #[test]
    fn what_is_over_the_budget_is_dropped_or_handed_back() {
        struct Large;
        impl Waits for Large {
            fn bytes(&self) -> usize {
                crate::Limits::WAITING_BYTES / 5
            }
        }
        for (overflow, dropped) in [(Overflow::DropOldest, 1), (Overflow::Block(Duration::ZERO), 0)]
        {
            let counters = Arc::new(Counters::default());
            let spec = QueueSpec { depth: 9, overflow };
            let (tx, rx) = inbox(spec, Arc::clone(&counters), Wake::new());
            assert!(tx.push(Large).is_ok());
            assert_eq!(tx.push(Large).is_err(), dropped == 0);
            assert_eq!(counters.snapshot().dropped_for(DropReason::OverBudget), dropped);
            assert_eq!(rx.len(), 1);
        }
    }

    #[test]
    fn a_push_rings() {
        let counters = Arc::new(Counters::default());
        let wake = Wake::new();
        let (tx, _rx) = inbox(QueueSpec::default(), counters, wake.clone());
        tx.push(7).unwrap();
        assert!(wake.wait(Duration::from_secs(60)));
    }
}
