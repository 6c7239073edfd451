//! Receive path of a listener: from DDS readers into its queue.
//!
//! ```text
//!   DDS thread:  notify ─▶ ReceivePath::drain ── take all ──▶ queue
//!                                         └─ block: full ─▶ held ──┘
//! ```
//!
//! Under policy `block` messages that find the queue full are held beside it, as many again as it
//! has room for, each for the deadline at most. The publisher is not held back: Cyclone does that
//! by stopping the thread that delivers every topic of the process, discovery in its wake, so that
//! a bounded reader would let one slow consumer stop all of them.
//!
//! Kept messages of many publishers come at once, and are not sent again: the first message of each
//! is held likewise, whatever the policy.

use std::collections::{HashSet, VecDeque};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, MutexGuard};
use std::task::Waker;
use std::time::{Duration, Instant};

use bytes::Bytes;

use super::follow::EventLog;
use super::graph::{CdrReader, GraphError};
use super::replays::{Replays, Through};
use wrapyfi_endpoint::{
    Context, DropReason, Mutex, QueueSpec, Receiver, Sender, Share, Throttle, Waits, inbox,
};

/// Longest time that the first message of a publisher waits for room.
const FIRST_WAITS: Duration = Duration::from_secs(1);
/// First messages that are held.
const MAX_FIRST: usize = 256;
/// Publishers whose first message is known to have come.
const MAX_PUBLISHERS: usize = 4096;

/// A message as it arrived.
#[derive(Debug)]
pub(super) struct Arrived {
    pub(super) cdr: Bytes,
    pub(super) at: Instant,
    /// As [`CdrSample::publisher`](super::graph::CdrSample::publisher).
    pub(super) publisher: u64,
}

impl Waits for Arrived {
    fn bytes(&self) -> usize {
        self.cdr.len()
    }
}

/// The reader and what it flows into; shared with the callback.
pub(super) struct ReceivePath {
    state: Mutex<ReceiveState>,
    sender: Sender<Arrived>,
    /// Share of the held messages in the process's budget of waiting bytes.
    share: Share,
    topic: String,
    /// Messages are held.
    holds: AtomicBool,
}

pub(super) struct ReceiveState {
    /// None before it was created and after the listener is gone.
    pub(super) reader: Option<Box<dyn CdrReader>>,
    /// The one before it, for a while, and since when there are two.
    pub(super) old: Option<(Box<dyn CdrReader>, Instant)>,
    /// None where there is never a second reader.
    pub(super) replays: Option<Replays>,
    events: EventLog,
    /// Arrived when the queue was full, oldest first, and how long each may wait.
    held: VecDeque<(Arrived, Duration)>,
    /// Publishers that were heard.
    heard: HashSet<u64>,
    warned_oversize: bool,
    /// Rate limit of the log lines about samples that DDS lost; all of them are counted.
    losses: Throttle,
}

impl ReceivePath {
    /// Without a reader yet.
    pub(super) fn new(
        topic: &str,
        queue: QueueSpec,
        matches: bool,
        context: &Context,
    ) -> (Arc<Self>, Receiver<Arrived>) {
        let (sender, receiver) = inbox(queue, context);
        let receive_path = Self {
            state: Mutex::new(ReceiveState {
                reader: None,
                old: None,
                replays: matches.then(Replays::default),
                events: EventLog::new(&context.counters, topic, true),
                held: VecDeque::new(),
                heard: HashSet::new(),
                warned_oversize: false,
                losses: Throttle::default(),
            }),
            holds: AtomicBool::new(false),
            sender,
            share: Share::default(),
            topic: topic.to_owned(),
        };
        (Arc::new(receive_path), receiver)
    }

    pub(super) fn context(&self) -> &Context {
        self.sender.context()
    }

    fn now(&self) -> Instant {
        self.context().clock.now()
    }

