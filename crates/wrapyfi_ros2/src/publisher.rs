//! Sends a topic: encoding, DDS writer.
//!
//! ```text
//!   publish ─▶ encode ─▶ [header][fields][pixels] ─▶ CdrWriter, one copy
//! ```
//!
//! A publisher that follows its subscribers' quality of service is opened again when one asks for
//! more. Every message goes through one writer, so none comes twice:
//!
//! ```text
//!   old writer ── used ──────────────┬── lingers, for what is not acknowledged ── closed
//!   new writer ── is discovered ─────┴── used
//! ```
//!
//! Messages that a publisher at the other end keeps for later subscribers go through a writer of
//! their own (`origins`).

use std::sync::Arc;
use std::time::{Duration, Instant};

use wrapyfi_interfaces::cdr::CdrParts;

use super::diagnosis::Names;
use super::follow::{EventLog, Follower};
use super::graph::{
    CdrWriter, DiscoveredEndpoint, Graph, GraphError, GraphResult, Notify, Replay,
    TopicDescription, WriterTraits, ringing,
};
use super::matching::CALM;
use super::origins::{MAX_ORIGINS, Origins};
use wrapyfi_data::EncodeError;
use wrapyfi_data::types::Payload;
use wrapyfi_endpoint::codec::ros;
use wrapyfi_endpoint::{
    AnnouncedDurability, Context, DropReason, Durability, ForwardingPublisher, History, Link,
    PublishError, Published, Publisher, Qos, QosChange, QosEvent, QosPolicy, Reliability, Review,
    SampleOrigin, SourceDurability, TopicSpec,
};

/// Time that a new writer has to become known to all subscribers, and an old one to send the
/// messages that it holds.
const HANDOVER: Duration = Duration::from_secs(1);

/// A ROS 2 publisher.
pub(super) struct Ros2Publisher {
    graph: Arc<dyn Graph>,
    /// Topic with the quality of service in use, or soon in use.
    topic: TopicDescription,
    /// Used.
    writer: Box<dyn CdrWriter>,
    /// Used from then on.
    new: Option<(Box<dyn CdrWriter>, Instant)>,
    /// Closed then.
    old: Option<(Box<dyn CdrWriter>, Instant)>,
    on_match: Notify,
    context: Context,
    events: EventLog,
    spec: TopicSpec,
    origins: Origins,
    /// State of the publishers at the other end, whether they keep their last message, where that
    /// is followed.
    source: SourceDurability,
    /// Messages that the writer gives to later readers.
    replay: Replay,
    /// The source is followed again from then on: the last try failed.
    follow_again: Option<Instant>,
    /// True once the log says that there are too many origins.
    warned_full: bool,
    follower: Follower,
}

impl Ros2Publisher {
    pub(super) fn open(
        graph: &Arc<dyn Graph>,
        names: &Arc<Names>,
        topic: &TopicDescription,
        spec: &TopicSpec,
        context: &Context,
    ) -> GraphResult<Self> {
        let on_match = ringing(&context.wake);
        let follower = Follower::new(names, topic, spec, false, Arc::clone(&on_match))?;
        let traits = WriterTraits { mark: spec.mark.as_ref(), ..WriterTraits::default() };
        Ok(Self {
            graph: Arc::clone(graph),
            writer: graph.advertise_with(topic, traits, Arc::clone(&on_match))?,
            new: None,
            old: None,
            topic: topic.clone(),
            on_match,
            context: context.clone(),
            events: EventLog::new(&context.counters, &topic.name, false),
            origins: Origins::default(),
            source: SourceDurability::Unknown,
            replay: Replay::History,
            follow_again: None,
            warned_full: false,
            spec: spec.clone(),
            follower,
        })
    }

    /// Opens a writer with `qos` beside the one there is.
    fn reopen(&mut self, qos: Qos, now: Instant) -> GraphResult<()> {
        let topic = TopicDescription { qos, ..self.topic.clone() };
        let replay = self.wanted_replay();
        let traits = WriterTraits { replay, mark: self.spec.mark.as_ref() };
        let writer = self.graph.advertise_with(&topic, traits, Arc::clone(&self.on_match))?;
        self.topic = topic;
        self.replay = replay;
        // One that was new until now was never used.
        self.new = Some((writer, now + HANDOVER));
        Ok(())
    }

