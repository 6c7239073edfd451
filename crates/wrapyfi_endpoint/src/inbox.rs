//! The bounded queue between the thread that receives and the thread that takes.
//!
//! ```text
//!  I/O thread ── push ──▶ [ oldest … newest ] ── take ──▶ relay
//!                 │              │
//!                 └─ full: drop oldest │ drop newest │ hand back (block)
//! ```
//!
//! Bytes of waiting messages count against the budget of the process: see `budget`.
//!
//! The I/O thread never blocks here. Under policy `block` it is handed its message back and must
//! stop reading that one source until it is woken because there is room, so that other sources go
//! on.

use std::collections::VecDeque;
use std::sync::Arc;
#[cfg(feature = "tokio")]
use std::task::Poll;
use std::task::Waker;
use std::time::Duration;

use super::Context;
use super::budget::Share;
use super::counters::{Counters, DropReason};
use wrapyfi_retry::Mutex;

/// Policy by which a full queue treats the next message.
///
/// ```
/// # mod wrapyfi_core {
/// #     pub use {wrapyfi_endpoint as endpoint, wrapyfi_data::types};
/// #     pub mod middleware { pub use wrapyfi_endpoint::memory; }
/// # }
/// use wrapyfi_core::endpoint::{Context, Middleware, Overflow, QueueSpec, TopicSpec};
/// use wrapyfi_core::middleware::memory::Memory;
/// use wrapyfi_core::types::{MessageType, Value};
/// let (bus, context) = (Memory::new("memory"), Context::default());
/// let queue = QueueSpec { depth: 1, overflow: Overflow::DropOldest };
/// let spec = TopicSpec { queue, ..TopicSpec::new("/x", MessageType::NativeObject) };
/// let mut listener = bus.open_listener(&spec, &context)?;
/// let mut publisher = bus.open_publisher(&spec, &Context::default())?;
/// publisher.publish(&Value::from("old").into())?;
/// publisher.publish(&Value::from("new").into())?;
/// assert_eq!(listener.take()?.unwrap().payload, Value::from("new").into());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Overflow {
    /// Drops the message that waited longest: right for streams, where the newest counts.
    #[default]
    DropOldest,
    /// Drops the message that just came.
    DropNewest,
    /// Stops reading the source until there is room, at most this long; then drops the newest.
    Block(Duration),
}

/// Length and policy of a route's queue.
///
/// ```
/// # mod wrapyfi_core {
/// #     pub use {wrapyfi_endpoint as endpoint, wrapyfi_data::types};
/// #     pub mod middleware { pub use wrapyfi_endpoint::memory; }
/// # }
/// use wrapyfi_core::endpoint::{Context, Middleware, Overflow, QueueSpec, TopicSpec};
/// use wrapyfi_core::middleware::memory::Memory;
/// use wrapyfi_core::types::{MessageType, Value};
/// let bus = Memory::new("memory");
/// let queue = QueueSpec { depth: 1, overflow: Overflow::DropOldest };
/// let spec = TopicSpec { queue, ..TopicSpec::new("/x", MessageType::NativeObject) };
/// let context = Context::default();
/// let mut listener = bus.open_listener(&spec, &context)?;
/// let mut publisher = bus.open_publisher(&spec, &Context::default())?;
/// publisher.publish(&Value::from(1).into())?;
/// publisher.publish(&Value::from(2).into())?;
/// assert_eq!(listener.take()?.unwrap().payload, Value::from(2).into());
/// assert_eq!(context.counters.snapshot().dropped(), 1);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct QueueSpec {
    /// Largest number of messages held; at least 1.
    pub depth: usize,
    /// Policy for a message that comes while the queue is full.
    pub overflow: Overflow,
}

impl Default for QueueSpec {
    fn default() -> Self {
        Self { depth: 10, overflow: Overflow::DropOldest }
    }
}

