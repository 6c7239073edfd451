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

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use bytes::Bytes;

use super::diagnosis::Diagnosis;
use super::graph::{CdrReader, Graph, GraphError, TopicDescription};
use super::payload;
use crate::Limits;
use crate::endpoint::{
    Context, Counters, DropReason, Link, Listener, Overflow, QueueSpec, Receiver, Sample, Sender,
    TakeError, TopicSpec, Wake, inbox,
};
use crate::plugin::Plugins;
use crate::types::MessageType;

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
    /// Under policy `block`: arrived when the queue was full, oldest first.
    held: VecDeque<Arrived>,
    warned_oversize: bool,
}

impl Inlet {
    /// Without a reader yet.
    fn new(topic: &str, queue: QueueSpec, context: &Context) -> (Arc<Self>, Receiver<Arrived>) {
        let (sender, receiver) = inbox(queue, Arc::clone(&context.counters), context.wake.clone());
        let inlet = Self {
            state: Mutex::new(InletState {
                reader: None,
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
        let state = &mut *guard;
        self.refill(&mut state.held);
        let Some(reader) = &mut state.reader else { return };
        let lost = reader.lost();
        if lost > 0 {
            self.counters.dropped_many(DropReason::LostUpstream, lost);
        }
        loop {
            match reader.take() {
                Ok(Some(sample)) => {
                    self.counters.received(sample.cdr.len());
                    self.place(Arrived { cdr: sample.cdr, at: Instant::now() }, &mut state.held);
                }
                Ok(None) => return,
                Err(GraphError::TooLarge { actual, limit, .. }) => {
                    self.counters.received(actual);
                    self.counters.dropped(DropReason::Oversize);
                    if !std::mem::replace(&mut state.warned_oversize, true) {
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
    inlet: Arc<Inlet>,
    receiver: Receiver<Arrived>,
    blocks: bool,
    message_type: MessageType,
    limits: Limits,
    plugins: Plugins,
    diagnosis: Diagnosis,
}

impl Ros2Listener {
    pub(super) fn open(
        graph: &Arc<dyn Graph>,
        topic: &TopicDescription,
        spec: &TopicSpec,
        context: &Context,
    ) -> Result<Self, GraphError> {
        let (inlet, receiver) = Inlet::new(&topic.name, spec.queue, context);
        // Weak, because the inlet owns the reader that owns the callback.
        let weak = Arc::downgrade(&inlet);
        let on_data = Arc::new(move || {
            if let Some(inlet) = weak.upgrade() {
                inlet.drain();
                inlet.wake.ring();
            }
        });
        let reader = graph.subscribe(topic, on_data)?;
        inlet.lock().reader = Some(reader);
        // What came before the reader was in its place.
        inlet.drain();
        let message_type = spec.message_type;
        let diagnosis =
            Diagnosis::new(Arc::clone(graph), topic.name.clone(), message_type.ros_type(), true);
        let blocks = matches!(spec.queue.overflow, Overflow::Block(_));
        Ok(Self {
            inlet,
            receiver,
            blocks,
            message_type,
            limits: spec.limits,
            plugins: spec.plugins.clone(),
            diagnosis,
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
        let (matched, incompatible) = match &self.inlet.lock().reader {
            Some(reader) => (reader.matched(), reader.incompatible()),
            None => (0, None),
        };
        self.diagnosis.link(matched, incompatible, false)
    }
}

impl Drop for Ros2Listener {
    fn drop(&mut self) {
        // Out of the lock before it goes: deleting it waits for a callback that may want the lock.
        // Here, and never in a callback that held the last share of the inlet.
        let reader = self.inlet.lock().reader.take();
        drop(reader);
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
                Some(Ok(size)) => {
                    Ok(Some(CdrSample { cdr: vec![0; size].into(), source_timestamp_ns: 0 }))
                }
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
        let (inlet, receiver) = Inlet::new("/t", QueueSpec { depth: 2, overflow }, &context);
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