    /// Messages that later readers are to be given: those that the publishers at the other end
    /// keep, where they are followed and known.
    fn wanted_replay(&self) -> Replay {
        match self.source {
            SourceDurability::Unknown => Replay::History,
            SourceDurability::All => Replay::Newest(1),
            SourceDurability::NoPublisher | SourceDurability::NotAll => Replay::Nothing,
        }
    }

    /// Quality of service that the publishers at the other end demand, and the reason in words;
    /// `None` while it is the present one.
    fn after_source(&self) -> Option<(Qos, String)> {
        let qos = self.topic.qos;
        let keeps = qos.durability == Durability::TransientLocal;
        let why = match self.source {
            SourceDurability::All if !keeps => {
                "its publishers keep their last message for who comes later"
            }
            SourceDurability::All if self.replay == Replay::Nothing => {
                "its publishers keep their last message now"
            }
            SourceDurability::NotAll if keeps && self.replay != Replay::Nothing => {
                "its publishers keep nothing for who comes later"
            }
            _ => return None,
        };
        Some((Qos { durability: Durability::TransientLocal, ..qos }, why.to_owned()))
    }

    /// Opens the writer of an origin that keeps messages, unless it is open: true where there is one.
    fn has_own_writer(&mut self, origin: SampleOrigin, now: Instant) -> GraphResult<bool> {
        let SampleOrigin { publisher: origin, keeps } = origin;
        if self.origins.has(origin) {
            return Ok(true);
        }
        if self.origins.is_full() {
            if !std::mem::replace(&mut self.warned_full, true) {
                tracing::warn!(
                    topic = self.topic.name,
                    "more than {MAX_ORIGINS} publishers keep their last message: those of the \
                     others are kept together, the newest only"
                );
            }
            return Ok(false);
        }
        let qos = Qos {
            durability: Durability::TransientLocal,
            reliability: Reliability::Reliable,
            ..self.topic.qos
        };
        let topic = TopicDescription { qos: self.spec.pinned.apply(qos), ..self.topic.clone() };
        if topic.qos.durability == Durability::Volatile {
            return Ok(false);
        }
        let on_match = Arc::clone(&self.on_match);
        let traits = WriterTraits { replay: Replay::Newest(keeps), mark: self.spec.mark.as_ref() };
        let writer = self.graph.advertise_with(&topic, traits, on_match)?;
        let volatile =
            |peer: &DiscoveredEndpoint| peer.qos.durability == AnnouncedDurability::Volatile;
        let opens = self.follower.diagnosis.peers().iter().any(volatile).then(|| now + HANDOVER);
        self.origins.enter(origin, writer, opens);
        // To be rung when messages may go.
        if opens.is_some() {
            (self.on_match)();
        }
        Ok(true)
    }

    fn encode(&self, payload: &Payload) -> Result<CdrParts, EncodeError> {
        let TopicSpec { message_type, limits, plugins, .. } = &self.spec;
        let parts = ros::encode(payload, *message_type, plugins)?;
        EncodeError::check_size(parts.len(), limits.message_bytes)?;
        Ok(parts)
    }

    fn fault(&self, error: GraphError) -> PublishError {
        match (error, self.topic.qos.history) {
            (GraphError::Timeout { topic, .. }, History::KeepLast(depth)) => {
                let depth = usize::try_from(depth).unwrap_or(usize::MAX);
                PublishError::QueueFull { topic, depth }
            }
            // A keep-all queue is bounded by bytes: the stack's own words say more.
            (error, _) => PublishError::Transport {
                topic: self.topic.name.clone(),
                reason: error.to_string(),
            },
        }
    }

    /// Hands over from one writer to the next, and closes the one before; when to look again.
    fn hand_over(&mut self, now: Instant) -> Option<Instant> {
        if self.old.as_ref().is_some_and(|&(_, closes)| now >= closes) {
            self.old = None;
        }
        match self.new.take() {
            // No program hears the old one: there is nothing to wait for.
            Some((new, due)) if now >= due || self.writer.matched() == 0 => {
                let old = std::mem::replace(&mut self.writer, new);
                self.old = Some((old, now + HANDOVER));
            }
            waiting => self.new = waiting,
        }
        let due = |slot: &Option<(Box<dyn CdrWriter>, Instant)>| slot.as_ref().map(|&(_, at)| at);
        due(&self.new).into_iter().chain(due(&self.old)).min()
    }
}

