//! What waits for one target of an output.
//!
//! ```text
//!   write ──push──▶ [ │ │ │ ] ──next──▶ the target's task ──▶ socket
//!                   full: the oldest or the newest is dropped and counted
//! ```

use std::collections::VecDeque;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use tokio::sync::Notify;

use super::message::Message;

/// What gives way when a target's queue is full.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Overflow {
    /// The message that waited longest: the target gets what is newest.
    #[default]
    DropOldest,
    /// The message that is written: the target gets what it missed least of.
    DropNewest,
}

#[derive(Debug, Default)]
struct Queue {
    waiting: VecDeque<Arc<Message>>,
    /// A message was taken and is not sent yet.
    busy: bool,
    closing: bool,
    dead: bool,
}

/// The queue of one target.
#[derive(Debug)]
pub(super) struct Outbox {
    queue: Mutex<Queue>,
    capacity: usize,
    overflow: Overflow,
    filled: Notify,
    stop: Notify,
    /// Told whenever something left.
    moved: Notify,
    pub(super) sent: AtomicU64,
    pub(super) bytes: AtomicU64,
    pub(super) dropped: AtomicU64,
    /// Messages that have no form on the target's carrier.
    pub(super) unsendable: AtomicU64,
}

impl Outbox {
    pub(super) fn new(capacity: usize, overflow: Overflow) -> Self {
        Self {
            queue: Mutex::default(),
            capacity: capacity.max(1),
            overflow,
            filled: Notify::new(),
            stop: Notify::new(),
            moved: Notify::new(),
            sent: AtomicU64::new(0),
            bytes: AtomicU64::new(0),
            dropped: AtomicU64::new(0),
            unsendable: AtomicU64::new(0),
        }
    }

    /// Puts a message in; false when one had to give way.
    pub(super) fn push(&self, message: &Arc<Message>) -> bool {
        let mut queue = self.queue();
        if queue.closing || queue.dead {
            return true;
        }
        let full = queue.waiting.len() >= self.capacity;
        if full {
            self.dropped.fetch_add(1, Ordering::Relaxed);
            if self.overflow == Overflow::DropNewest {
                return false;
            }
            queue.waiting.pop_front();
        }
        queue.waiting.push_back(Arc::clone(message));
        drop(queue);
        self.filled.notify_one();
        !full
    }

    /// Waits until there is room, or the target is gone.
    pub(super) async fn room(&self) {
        self.until(|queue| queue.waiting.len() < self.capacity || queue.closing || queue.dead)
            .await;
    }

    /// Waits until everything was sent, or the target is gone.
    pub(super) async fn drained(&self) {
        self.until(|queue| (queue.waiting.is_empty() && !queue.busy) || queue.dead).await;
    }

    /// Waits until the target's task has ended.
    pub(super) async fn ended(&self) {
        self.until(|queue| queue.dead).await;
    }

    async fn until(&self, holds: impl Fn(&Queue) -> bool) {
        loop {
            let moved = self.moved.notified();
            tokio::pin!(moved);
            // Registered before the look, so that no change falls in between.
            moved.as_mut().enable();
            if holds(&self.queue()) {
                return;
            }
            moved.await;
        }
    }

    /// The next message for the target's task; `None` when it shall say goodbye. Cancel-safe.
    pub(super) async fn next(&self) -> Option<Arc<Message>> {
        loop {
            {
                let mut queue = self.queue();
                if let Some(message) = queue.waiting.pop_front() {
                    queue.busy = true;
                    drop(queue);
                    self.moved.notify_waiters();
                    return Some(message);
                }
                queue.busy = false;
                if queue.closing {
                    return None;
                }
            }
            self.moved.notify_waiters();
            self.filled.notified().await;
        }
    }

    /// Nothing more is taken in; what waits is sent.
    pub(super) fn close(&self) {
        self.queue().closing = true;
        self.filled.notify_one();
        self.moved.notify_waiters();
    }

    /// The target's task shall end at once.
    pub(super) fn abort(&self) {
        self.stop.notify_one();
    }

    /// Waits for [`Outbox::abort`].
    pub(super) async fn aborted(&self) {
        self.stop.notified().await;
    }

    /// The target's task has ended; what waited is dropped and counted.
    pub(super) fn end(&self) {
        let mut queue = self.queue();
        queue.dead = true;
        queue.busy = false;
        let lost = queue.waiting.drain(..).count() as u64;
        drop(queue);
        self.dropped.fetch_add(lost, Ordering::Relaxed);
        self.moved.notify_waiters();
    }

    /// Messages that wait.
    pub(super) fn waiting(&self) -> usize {
        self.queue().waiting.len()
    }

    fn queue(&self) -> std::sync::MutexGuard<'_, Queue> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