/// A message that a queue can hold, with its size.
///
/// ```
/// use wrapyfi_endpoint::{Context, QueueSpec, Waits, inbox};
///
/// struct Frame(Vec<u8>);
/// impl Waits for Frame {
///     fn bytes(&self) -> usize { self.0.len() }
/// }
///
/// let (sender, receiver) = inbox(QueueSpec::default(), &Context::default());
/// assert!(sender.push(Frame(vec![0; 8])).is_ok());
/// assert_eq!(receiver.pop().map(|frame| frame.bytes()), Some(8));
/// ```
pub trait Waits {
    /// Size of the message in bytes.
    fn bytes(&self) -> usize;
}

/// Opens a queue. The bell of `context` is rung for every message accepted, drops are counted there.
///
/// ```
/// use std::time::Duration;
/// use wrapyfi_endpoint::{Context, Overflow, QueueSpec, inbox};
/// # struct Frame;
/// # impl wrapyfi_endpoint::Waits for Frame { fn bytes(&self) -> usize { 1 } }
/// let overflow = Overflow::Block(Duration::from_millis(50));
/// let (sender, receiver) = inbox(QueueSpec { depth: 1, overflow }, &Context::default());
/// assert!(sender.push(Frame).is_ok());
/// assert!(sender.push(Frame).is_err()); // handed back, to be offered again
/// assert_eq!(receiver.len(), 1);
/// ```
#[must_use]
pub fn inbox<T: Waits>(spec: QueueSpec, context: &Context) -> (Sender<T>, Receiver<T>) {
    let shared = Arc::new(Inbox {
        share: Share::default(),
        state: Mutex::new(InboxState {
            queue: VecDeque::with_capacity(spec.depth.min(1024)),
            closed: false,
            starved: Vec::new(),
        }),
        spec,
        context: context.clone(),
    });
    (Sender(Arc::clone(&shared)), Receiver(shared))
}

#[derive(Debug)]
struct Inbox<T> {
    share: Share,
    state: Mutex<InboxState<T>>,
    spec: QueueSpec,
    context: Context,
}

#[derive(Debug)]
struct InboxState<T> {
    queue: VecDeque<T>,
    /// True once the receiver was dropped.
    closed: bool,
    /// Tasks to wake when a message leaves the queue.
    starved: Vec<Waker>,
}

impl<T: Waits> Inbox<T> {
    /// Gives back the bytes of a message that left the queue.
    fn leaves(&self, message: Option<&T>) {
        if let Some(message) = message {
            self.share.give(message.bytes());
        }
    }
}

/// Sending end of an inbox.
///
/// See [`Waits`].
#[derive(Debug)]
pub struct Sender<T>(Arc<Inbox<T>>);

/// Receiving end of an inbox.
///
/// See [`Waits`].
#[derive(Debug)]
pub struct Receiver<T: Waits>(Arc<Inbox<T>>);

impl<T: Waits> Sender<T> {
    /// Queues `message` as the policy says. It is dropped where the budget of the process is full.
    ///
    /// # Errors
    /// Hands the message back when there is no room under [`Overflow::Block`]: stop reading the
    /// source, and [`Sender::offer`] it again; after the deadline [`Sender::settle`] it.
    pub fn push(&self, message: T) -> Result<(), T> {
        self.put(message, self.0.spec.overflow, Waker::noop())
    }

    /// Queues `message` where there is room, whatever the policy.
    ///
    /// # Errors
    /// Hands the message back when the queue is full; `waker` is woken when a message has left it.
    pub fn offer(&self, message: T, waker: &Waker) -> Result<(), T> {
        self.put(message, Overflow::Block(Duration::ZERO), waker)
    }

    /// Queues `message` as the policy says; under [`Overflow::Block`] it has waited for its whole deadline, and is
    /// dropped where there is no room.
    pub fn settle(&self, message: T) {
        if let Err(message) = self.push(message) {
            self.give_up(message);
        }
    }

    /// Counts a message that policy [`Overflow::Block`] could not place within its deadline.
    pub fn give_up(&self, message: T) {
        drop(message);
        self.0.context.counters.dropped(DropReason::BlockDeadline);
    }

