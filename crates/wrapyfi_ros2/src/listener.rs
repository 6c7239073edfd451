//! Receives a topic: DDS reader, bounded queue, decoding.
//!
//! ```text
//!   DDS thread:  ReceivePath ──▶ inbox ──▶ take ─▶ decode   owner's thread
//!                                   └─ discard_except_latched ─▶ Latched ─┘
//! ```
//!
//! A listener that follows its publishers' quality of service is opened again when they change: the
//! new reader is there before the old one goes, and what comes from both is passed on once.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::diagnosis::Names;
use super::follow::Follower;
use super::graph::{
    DiscoveredEndpoint, Graph, GraphResult, Notify, ServiceMapping, TopicDescription, ringing,
};
use super::matching::CALM;
use super::receive_path::{Arrived, ReceivePath};
use super::vendor::mapping_of;
use wrapyfi_endpoint::codec::ros;
use wrapyfi_endpoint::{
    AnnouncedDurability, Context, DropReason, Durability, ForwardingListener, History, Latched,
    Link, Listener, Overflow, Qos, QosChange, QosEvent, Receiver, Review, Sample, SampleOrigin,
    SourceDurability, TakeError, TopicSpec,
};

/// Time for which two readers stay side by side: by then every publisher knows the new one.
const OVERLAP: Duration = Duration::from_secs(1);
/// The same where the new one does not match as many: some of those will not come back.
const LONGEST_OVERLAP: Duration = Duration::from_secs(3);
/// Time between two looks whether the publishers that keep messages are still there.
const LOOK_EVERY: Duration = Duration::from_millis(200);
/// Publishers that are remembered.
const MAX_ORIGINS: usize = 4096;

/// A ROS 2 subscription.
pub(super) struct Ros2Listener {
    graph: Arc<dyn Graph>,
    /// Topic with the quality of service in use.
    topic: TopicDescription,
    receive_path: Arc<ReceivePath>,
    on_data: Notify,
    receiver: Receiver<Arrived>,
    spec: TopicSpec,
    follower: Follower,
    /// Messages that came while no listener wanted them, of publishers that keep their last message for
    /// later subscribers: DDS gives it to a subscription once.
    unclaimed: Latched<u64, Arrived>,
    origins: Origins,
}

/// Publishers of the messages that were taken.
#[derive(Default)]
struct Origins {
    /// Number of messages that each publisher keeps for later subscribers.
    known: BTreeMap<u64, u32>,
    /// Kept theirs, are gone, and were not told of.
    ended_publishers: Vec<u64>,
    look_at: Option<Instant>,
    /// Number of publishers that matched at the last look.
    matched: usize,
    /// State of all matched publishers, whether they keep their last message, and the change of
    /// matches for which it holds.
    keeping: (Option<u64>, SourceDurability),
}

impl Ros2Listener {
    pub(super) fn open(
        graph: &Arc<dyn Graph>,
        names: &Arc<Names>,
        topic: &TopicDescription,
        spec: &TopicSpec,
        context: &Context,
    ) -> GraphResult<Self> {
        let (receive_path, receiver) =
            ReceivePath::new(&topic.name, spec.queue, spec.match_peers, context);
        // Weak, because the receive path owns the reader that owns the callback.
        let weak = Arc::downgrade(&receive_path);
        let on_data: Notify = Arc::new(move || {
            if let Some(receive_path) = weak.upgrade() {
                receive_path.drain();
                receive_path.context().wake.ring();
            }
        });
        let follower = Follower::new(names, topic, spec, true, ringing(&context.wake))?;
        let reader = graph.subscribe(topic, Arc::clone(&on_data))?;
        receive_path.lock().reader = Some(reader);
        // Messages may have come before the reader was in its place, when the callback found none.
        receive_path.drain();
        Ok(Self {
            graph: Arc::clone(graph),
            topic: topic.clone(),
            receive_path,
            on_data,
            receiver,
            spec: spec.clone(),
            follower,
            unclaimed: Latched::new(spec.limits.message_bytes),
            origins: Origins::default(),
        })
    }

