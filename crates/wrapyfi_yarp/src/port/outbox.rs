//! Queue of messages that wait for one target of an output.
//!
//! ```text
//!   write ──push──▶ [ │ │ │ ] ──next──▶ the target's task ──▶ socket
//!                   full: the oldest or the newest is dropped, and the writer told
//! ```

use std::collections::VecDeque;
use std::sync::Arc;

use tokio::sync::Notify;

use wrapyfi_retry::Mutex;

use super::message::{Loss, Message};
use super::room::Room;

/// Message that gives way when a target's queue is full.
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
    /// Taken, and not sent yet.
    sending: Option<Arc<Message>>,
    closing: bool,
    dead: bool,
}

/// The queue of one target.
#[derive(Debug)]
pub(super) struct Outbox {
    queue: Mutex<Queue>,
    capacity: usize,
    overflow: Overflow,
    room: Box<dyn Room>,
    filled: Notify,
    stop: Notify,
    /// Signal that a message left.
    moved: Notify,
}

/// Result of putting a message into a queue.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Put {
    In,
    /// The message, or an older one, had to give way.
    Full,
    /// Too much waits in this process.
    NoRoom,
    /// The target is gone, or going.
    Gone,
}

impl Outbox {
    /// Makes the queue of a target: at most `capacity` messages, at least one, whose bytes `room` allows.
    pub(super) fn new(capacity: usize, overflow: Overflow, room: Box<dyn Room>) -> Self {
        Self {
            queue: Mutex::default(),
            capacity: capacity.max(1),
            overflow,
            room,
            filled: Notify::new(),
            stop: Notify::new(),
            moved: Notify::new(),
        }
    }

    /// Puts a message in.
    pub(super) fn push(&self, message: &Arc<Message>) -> Put {
        let mut queue = self.queue.lock();
        if queue.closing || queue.dead {
            return Put::Gone;
        }
        let full = queue.waiting.len() >= self.capacity;
        if full {
            if self.overflow == Overflow::DropNewest {
                return Put::Full;
            }
            self.lose(queue.waiting.pop_front(), Loss::Full);
        }
        if !self.room.take(message.payload.bytes.len()) {
            return Put::NoRoom;
        }
        queue.waiting.push_back(Arc::clone(message));
        drop(queue);
        self.filled.notify_one();
        if full { Put::Full } else { Put::In }
    }

    /// Messages wait no more, and are lost.
    fn lose(&self, messages: impl IntoIterator<Item = Arc<Message>>, how: Loss) {
        for message in messages {
            self.room.give(message.payload.bytes.len());
            message.lost(how);
        }
    }

    /// Waits until everything was sent, or the target is gone.
    pub(super) async fn drained(&self) {
        self.until(|queue| (queue.waiting.is_empty() && queue.sending.is_none()) || queue.dead)
            .await;
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
            if holds(&self.queue.lock()) {
                return;
            }
            moved.await;
        }
    }

    /// The next message for the target's task; `None` when it shall say goodbye. Cancel-safe.
    pub(super) async fn next(&self) -> Option<Arc<Message>> {
        loop {
            {
                let mut queue = self.queue.lock();
                let next = queue.waiting.pop_front();
                if let Some(sent) = std::mem::replace(&mut queue.sending, next.clone()) {
                    self.room.give(sent.payload.bytes.len());
                }
                if next.is_some() {
                    drop(queue);
                    self.moved.notify_waiters();
                    return next;
                }
                if queue.closing {
                    return None;
                }
            }
            self.moved.notify_waiters();
            self.filled.notified().await;
        }
    }

    /// Takes nothing more in; waiting messages are sent.
    pub(super) fn close(&self) {
        self.queue.lock().closing = true;
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

    /// The target's task has ended; what waited or was on its way is dropped.
    pub(super) fn end(&self) {
        let mut queue = self.queue.lock();
        queue.dead = true;
        let how = if queue.closing { Loss::Closed } else { Loss::Connection };
        let Queue { sending, waiting, .. } = &mut *queue;
        let lost: Vec<_> = sending.take().into_iter().chain(waiting.drain(..)).collect();
        drop(queue);
        self.lose(lost, how);
        self.moved.notify_waiters();
    }
}