impl Publisher for Ros2Publisher {
    fn publish(&mut self, payload: &Payload) -> Published {
        let cdr = self.encode(payload)?;
        let parts: Vec<&[u8]> = cdr.pieces().iter().map(AsRef::as_ref).collect();
        self.writer.write(&parts).map_err(|error| self.fault(error))?;
        Ok(cdr.len())
    }

    fn forwarding(&mut self) -> Option<&mut dyn ForwardingPublisher> {
        Some(self)
    }

    fn link(&self) -> Link {
        let keeps_last = self.topic.qos.durability == Durability::TransientLocal
            && self.replay != Replay::Nothing;
        let (writer, matched) = match &self.new {
            Some((new, _)) => (new, self.writer.matched().max(new.matched())),
            None => (&self.writer, self.writer.matched()),
        };
        let matched = matched.max(self.origins.matched());
        self.follower.diagnosis.link(matched, writer.incompatible(), &self.topic.qos, keeps_last)
    }

    fn review(&mut self, now: Instant) -> Review {
        self.events.note(self.writer.qos_events(), now);
        self.events.note(self.origins.qos_events(), now);
        let mut look = self.follower.look(&self.topic.qos, now);
        if self.follow_again.is_none_or(|at| now >= at) {
            look.switch = look.switch.or_else(|| self.after_source());
        }
        let (origins_next, faults) = self.origins.look(now);
        for error in faults {
            self.context.counters.dropped(DropReason::SendFailed);
            tracing::warn!(topic = self.topic.name, "a message that was held is lost: {error}");
        }
        let mut review = Review { warnings: look.complaints, next: look.next, ..Review::default() };
        if let Some((to, why)) = look.switch {
            let from = self.topic.qos;
            match self.reopen(to, now) {
                Ok(()) => {
                    self.context.counters.qos_event(QosEvent::Changed, 1);
                    review.changed = Some(QosChange { from, to, why });
                }
                Err(error) => {
                    self.follower.retry(now + CALM);
                    self.follow_again = Some(now + CALM);
                    review.warnings.push(format!("cannot be opened again with {to}: {error}"));
                }
            }
        }
        let others = self.hand_over(now).into_iter().chain(origins_next);
        review.next = review.next.into_iter().chain(others).min();
        review.qos = Some(self.topic.qos);
        review.slowed = self.writer.slowed();
        review
    }
}

impl ForwardingPublisher for Ros2Publisher {
    fn forward(&mut self, payload: &Payload, origin: Option<SampleOrigin>) -> Published {
        let now = self.context.clock.now();
        // A history that is asked for is one of all.
        let one = self.topic.qos.durability == Durability::TransientLocal
            && self.topic.qos.history == History::KeepLast(1);
        let kept = self.spec.match_peers || one;
        let Some(origin) = origin.filter(|origin| kept && origin.keeps > 0) else {
            return self.publish(payload);
        };
        let publisher = origin.publisher;
        if !self.has_own_writer(origin, now).map_err(|error| self.fault(error))? {
            return self.publish(payload);
        }
        let cdr = self.encode(payload)?;
        let bytes = cdr.len();
        match self.origins.write(publisher, cdr, now) {
            Some(Ok(lost)) => {
                let lost = u64::try_from(lost).unwrap_or(u64::MAX);
                self.context.counters.dropped_many(DropReason::SendQueueFull, lost);
                Ok(bytes)
            }
            Some(Err(error)) => Err(self.fault(error)),
            None => self.publish(payload),
        }
    }

    fn forget(&mut self, publisher: u64) {
        self.origins.forget(publisher, self.context.clock.now(), HANDOVER);
    }

    fn forget_all(&mut self) {
        self.origins.forget_all(self.context.clock.now(), HANDOVER);
    }

    fn follow_source(&mut self, source: SourceDurability) {
        // A policy that is set from outside is not followed. Publishers that are gone may come back
        // as they were.
        let follows = self.spec.match_peers && !self.spec.pinned.holds(QosPolicy::Durability);
        let is_news = match source {
            SourceDurability::Unknown => false,
            SourceDurability::NoPublisher => self.source == SourceDurability::Unknown,
            SourceDurability::All | SourceDurability::NotAll => true,
        };
        if follows && is_news {
            self.source = source;
        }
    }
}
