//! Queue of messages that wait for the owner of a port.
//!
//! ```text
//!   connections ──put──▶ newest only: one place, the older one is counted and gone
//!                        strict: so many places; without one, the connection waits, and its sender
//! ```

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use tokio::sync::{Notify, Semaphore};

use wrapyfi_retry::Mutex;

use super::message::Received;

/// Rule by which an input port keeps messages until they are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Reading {
    /// The newest unread message only; senders never wait. YARP's `BufferedPort`.
    #[default]
    Newest,
    /// Every message, acknowledged as soon as it is in the queue. Senders on tcp and `text_ack` wait while the queue is full; on `fast_tcp` the
    /// sockets fill first; datagrams are dropped and counted.
    Strict {
        /// Most messages that wait, at least 1.
        queue: usize,
    },
}

#[derive(Debug)]
pub(super) struct Inbox {
    queue: Mutex<VecDeque<Received>>,
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
            Reading::Strict { queue } => (false, queue.clamp(1, 1 << 20)),
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

    /// Puts a message in, when there is room for it; it is lost when the port closed.
    pub(super) async fn put(&self, received: Received) {
        if !self.newest_only {
            let Ok(permit) = self.room.acquire().await else { return };
            permit.forget();
        }
        self.push(received);
    }

    /// Puts a message in when there is room now; false when there is none.
    pub(super) fn try_put(&self, received: Received) -> bool {
        if !self.newest_only {
            let Ok(permit) = self.room.try_acquire() else { return false };
            permit.forget();
        }
        self.push(received);
        true
    }

    fn push(&self, received: Received) {
        self.received.fetch_add(1, Ordering::Relaxed);
        let mut queue = self.queue.lock();
        if self.newest_only {
            let superseded = queue.drain(..).count() as u64;
            self.superseded.fetch_add(superseded, Ordering::Relaxed);
        }
        queue.push_back(received);
        drop(queue);
        self.filled.notify_one();
    }

    pub(super) fn try_take(&self) -> Option<Received> {
        let mut queue = self.queue.lock();
        let received = queue.pop_front()?;
        let more = !queue.is_empty();
        drop(queue);
        if !self.newest_only {
            self.room.add_permits(1);
        }
        if more {
            self.filled.notify_one();
        }
        Some(received)
    }

    /// The next message; `None` once the port is closed and nothing waits.
    pub(super) async fn take(&self) -> Option<Received> {
        loop {
            if let Some(received) = self.try_take() {
                return Some(received);
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