    /// The oldest message; under policy `block` its place goes to one that is held.
    fn next(&self) -> Option<Arrived> {
        let arrived = self.receiver.pop();
        if matches!(self.spec.queue.overflow, Overflow::Block(_)) {
            self.receive_path.drain();
        } else {
            self.receive_path.make_up();
        }
        arrived.or_else(|| self.receiver.pop())
    }

    /// Number of messages that a publisher keeps for later subscribers.
    fn keeps(&mut self, publisher: u64) -> u32 {
        let asked = self.topic.qos.durability == Durability::TransientLocal;
        let untold = if asked { SampleOrigin::UNTOLD } else { 0 };
        // Messages that a publisher sent before the subscription follows it are kept there, too.
        if publisher == 0 || !(asked || self.spec.match_peers) {
            return untold;
        }
        if let Some(keeps) = self.origins.known.get(&publisher) {
            return *keeps;
        }
        let gid = {
            let state = self.receive_path.lock();
            state.reader.as_ref().and_then(|reader| reader.publisher_gid(publisher))
        };
        let peers = self.follower.diagnosis.peers();
        let peer = peers.iter().find(|peer| Some(peer.gid) == gid);
        let keeps = peer.map_or(untold, kept_by);
        if self.origins.known.len() < MAX_ORIGINS {
            self.origins.known.insert(publisher, keeps);
        }
        keeps
    }

    /// Looks who is gone, and what those who are there keep.
    fn look_at_origins(&mut self, now: Instant) {
        let changes = self.follower.diagnosis.changes();
        if self.origins.keeping.0 != Some(changes) {
            let peers = self.follower.diagnosis.peers();
            let keep = peers.iter().map(|peer| peer.qos.durability > AnnouncedDurability::Volatile);
            self.origins.keeping = (Some(changes), SourceDurability::of(keep));
        }
        let state = self.receive_path.lock();
        let matched = state.reader.as_ref().map_or(0, |reader| reader.matched());
        let is_due = self.origins.look_at.is_none_or(|at| now >= at);
        if self.origins.known.is_empty() || !(is_due || matched != self.origins.matched) {
            return;
        }
        self.origins.matched = matched;
        self.origins.look_at = Some(now + LOOK_EVERY);
        let readers = state.reader.iter().chain(state.old.as_ref().map(|(old, _)| old));
        let Some(there) = readers.map(|reader| reader.publishers()).collect::<Option<Vec<_>>>()
        else {
            return;
        };
        drop(state);
        let Origins { known, ended_publishers, .. } = &mut self.origins;
        known.retain(|publisher, keeps| {
            let stays = there.iter().flatten().any(|one| one == publisher);
            if !stays && *keeps > 0 {
                ended_publishers.push(*publisher);
            }
            stays
        });
    }

    /// Opens a reader with `qos` beside the one there is.
    fn reopen(&mut self, qos: Qos, now: Instant) -> GraphResult<()> {
        let topic = TopicDescription { qos, ..self.topic.clone() };
        let reader = self.graph.subscribe(&topic, Arc::clone(&self.on_data))?;
        {
            let mut state = self.receive_path.lock();
            if let Some(replays) = &mut state.replays {
                replays.begin(now);
            }
            state.old = state.reader.replace(reader).map(|old| (old, now));
        }
        self.receive_path.drain();
        self.topic = topic;
        Ok(())
    }

