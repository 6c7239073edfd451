//! Receives a topic: DDS reader, bounded queue, decoding.
//!
//! ```text
//!   DDS thread:  notify ─▶ Inlet::drain ── take all ──▶ inbox ──▶ take ─▶ decode   owner's thread
//!                                  └─ block: full ─▶ held ──┘
//! ```
//!
//! Under policy `block` messages that find the queue full are held beside it, as many again as it
//! has room for, each for the deadline at most. The publisher is not held back: Cyclone does that
//! by stopping the thread that delivers every topic of the process, discovery in its wake, so that
//! a bounded reader would let one slow consumer stop all of them.
//!
//! A listener that follows its publishers' quality of service is opened again when they change: the
//! new reader is there before the old one goes, and what comes from both is passed on once.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use bytes::Bytes;

use super::diagnosis::{Diagnosis, Names};
use super::follow::{EventLog, Follower};
use super::graph::{CdrReader, Graph, GraphError, Notify, TopicDescription};
use super::matching::{CALM, Matching};
use super::payload;
use super::replays::Replays;
use crate::Limits;
use crate::endpoint::{
    Context, Counters, DropReason, Link, Listener, Overflow, Qos, QosChange, QosEvent, QueueSpec,
    Receiver, Review, Sample, Sender, TakeError, TopicSpec, Wake, inbox,
};
use crate::plugin::Plugins;
use crate::types::MessageType;

/// How long two readers stay side by side: by then every publisher knows the new one.
const OVERLAP: Duration = Duration::from_secs(1);
/// The same where the new one does not match as many: some of those will not come back.
const LONGEST_OVERLAP: Duration = Duration::from_secs(3);

/// A message as it arrived.
struct Arrived {
    cdr: Bytes,
    at: Instant,
}

/// The reader and what it flows into; shared with the callback.
struct Inlet {
    state: Mutex<InletState>,
    sender: Sender<Arrived>,
    counters: Arc<Counters>,
    wake: Wake,
    topic: String,
}

struct InletState {
    /// None before it was created and after the listener is gone.
    reader: Option<Box<dyn CdrReader>>,
    /// The one before it, for a while, and since when there are two.
    old: Option<(Box<dyn CdrReader>, Instant)>,
    /// None where there is never a second reader.
    replays: Option<Replays>,
    events: EventLog,
    /// Under policy `block`: arrived when the queue was full, oldest first.
    held: VecDeque<Arrived>,
    warned_oversize: bool,
}