    pub(super) fn lock(&self) -> MutexGuard<'_, ReceiveState> {
        self.state.lock()
    }

    /// Moves what waits into the queue, as far as the policy goes.
    pub(super) fn drain(&self) {
        let mut guard = self.lock();
        self.refill(&mut guard.held);
        let state = &mut *guard;
        let ReceiveState { reader, old, replays, events, held, heard, warned_oversize, losses } =
            state;
        let Some(reader) = reader else { return };
        events.note(reader.qos_events(), self.now());
        if let Some((old, _)) = old {
            let queue = (&mut *held, &mut *heard);
            let replays = replays.as_mut();
            self.empty((old.as_mut(), Through::Old), replays, queue, warned_oversize);
        }
        let queue = (&mut *held, &mut *heard);
        self.empty((reader.as_mut(), Through::New), replays.as_mut(), queue, warned_oversize);
        // Samples that an old reader loses come to the new one: they are not lost.
        self.note_lost(reader.lost(), losses);
        self.holds.store(!held.is_empty(), Relaxed);
    }

    /// Counts what DDS lost before it could be taken.
    fn note_lost(&self, lost: u64, losses: &mut Throttle) {
        if lost == 0 {
            return;
        }
        self.sender.counters().dropped_many(DropReason::LostUpstream, lost);
        if let Some(unlogged_before) = losses.pass(self.now()) {
            tracing::warn!(
                topic = self.topic,
                lost,
                unlogged_before,
                "messages were lost between their publisher and this node (docs/reference/qos.md, What DDS loses)"
            );
        }
    }

    /// Moves what is held into the queue, where there is room now.
    pub(super) fn make_up(&self) {
        if self.holds.load(Relaxed) {
            self.drain();
        }
    }

    /// Takes all that waits in one reader.
    fn empty(
        &self,
        (reader, through): (&mut dyn CdrReader, Through),
        mut replays: Option<&mut Replays>,
        (held, heard): (&mut VecDeque<(Arrived, Duration)>, &mut HashSet<u64>),
        warned_oversize: &mut bool,
    ) {
        loop {
            match reader.take() {
                Ok(Some(sample)) => {
                    self.sender.counters().received(sample.cdr.len());
                    let at = self.now();
                    let (publisher, sent) = (sample.publisher, sample.source_timestamp_ns);
                    let passes =
                        |seen: &mut &mut Replays| seen.passes(through, publisher, sent, at);
                    if !replays.as_mut().is_none_or(passes) {
                        self.sender.counters().dropped(DropReason::Duplicate);
                        continue;
                    }
                    if heard.len() >= MAX_PUBLISHERS && !heard.contains(&publisher) {
                        heard.clear();
                    }
                    let is_first = publisher != 0 && heard.insert(publisher);
                    self.place(Arrived { cdr: sample.cdr, at, publisher }, is_first, held);
                }
                Ok(None) => return,
                Err(GraphError::TooLarge { actual, limit, .. }) => {
                    self.sender.counters().received(actual);
                    self.sender.counters().dropped(DropReason::Oversize);
                    if !std::mem::replace(warned_oversize, true) {
                        tracing::warn!(
                            topic = self.topic,
                            actual,
                            limit,
                            "message dropped: over max_message_mib; further ones are only counted"
                        );
                    }
                }
                Err(error) => {
                    tracing::warn!(%error, "cannot take messages");
                    return;
                }
            }
        }
    }

    /// Ends: what is held is lost. The readers are for the caller to drop, out of the lock: deleting one waits for a
    /// callback that may want the lock.
    pub(super) fn close(&self) -> impl Sized + use<> {
        let mut state = self.lock();
        self.sender.counters().dropped_many(DropReason::Closed, state.held.drain(..).len() as u64);
        (state.old.take(), state.reader.take())
    }

    /// Moves held messages into the queue; those that waited too long go as the policy says.
    fn refill(&self, held: &mut VecDeque<(Arrived, Duration)>) {
        while let Some((oldest, max_wait)) = held.pop_front() {
            let bytes = oldest.bytes();
            if let Err(oldest) = self.sender.offer(oldest, Waker::noop()) {
                if self.now() < oldest.at + max_wait {
                    held.push_front((oldest, max_wait));
                    return;
                }
                self.sender.settle(oldest);
            }
            self.share.give(bytes);
        }
    }

    /// Queues a message behind those that are held, or holds it.
    fn place(&self, message: Arrived, is_first: bool, held: &mut VecDeque<(Arrived, Duration)>) {
        let policy = self.sender.max_wait();
        // None overtakes another: both may be of one publisher. Nor does it wait longer by that.
        let behind = held.back().map_or(Duration::ZERO, |(last, max_wait)| {
            (last.at + *max_wait).saturating_duration_since(message.at)
        });
        let first = if is_first { FIRST_WAITS } else { Duration::ZERO };
        let max_wait = policy.max(first).max(behind);
        let message = if !held.is_empty() {
            message
        } else if max_wait.is_zero() {
            return self.sender.settle(message);
        } else {
            match self.sender.offer(message, Waker::noop()) {
                Ok(()) => return,
                Err(message) => message,
            }
        };
        let room = self.sender.spec().depth.max(1);
        if !policy.is_zero() && held.len() >= room {
            return self.sender.give_up(message);
        }
        if !self.share.take(message.bytes()) {
            return self.sender.counters().dropped(DropReason::OverBudget);
        }
        held.push_back((message, if policy.is_zero() { max_wait } else { policy }));
        if policy.is_zero()
            && held.len() > MAX_FIRST
            && let Some((oldest, _)) = held.pop_front()
        {
            self.share.give(oldest.bytes());
            self.sender.settle(oldest);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::graph::CdrSample;
    use wrapyfi_endpoint::Overflow;

    /// The size of a message, as an error where it is over the limit.
    type Message = Result<usize, usize>;

    /// Messages that a reader holds, each with its publisher.
    #[derive(Clone, Default)]
    struct Waiting(Arc<Mutex<VecDeque<(Message, u64)>>>);

    impl Waiting {
        fn put(&self, message: Message) {
            self.put_of(0, message);
        }

        fn put_of(&self, publisher: u64, message: Message) {
            self.0.lock().push_back((message, publisher));
        }
    }

    struct FakeReader(Waiting, u64);

    impl CdrReader for FakeReader {
        fn take(&mut self) -> Result<Option<CdrSample>, GraphError> {
            match self.0.0.lock().pop_front() {
                None => Ok(None),
                Some((Ok(size), publisher)) => Ok(Some(CdrSample {
                    cdr: vec![0; size].into(),
                    source_timestamp_ns: 0,
                    publisher,
                })),
                Some((Err(actual), _)) => {
                    Err(GraphError::TooLarge { topic: "/t".into(), actual, limit: 100 })
                }
            }
        }

        fn matched(&self) -> usize {
            1
        }

        fn lost(&mut self) -> u64 {
            std::mem::take(&mut self.1)
        }

        fn incompatible(&self) -> Option<&'static str> {
            None
        }
    }

    fn open(
        overflow: Overflow,
        lost: u64,
    ) -> (Arc<ReceivePath>, Receiver<Arrived>, Waiting, Context) {
        let context = Context::default();
        let (receive_path, receiver) =
            ReceivePath::new("/t", QueueSpec { depth: 2, overflow }, false, &context);
        let waiting = Waiting::default();
        receive_path.lock().reader = Some(Box::new(FakeReader(waiting.clone(), lost)));
        (receive_path, receiver, waiting, context)
    }

    #[test]
    fn everything_that_arrives_is_counted_once() {
        let (receive_path, receiver, waiting, context) = open(Overflow::DropOldest, 7);
        for message in [Ok(10), Err(1000), Ok(20), Ok(30)] {
            waiting.put(message);
        }
        receive_path.drain();
        let now = context.counters.snapshot();
        assert_eq!((now.received, now.received_bytes), (4, 1060));
        assert_eq!(now.dropped_for(DropReason::LostUpstream), 7);
        assert_eq!(now.dropped_for(DropReason::Oversize), 1);
        assert_eq!(now.dropped_for(DropReason::QueueFull), 1);
        let sizes: Vec<_> = std::iter::from_fn(|| receiver.pop()).map(|m| m.cdr.len()).collect();
        assert_eq!(sizes, [20, 30]);
    }

    #[test]
    fn the_first_message_of_each_publisher_is_held_whatever_the_policy() {
        let (receive_path, receiver, waiting, context) = open(Overflow::DropOldest, 0);
        for publisher in 1..=5 {
            waiting.put_of(publisher, Ok(usize::try_from(publisher).unwrap()));
        }
        waiting.put_of(5, Ok(6));
        receive_path.drain();
        assert_eq!(context.counters.snapshot().dropped(), 0);
        let mut sizes = Vec::new();
        while let Some(message) = receiver.pop() {
            sizes.push(message.cdr.len());
            receive_path.make_up();
        }
        assert_eq!(sizes, [1, 2, 3, 4, 5, 6]);
        // From then on the newest count.
        for size in 10..=13 {
            waiting.put_of(1, Ok(size));
        }
        receive_path.drain();
        assert_eq!(context.counters.snapshot().dropped_for(DropReason::QueueFull), 2);
    }

    #[test]
    fn under_block_as_many_again_wait_in_order() {
        let (receive_path, receiver, waiting, context) =
            open(Overflow::Block(Duration::from_secs(60)), 0);
        for size in 1..=5 {
            waiting.put(Ok(size));
        }
        receive_path.drain();
        assert_eq!((receiver.len(), receive_path.lock().held.len()), (2, 2));
        assert_eq!(context.counters.snapshot().dropped_for(DropReason::BlockDeadline), 1);
        let mut sizes = vec![receiver.pop().unwrap().cdr.len()];
        waiting.put(Ok(6));
        receive_path.drain();
        while let Some(message) = receiver.pop() {
            sizes.push(message.cdr.len());
            receive_path.drain();
        }
        assert_eq!(sizes, [1, 2, 3, 4, 6]);
        assert_eq!(context.counters.snapshot().dropped(), 1);
    }

    #[test]
    fn after_the_deadline_the_newest_are_dropped() {
        let (receive_path, receiver, waiting, context) = open(Overflow::Block(Duration::ZERO), 0);
        for size in 1..=5 {
            waiting.put(Ok(size));
        }
        receive_path.drain();
        assert_eq!(context.counters.snapshot().dropped_for(DropReason::BlockDeadline), 3);
        let sizes: Vec<_> = std::iter::from_fn(|| receiver.pop()).map(|m| m.cdr.len()).collect();
        assert_eq!(sizes, [1, 2]);
    }
}