    /// Closes the old reader when the new one has taken over; when to ask again, if not yet.
    fn close_old(&self, now: Instant) -> Option<Instant> {
        {
            let state = self.receive_path.lock();
            let (old, since) = state.old.as_ref()?;
            let matched = state.reader.as_ref().map_or(0, |reader| reader.matched());
            let overlap = if matched >= old.matched() { OVERLAP } else { LONGEST_OVERLAP };
            if now < *since + overlap {
                return Some(*since + overlap);
            }
        }
        self.receive_path.drain();
        let old = {
            let mut state = self.receive_path.lock();
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

/// Number of messages that a publisher announces to keep for later subscribers.
fn kept_by(publisher: &DiscoveredEndpoint) -> u32 {
    if publisher.qos.durability == AnnouncedDurability::Volatile {
        return 0;
    }
    // Fast DDS does not announce its history, and what is not announced reads as 1, DDS's default.
    let announces = mapping_of(&publisher.gid, None) == Some(ServiceMapping::Cyclone);
    match publisher.qos.history {
        Some(History::KeepLast(1)) if !announces => SampleOrigin::UNTOLD,
        Some(History::KeepLast(depth)) => depth,
        Some(History::KeepAll) | None => SampleOrigin::UNTOLD,
    }
}

impl Listener for Ros2Listener {
    fn take(&mut self) -> Result<Option<Sample>, TakeError> {
        let next = self.unclaimed.pop().or_else(|| self.next());
        let Some(Arrived { cdr, at, publisher }) = next else { return Ok(None) };
        let keeps = self.keeps(publisher);
        let origin = (publisher != 0).then_some(SampleOrigin { publisher, keeps });
        let wire_bytes = cdr.len();
        let TopicSpec { message_type, limits, plugins, .. } = &self.spec;
        let payload = ros::decode(&cdr, *message_type, limits, plugins)?;
        Ok(Some(Sample { payload, wire_bytes, received_at: at, origin }))
    }

    fn discard(&mut self) -> bool {
        self.unclaimed.pop().or_else(|| self.next()).is_some()
    }

    fn forwarding(&mut self) -> Option<&mut dyn ForwardingListener> {
        Some(self)
    }

    fn link(&self) -> Link {
        let (matched, incompatible) = {
            let state = self.receive_path.lock();
            let old = state.old.as_ref().map_or(0, |(old, _)| old.matched());
            let reader = state.reader.as_ref();
            reader.map_or((0, None), |it| (it.matched().max(old), it.incompatible()))
        };
        self.follower.diagnosis.link(matched, incompatible, &self.topic.qos, false)
    }

    fn review(&mut self, now: Instant) -> Review {
        self.look_at_origins(now);
        // One change at a time: a third reader would cost the first before the second is known.
        if let Some(overlap_ends) = self.close_old(now) {
            let qos = Some(self.topic.qos);
            return Review { qos, next: Some(overlap_ends), ..Review::default() };
        }
        let look = self.follower.look(&self.topic.qos, now);
        let mut review = Review { warnings: look.complaints, next: look.next, ..Review::default() };
        if let Some((to, why)) = look.switch {
            let from = self.topic.qos;
            match self.reopen(to, now) {
                Ok(()) => {
                    self.receive_path.context().counters.qos_event(QosEvent::Changed, 1);
                    review.next = Some(now + OVERLAP);
                    review.changed = Some(QosChange { from, to, why });
                }
                Err(error) => {
                    self.follower.retry(now + CALM);
                    review.warnings.push(format!("cannot be opened again with {to}: {error}"));
                }
            }
        }
        review.qos = Some(self.topic.qos);
        review
    }
}

impl ForwardingListener for Ros2Listener {
    fn discard_except_latched(&mut self) -> Option<u64> {
        let message = self.next()?;
        Some(if self.keeps(message.publisher) > 0 {
            self.unclaimed.keep(message.publisher, message)
        } else {
            1
        })
    }

    fn ended_publisher(&mut self) -> Option<u64> {
        // Not before the last of its messages.
        if !self.receiver.is_empty() {
            return None;
        }
        let gone = self.origins.ended_publishers.pop()?;
        if self.unclaimed.forget(&gone) {
            self.receive_path.context().counters.dropped(DropReason::NoConsumer);
        }
        Some(gone)
    }

    fn durability(&self) -> SourceDurability {
        self.origins.keeping.1
    }
}

impl Drop for Ros2Listener {
    fn drop(&mut self) {
        let unclaimed = self.unclaimed.messages().len() as u64;
        self.receive_path.context().counters.dropped_many(DropReason::NoConsumer, unclaimed);
        // Here, and never in a callback that held the last share of the receive path.
        drop(self.receive_path.close());
    }
}