impl Inlet {
    /// Without a reader yet.
    fn new(
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
                warned_oversize: false,
            }),
            sender,
            counters: Arc::clone(&context.counters),
            wake: context.wake.clone(),
            topic: topic.to_owned(),
        };
        (Arc::new(inlet), receiver)
    }

    fn lock(&self) -> MutexGuard<'_, InletState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Moves what waits into the queue, as far as the policy goes.
    fn drain(&self) {
        let mut guard = self.lock();
        self.refill(&mut guard.held);
        let InletState { reader, old, replays, events, held, warned_oversize } = &mut *guard;
        let Some(reader) = reader else { return };
        events.note(reader.qos_events(), Instant::now());
        // What an old reader loses beside it is not lost.
        let lost = reader.lost();
        if lost > 0 {
            self.counters.dropped_many(DropReason::LostUpstream, lost);
        }
        let old = old.as_mut().map(|(old, _)| old);
        for reader in old.into_iter().chain([reader]) {
            self.empty(reader.as_mut(), replays.as_mut(), held, warned_oversize);
        }
    }

    /// Takes all that waits in one reader.
    fn empty(
        &self,
        reader: &mut dyn CdrReader,
        mut replays: Option<&mut Replays>,
        held: &mut VecDeque<Arrived>,
        warned_oversize: &mut bool,
    ) {
        loop {
            match reader.take() {
                Ok(Some(sample)) => {
                    self.counters.received(sample.cdr.len());
                    let at = Instant::now();
                    let (publisher, sent) = (sample.publisher, sample.source_timestamp_ns);
                    if replays.as_mut().is_some_and(|seen| !seen.passes(publisher, sent, at)) {
                        self.counters.dropped(DropReason::Duplicate);
                        continue;
                    }
                    self.place(Arrived { cdr: sample.cdr, at }, held);
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

    /// Moves held messages into the queue; those that waited too long are dropped.
    fn refill(&self, held: &mut VecDeque<Arrived>) {
        while let Some(oldest) = held.pop_front() {
            if let Err(oldest) = self.sender.push(oldest) {
                if oldest.at.elapsed() < self.patience() {
                    held.push_front(oldest);
                    return;
                }
                self.sender.give_up(oldest);
            }
        }
    }

    /// Queues a message behind those that are held, or holds it.
    fn place(&self, message: Arrived, held: &mut VecDeque<Arrived>) {
        let message = if held.is_empty() {
            match self.sender.push(message) {
                Ok(()) => return,
                Err(message) => message,
            }
        } else {
            message
        };
        if held.len() < self.sender.spec().depth.max(1) && !self.patience().is_zero() {
            held.push_back(message);
        } else {
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

/// A ROS 2 subscription.
pub(super) struct Ros2Listener {
    graph: Arc<dyn Graph>,
    /// With the quality of service in use.
    topic: TopicDescription,
    inlet: Arc<Inlet>,
    on_data: Notify,
    receiver: Receiver<Arrived>,
    blocks: bool,
    message_type: MessageType,
    limits: Limits,
    plugins: Plugins,
    follower: Follower,
}

impl Ros2Listener {
    pub(super) fn open(
        graph: &Arc<dyn Graph>,
        names: &Arc<Names>,
        topic: &TopicDescription,
        spec: &TopicSpec,
        context: &Context,
    ) -> Result<Self, GraphError> {
        let (inlet, receiver) = Inlet::new(&topic.name, spec.queue, spec.match_peers, context);
        // Weak, because the inlet owns the reader that owns the callback.
        let weak = Arc::downgrade(&inlet);
        let on_data: Notify = Arc::new(move || {
            if let Some(inlet) = weak.upgrade() {
                inlet.drain();
                inlet.wake.ring();
            }
        });
        let message_type = spec.message_type;
        let wake = context.wake.clone();
        let diagnosis = Diagnosis::new(
            names,
            (&topic.name, message_type.ros_type()),
            true,
            spec.match_peers,
            Arc::new(move || wake.ring()),
        )?;
        let matching = spec.match_peers.then(|| Matching::new(true, topic.qos));
        let reader = graph.subscribe(topic, Arc::clone(&on_data))?;
        inlet.lock().reader = Some(reader);
        // What came before the reader was in its place.
        inlet.drain();
        let blocks = matches!(spec.queue.overflow, Overflow::Block(_));
        Ok(Self {
            graph: Arc::clone(graph),
            topic: topic.clone(),
            inlet,
            on_data,
            receiver,
            blocks,
            message_type,
            limits: spec.limits,
            plugins: spec.plugins.clone(),
            follower: Follower::new(diagnosis, matching),
        })
    }

    /// The oldest message; under policy `block` its place goes to one that is held.
    fn next(&self) -> Option<Arrived> {
        let arrived = self.receiver.pop();
        if self.blocks {
            self.inlet.drain();
        }
        arrived.or_else(|| self.receiver.pop())
    }

    /// Opens a reader with `qos` beside the one there is.
    fn reopen(&mut self, qos: Qos, now: Instant) -> Result<(), GraphError> {
        let topic = TopicDescription { qos, ..self.topic.clone() };
        // From here on, because the new one may deliver before it is in its place.
        let first = {
            let mut state = self.inlet.lock();
            if let Some(replays) = &mut state.replays {
                replays.begin(now);
            }
            state.old.take()
        };
        // There were two already: the oldest has had its time.
        drop(first);
        let reader = match self.graph.subscribe(&topic, Arc::clone(&self.on_data)) {
            Ok(reader) => reader,
            Err(error) => {
                if let Some(replays) = &mut self.inlet.lock().replays {
                    replays.overlap_ended();
                }
                return Err(error);
            }
        };
        {
            let mut state = self.inlet.lock();
            state.old = state.reader.replace(reader).map(|old| (old, now));
        }
        self.inlet.drain();
        self.topic = topic;
        Ok(())
    }

    /// Closes the old reader when the new one has taken over; when to ask again, if not yet.
    fn close_old(&self, now: Instant) -> Option<Instant> {
        {
            let state = self.inlet.lock();
            let (old, since) = state.old.as_ref()?;
            let matched = state.reader.as_ref().map_or(0, |reader| reader.matched());
            let overlap = if matched >= old.matched() { OVERLAP } else { LONGEST_OVERLAP };
            if now < *since + overlap {
                return Some(*since + overlap);
            }
        }
        self.inlet.drain();
        let old = {
            let mut state = self.inlet.lock();
            if let Some(replays) = &mut state.replays {
                replays.overlap_ended();
            }
            state.old.take()
        };
        // Out of the lock, as in `drop`.
        drop(old);
        None
    }
}

impl Listener for Ros2Listener {
    fn take(&mut self) -> Result<Option<Sample>, TakeError> {
        let Some(Arrived { cdr, at }) = self.next() else { return Ok(None) };
        let wire_bytes = cdr.len();
        let payload = payload::decode(&cdr, self.message_type, &self.limits, &self.plugins)?;
        Ok(Some(Sample { payload, wire_bytes, received_at: at }))
    }

    fn discard(&mut self) -> bool {
        self.next().is_some()
    }

    fn link(&self) -> Link {
        let (matched, incompatible) = {
            let state = self.inlet.lock();
            let old = state.old.as_ref().map_or(0, |(old, _)| old.matched());
            match &state.reader {
                Some(reader) => (reader.matched().max(old), reader.incompatible()),
                None => (0, None),
            }
        };
        self.follower.link(matched, incompatible, &self.topic.qos, false)
    }

    fn review(&mut self, now: Instant) -> Review {
        let overlap_ends = self.close_old(now);
        let look = self.follower.look(&self.topic.qos, now);
        let mut review = Review { warnings: look.complaints, next: look.next, ..Review::default() };
        if let Some((to, why)) = look.switch {
            let from = self.topic.qos;
            match self.reopen(to, now) {
                Ok(()) => {
                    self.inlet.counters.qos_event(QosEvent::Changed, 1);
                    review.changed = Some(QosChange { from, to, why });
                }
                Err(error) => {
                    self.follower.retry(now + CALM);
                    review.warnings.push(format!("cannot be opened again with {to}: {error}"));
                }
            }
        }
        review.next = review.next.into_iter().chain(overlap_ends).min();
        review.qos = Some(self.topic.qos);
        review
    }
}

impl Drop for Ros2Listener {
    fn drop(&mut self) {
        // Out of the lock before they go: deleting one waits for a callback that may want the lock.
        // Here, and never in a callback that held the last share of the inlet.
        let readers = {
            let mut state = self.inlet.lock();
            (state.old.take(), state.reader.take())
        };
        drop(readers);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::middleware::ros2::graph::CdrSample;

    /// What a reader holds: sizes of messages, those over the limit as errors.
    #[derive(Clone, Default)]
    struct Waiting(Arc<Mutex<VecDeque<Result<usize, usize>>>>);

    impl Waiting {
        fn put(&self, message: Result<usize, usize>) {
            self.0.lock().unwrap().push_back(message);
        }
    }

    struct FakeReader(Waiting, u64);

    impl CdrReader for FakeReader {
        fn take(&mut self) -> Result<Option<CdrSample>, GraphError> {
            match self.0.0.lock().unwrap().pop_front() {
                None => Ok(None),
                Some(Ok(size)) => Ok(Some(CdrSample {
                    cdr: vec![0; size].into(),
                    source_timestamp_ns: 0,
                    publisher: 0,
                })),
                Some(Err(actual)) => {
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
