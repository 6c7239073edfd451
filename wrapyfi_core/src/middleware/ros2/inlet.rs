//! What flows into a listener: from DDS readers into its queue.
//!
//! ```text
//!   DDS thread:  notify ─▶ Inlet::drain ── take all ──▶ queue
//!                                  └─ block: full ─▶ held ──┘
//! ```
//!
//! Under policy `block` messages that find the queue full are held beside it, as many again as it
//! has room for, each for the deadline at most. The publisher is not held back: Cyclone does that
//! by stopping the thread that delivers every topic of the process, discovery in its wake, so that
//! a bounded reader would let one slow consumer stop all of them.
//!
//! What many publishers have kept comes at once, and is not sent again: the first message of each is
//! held likewise, whatever the policy.

use std::collections::{HashSet, VecDeque};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use bytes::Bytes;

use super::follow::EventLog;
use super::graph::{CdrReader, GraphError};
use super::replays::{Replays, Through};
use crate::Throttle;
use crate::endpoint::{
    Context, Counters, DropReason, Overflow, QueueSpec, Receiver, Sender, Waits, Wake, inbox,
};

/// How long the first message of a publisher waits for room.
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
pub(super) struct Inlet {
    state: Mutex<InletState>,
    sender: Sender<Arrived>,
    pub(super) counters: Arc<Counters>,
    pub(super) wake: Wake,
    topic: String,
    /// Messages are held.
    holds: AtomicBool,
}

pub(super) struct InletState {
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
    /// What DDS lost: all is counted, little is logged.
    losses: Throttle,
}

