//! Queue of messages that wait for the owner of a port.
//!
//! ```text
//!   connections ──put──▶ newest only: one place, the older one is counted and gone
//!                        strict: so many places; without one, the connection waits, and its sender
//! ```

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use tokio::sync::{Notify, Semaphore, oneshot};

use wrapyfi_retry::Mutex;

use super::message::Received;

/// Rule by which an input port keeps messages until they are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Reading {
    /// The newest unread message only; senders never wait. YARP's `BufferedPort`.
    #[default]
    Newest,
    /// Every message. Senders on tcp and `text_ack` wait while the queue is full; on `fast_tcp` the
    /// sockets fill first; datagrams are dropped and counted.
    Strict {
        /// Most messages that wait, at least 1.
        queue: usize,
        /// Time of the acknowledgement.
        acknowledge: Acknowledge,
    },
}

/// Time at which a strict port acknowledges.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Acknowledge {
    /// Acknowledges as soon as the message is in the queue: a `BufferedPort` in strict mode.
    #[default]
    Queued,
    /// Acknowledges when the message was taken out: an unbuffered `Port`.
    Taken,
}

/// A message with what its connection waits for.
#[derive(Debug)]
pub(super) struct Delivery {
    pub(super) received: Received,
    /// Signal that the message has left the queue.
    pub(super) taken: Option<oneshot::Sender<()>>,
}

#[derive(Debug)]
pub(super) struct Inbox {
    queue: Mutex<VecDeque<Delivery>>,
    filled: Notify,
    room: Semaphore,
    newest_only: bool,
    closed: AtomicBool,
    received: AtomicU64,
    superseded: AtomicU64,
}

impl Inbox {
    pub(super) fn new(reading: Reading) -> Self {
        let (newest_only, places) = match reading {
            Reading::Newest => (true, 1),
            Reading::Strict { queue, .. } => (false, queue.clamp(1, 1 << 20)),
        };
        Self {
            queue: Mutex::default(),
            filled: Notify::new(),
            room: Semaphore::new(places),
            newest_only,
            closed: AtomicBool::new(false),
            received: AtomicU64::new(0),
            superseded: AtomicU64::new(0),
        }
    }

    /// Puts a message in, when there is room for it; false when the port closed.
    pub(super) async fn put(&self, delivery: Delivery) -> bool {
        if !self.newest_only {
            let Ok(permit) = self.room.acquire().await else { return false };
            permit.forget();
        }
        self.push(delivery);
        true
    }

    /// Puts a message in when there is room now; false when there is none.
    pub(super) fn try_put(&self, delivery: Delivery) -> bool {
        if !self.newest_only {
            let Ok(permit) = self.room.try_acquire() else { return false };
            permit.forget();
        }
        self.push(delivery);
        true
    }

    fn push(&self, delivery: Delivery) {
        self.received.fetch_add(1, Ordering::Relaxed);
        let mut queue = self.queue.lock();
        if self.newest_only {
            let superseded = queue.drain(..).count() as u64;
            self.superseded.fetch_add(superseded, Ordering::Relaxed);
        }
        queue.push_back(delivery);
        drop(queue);
        self.filled.notify_one();
    }

    pub(super) fn try_take(&self) -> Option<Delivery> {
        let mut queue = self.queue.lock();
        let mut delivery = queue.pop_front()?;
        let more = !queue.is_empty();
        drop(queue);
        if !self.newest_only {
            self.room.add_permits(1);
        }
        if more {
            self.filled.notify_one();
        }
        if let Some(taken) = delivery.taken.take() {
            // The connection may be gone: then nobody waits for it.
            taken.send(()).ok();
        }
        Some(delivery)
    }

    /// The next message; `None` once the port is closed and nothing waits.
    pub(super) async fn take(&self) -> Option<Delivery> {
        loop {
            if let Some(delivery) = self.try_take() {
                return Some(delivery);
            }
            if self.closed.load(Ordering::Acquire) {
                // Whoever waits besides learns it, too.
                self.filled.notify_one();
                return None;
            }
            self.filled.notified().await;
        }
    }

    pub(super) fn close(&self) {
        self.closed.store(true, Ordering::Release);
        self.room.close();
        self.filled.notify_one();
    }

    pub(super) fn received(&self) -> u64 {
        self.received.load(Ordering::Relaxed)
    }

    pub(super) fn superseded(&self) -> u64 {
        self.superseded.load(Ordering::Relaxed)
    }
}