    /// Queues `message` when there is room, and waits for room at most `max_wait`; then as the
    /// policy says, also where the task ends while it waits.
    #[cfg(feature = "tokio")]
    pub async fn place(&self, message: T, max_wait: Duration) {
        struct Held<'a, T: Waits>(&'a Sender<T>, Option<T>);
        impl<T: Waits> Drop for Held<'_, T> {
            fn drop(&mut self) {
                if let Some(message) = self.1.take() {
                    self.0.settle(message);
                }
            }
        }
        let mut held = Held(self, self.offer(message, Waker::noop()).err());
        if held.1.is_none() || max_wait.is_zero() {
            return;
        }
        let placed = std::future::poll_fn(|task| {
            held.1 = held.1.take().and_then(|message| self.offer(message, task.waker()).err());
            if held.1.is_none() { Poll::Ready(()) } else { Poll::Pending }
        });
        _ = tokio::time::timeout(max_wait, placed).await;
    }

    fn put(&self, message: T, overflow: Overflow, waker: &Waker) -> Result<(), T> {
        let shared = &*self.0;
        let mut state = shared.state.lock();
        if state.closed {
            shared.context.counters.dropped(DropReason::Closed);
            return Ok(());
        }
        let (is_full, blocks) =
            (state.queue.len() >= shared.spec.depth.max(1), matches!(overflow, Overflow::Block(_)));
        if is_full && !blocks {
            shared.context.counters.dropped(DropReason::QueueFull);
            if overflow == Overflow::DropNewest {
                return Ok(());
            }
            shared.leaves(state.queue.pop_front().as_ref());
        }
        if (is_full && blocks) || !shared.share.take(message.bytes()) {
            if !blocks {
                shared.context.counters.dropped(DropReason::OverBudget);
                return Ok(());
            }
            if !state.starved.iter().any(|known| known.will_wake(waker)) {
                state.starved.push(waker.clone());
            }
            return Err(message);
        }
        state.queue.push_back(message);
        drop(state);
        shared.context.wake.ring();
        Ok(())
    }

    /// Time that a message may wait for room before the policy drops it.
    pub fn max_wait(&self) -> Duration {
        match self.0.spec.overflow {
            Overflow::Block(max_wait) => max_wait,
            _ => Duration::ZERO,
        }
    }

    /// Length and policy of the queue.
    pub fn spec(&self) -> QueueSpec {
        self.0.spec
    }

    /// Context of the listener.
    pub fn context(&self) -> &Context {
        &self.0.context
    }

    /// Counters of the drops.
    pub fn counters(&self) -> &Counters {
        &self.0.context.counters
    }

    /// True once the receiver was dropped, so that no route takes messages any more.
    pub fn is_closed(&self) -> bool {
        Arc::strong_count(&self.0) < 2
    }
}

impl<T: Waits> Receiver<T> {
    /// Takes the oldest message, if any.
    pub fn pop(&self) -> Option<T> {
        let mut state = self.0.state.lock();
        let message = state.queue.pop_front()?;
        let starved = std::mem::take(&mut state.starved);
        drop(state);
        self.0.leaves(Some(&message));
        starved.into_iter().for_each(Waker::wake);
        Some(message)
    }

    /// Number of messages that wait.
    pub fn len(&self) -> usize {
        self.0.state.lock().queue.len()
    }