impl Inlet {
    /// Without a reader yet.
    pub(super) fn new(
        topic: &str,
        queue: QueueSpec,
        matches: bool,
        context: &Context,
    ) -> (Arc<Self>, Receiver<Arrived>) {
        let (sender, receiver) = inbox(queue, Arc::clone(&context.counters), context.wake.clone());
        let inlet = Self {
            state: Mutex::new(InletState {
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
            counters: Arc::clone(&context.counters),
            wake: context.wake.clone(),
            topic: topic.to_owned(),
        };
        (Arc::new(inlet), receiver)
    }

    pub(super) fn lock(&self) -> MutexGuard<'_, InletState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Moves what waits into the queue, as far as the policy goes.
    pub(super) fn drain(&self) {
        let mut guard = self.lock();
        self.refill(&mut guard.held);
        let state = &mut *guard;
        let InletState { reader, old, replays, events, held, heard, warned_oversize, losses } =
            state;
        let Some(reader) = reader else { return };
        events.note(reader.qos_events(), Instant::now());
        if let Some((old, _)) = old {
            let queue = (&mut *held, &mut *heard);
            let replays = replays.as_mut();
            self.empty((old.as_mut(), Through::Old), replays, queue, warned_oversize);
        }
        let queue = (&mut *held, &mut *heard);
        self.empty((reader.as_mut(), Through::New), replays.as_mut(), queue, warned_oversize);
        // What an old reader loses beside it is not lost.
        self.note_lost(reader.lost(), losses);
        self.holds.store(!held.is_empty(), Relaxed);
    }

    /// Counts what DDS lost before it could be taken.
    fn note_lost(&self, lost: u64, losses: &mut Throttle) {
        if lost == 0 {
            return;
        }
        self.counters.dropped_many(DropReason::LostUpstream, lost);
        if let Some(unlogged_before) = losses.pass(Instant::now()) {
            tracing::warn!(
                topic = self.topic,
                lost,
                unlogged_before,
                "messages were lost between their publisher and this node (docs/qos.md, What DDS loses)"
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
                    self.counters.received(sample.cdr.len());
                    let at = Instant::now();
                    let (publisher, sent) = (sample.publisher, sample.source_timestamp_ns);
                    let passes =
                        |seen: &mut &mut Replays| seen.passes(through, publisher, sent, at);
                    if !replays.as_mut().is_none_or(passes) {
                        self.counters.dropped(DropReason::Duplicate);
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
                    self.counters.received(actual);
                    self.counters.dropped(DropReason::Oversize);
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

    /// Moves held messages into the queue; those that waited too long go as the policy says.
    fn refill(&self, held: &mut VecDeque<(Arrived, Duration)>) {
        while let Some((oldest, patience)) = held.pop_front() {
            if let Err(oldest) = self.sender.offer(oldest) {
                if oldest.at.elapsed() < patience {
                    held.push_front((oldest, patience));
                    return;
                }
                self.push(oldest);
            }
        }
    }

    /// Queues a message behind those that are held, or holds it.
    fn place(&self, message: Arrived, is_first: bool, held: &mut VecDeque<(Arrived, Duration)>) {
        let policy = self.patience();
        // None overtakes another: both may be of one publisher. Nor does it wait longer by that.
        let behind = held.back().map_or(Duration::ZERO, |(last, patience)| {
            (last.at + *patience).saturating_duration_since(message.at)
        });
        let first = if is_first { FIRST_WAITS } else { Duration::ZERO };
        let patience = policy.max(first).max(behind);
        let message = if !held.is_empty() {
            message
        } else if patience.is_zero() {
            return self.push(message);
        } else {
            match self.sender.offer(message) {
                Ok(()) => return,
                Err(message) => message,
            }
        };
        let room = self.sender.spec().depth.max(1);
        if policy.is_zero() {
            held.push_back((message, patience));
            if held.len() > MAX_FIRST
                && let Some((oldest, _)) = held.pop_front()
            {
                self.push(oldest);
            }
        } else if held.len() < room {
            held.push_back((message, policy));
        } else {
            self.sender.give_up(message);
        }
    }

    /// Queues a message as the policy says.
    fn push(&self, message: Arrived) {
        if let Err(message) = self.sender.push(message) {
            self.sender.give_up(message);
        }
    }

    /// How long a message may wait beside a full queue.
    fn patience(&self) -> Duration {
        match self.sender.spec().overflow {
            Overflow::Block(deadline) => deadline,
            _ => Duration::ZERO,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::middleware::ros2::graph::CdrSample;

    /// The size of a message, as an error where it is over the limit.
    type Message = Result<usize, usize>;

    /// What a reader holds, with the publisher of each.
    #[derive(Clone, Default)]
    struct Waiting(Arc<Mutex<VecDeque<(Message, u64)>>>);

    impl Waiting {
        fn put(&self, message: Message) {
            self.put_of(0, message);
        }

        fn put_of(&self, publisher: u64, message: Message) {
            self.0.lock().unwrap().push_back((message, publisher));
        }
    }

    struct FakeReader(Waiting, u64);

    impl CdrReader for FakeReader {
        fn take(&mut self) -> Result<Option<CdrSample>, GraphError> {
            match self.0.0.lock().unwrap().pop_front() {
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

    fn open(overflow: Overflow, lost: u64) -> (Arc<Inlet>, Receiver<Arrived>, Waiting, Context) {
        let context = Context::default();
        let (inlet, receiver) = Inlet::new("/t", QueueSpec { depth: 2, overflow }, false, &context);
        let waiting = Waiting::default();
        inlet.lock().reader = Some(Box::new(FakeReader(waiting.clone(), lost)));
        (inlet, receiver, waiting, context)
    }

    #[test]
    fn everything_that_arrives_is_counted_once() {
        let (inlet, receiver, waiting, context) = open(Overflow::DropOldest, 7);
        for message in [Ok(10), Err(1000), Ok(20), Ok(30)] {
            waiting.put(message);
        }
        inlet.drain();
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
        let (inlet, receiver, waiting, context) = open(Overflow::DropOldest, 0);
        for publisher in 1..=5 {
            waiting.put_of(publisher, Ok(usize::try_from(publisher).unwrap()));
        }
        waiting.put_of(5, Ok(6));
        inlet.drain();
        assert_eq!(context.counters.snapshot().dropped(), 0);
        let mut sizes = Vec::new();
        while let Some(message) = receiver.pop() {
            sizes.push(message.cdr.len());
            inlet.make_up();
        }
        assert_eq!(sizes, [1, 2, 3, 4, 5, 6]);
        // From then on the newest count.
        for size in 10..=13 {
            waiting.put_of(1, Ok(size));
        }
        inlet.drain();
        assert_eq!(context.counters.snapshot().dropped_for(DropReason::QueueFull), 2);
    }

    #[test]
    fn under_block_as_many_again_wait_in_order() {
        let (inlet, receiver, waiting, context) = open(Overflow::Block(Duration::from_secs(60)), 0);
        for size in 1..=5 {
            waiting.put(Ok(size));
        }
        inlet.drain();
        assert_eq!((receiver.len(), inlet.lock().held.len()), (2, 2));
        assert_eq!(context.counters.snapshot().dropped_for(DropReason::BlockDeadline), 1);
        let mut sizes = vec![receiver.pop().unwrap().cdr.len()];
        waiting.put(Ok(6));
        inlet.drain();
        while let Some(message) = receiver.pop() {
            sizes.push(message.cdr.len());
            inlet.drain();
        }
        assert_eq!(sizes, [1, 2, 3, 4, 6]);
        assert_eq!(context.counters.snapshot().dropped(), 1);
    }

    #[test]
    fn after_the_deadline_the_newest_are_dropped() {
        let (inlet, receiver, waiting, context) = open(Overflow::Block(Duration::ZERO), 0);
        for size in 1..=5 {
            waiting.put(Ok(size));
        }
        inlet.drain();
        assert_eq!(context.counters.snapshot().dropped_for(DropReason::BlockDeadline), 3);
        let sizes: Vec<_> = std::iter::from_fn(|| receiver.pop()).map(|m| m.cdr.len()).collect();
        assert_eq!(sizes, [1, 2]);
    }
}