    /// True when no message waits.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Counts the messages that the receiver did not take, which are lost.
impl<T: Waits> Drop for Receiver<T> {
    fn drop(&mut self) {
        let (left, starved) = {
            let mut state = self.0.state.lock();
            state.closed = true;
            (std::mem::take(&mut state.queue), std::mem::take(&mut state.starved))
        };
        left.iter().for_each(|message| self.0.leaves(Some(message)));
        self.0.context.counters.dropped_many(DropReason::Closed, left.len() as u64);
        starved.into_iter().for_each(Waker::wake);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Wake;

    struct TaskWaker(Wake);

    impl std::task::Wake for TaskWaker {
        fn wake(self: Arc<Self>) {
            self.0.ring();
        }
    }

    impl Waits for u32 {
        fn bytes(&self) -> usize {
            4
        }
    }

    fn open(depth: usize, overflow: Overflow) -> (Sender<u32>, Receiver<u32>, Arc<Counters>) {
        let context = Context::default();
        let (tx, rx) = inbox(QueueSpec { depth, overflow }, &context);
        (tx, rx, context.counters)
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
        assert_eq!(rx.pop(), Some(1));
        tx.push(held).unwrap();
        tx.settle(3);
        assert_eq!(drain(&rx), [2]);
        assert_eq!(counters.snapshot().dropped_for(DropReason::BlockDeadline), 1);
        drop(rx);
        assert!(tx.is_closed());
    }

    #[test]
    fn whoever_waits_for_room_is_woken_by_it_and_by_the_end() {
        let bell = Arc::new(TaskWaker(Wake::new()));
        let (tx, rx, counters) = open(1, Overflow::DropOldest);
        let waker = Waker::from(Arc::clone(&bell));
        tx.offer(1, &waker).unwrap();
        assert_eq!(tx.offer(2, &waker), Err(2));
        assert!(!bell.0.wait(Duration::ZERO));
        assert_eq!(rx.pop(), Some(1));
        assert!(bell.0.wait(Duration::ZERO), "once for each time that it asked");
        tx.offer(2, &waker).unwrap();
        assert_eq!(tx.offer(3, &waker), Err(3));
        drop(rx);
        assert!(bell.0.wait(Duration::ZERO));
        tx.offer(3, &waker).unwrap();
        assert_eq!(counters.snapshot().dropped_for(DropReason::Closed), 2);
    }

    #[cfg(feature = "tokio")]
    #[test]
    fn what_is_placed_waits_and_is_counted_where_its_task_ends() {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build().unwrap();
        let (tx, rx, counters) = open(1, Overflow::Block(Duration::from_secs(60)));
        let (tx, max_wait) = (Arc::new(tx), Duration::from_secs(60));
        runtime.block_on(async {
            tx.place(1, max_wait).await;
            let with = Arc::clone(&tx);
            let waiting = tokio::spawn(async move { with.place(2, max_wait).await });
            tokio::task::yield_now().await;
            assert_eq!(rx.pop(), Some(1));
            waiting.await.unwrap();
            let with = Arc::clone(&tx);
            let waiting = tokio::spawn(async move { with.place(3, max_wait).await });
            tokio::task::yield_now().await;
            waiting.abort();
            assert!(waiting.await.unwrap_err().is_cancelled());
            tx.place(4, Duration::from_millis(1)).await;
        });
        assert_eq!(drain(&rx), [2]);
        assert_eq!(counters.snapshot().dropped_for(DropReason::BlockDeadline), 2);
    }

    #[test]
    fn what_nobody_took_is_counted_when_the_receiver_goes() {
        let (tx, rx, counters) = open(4, Overflow::DropOldest);
        (0..3).for_each(|n| tx.push(n).unwrap());
        assert_eq!(rx.pop(), Some(0));
        drop(rx);
        assert_eq!(counters.snapshot().dropped_for(DropReason::Closed), 2);
        tx.push(3).unwrap();
        tx.offer(4, Waker::noop()).unwrap();
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
                wrapyfi_data::Limits::WAITING_BYTES / 5
            }
        }
        for (overflow, dropped) in [(Overflow::DropOldest, 1), (Overflow::Block(Duration::ZERO), 0)]
        {
            let context = Context::default();
            let spec = QueueSpec { depth: 9, overflow };
            let (tx, rx) = inbox(spec, &context);
            assert!(tx.push(Large).is_ok());
            assert_eq!(tx.push(Large).is_err(), dropped == 0);
            let counted = context.counters.snapshot();
            assert_eq!(counted.dropped_for(DropReason::OverBudget), dropped);
            assert_eq!(rx.len(), 1);
        }
    }

    #[test]
    fn a_push_rings() {
        let context = Context::default();
        let (tx, _rx) = inbox(QueueSpec::default(), &context);
        tx.push(7).unwrap();
        assert!(context.wake.wait(Duration::from_secs(60)));
    }
}
