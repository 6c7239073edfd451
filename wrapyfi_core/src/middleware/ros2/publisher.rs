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

use std::sync::Arc;
use std::time::{Duration, Instant};

use super::diagnosis::{Diagnosis, Names};
use super::follow::{EventLog, Follower};
use super::graph::{CdrWriter, Graph, GraphError, Notify, TopicDescription};
use super::matching::{CALM, Matching};
use super::payload;
use crate::Limits;
use crate::endpoint::{
    BridgeMark, Context, Counters, Durability, History, Link, PublishError, Publisher, Qos,
    QosChange, QosEvent, Review, TopicSpec,
};
use crate::plugin::Plugins;
use crate::types::{Encoding, MessageType, Payload};

/// How long a new writer is given to be known to all subscribers, and an old one to be rid of what
/// it holds.
const HANDOVER: Duration = Duration::from_secs(1);

/// A ROS 2 publisher.
pub(super) struct Ros2Publisher {
    graph: Arc<dyn Graph>,
    /// With the quality of service in use, or soon in use.
    topic: TopicDescription,
    /// Used.
    writer: Box<dyn CdrWriter>,
    /// Used from then on.
    new: Option<(Box<dyn CdrWriter>, Instant)>,
    /// Closed then.
    old: Option<(Box<dyn CdrWriter>, Instant)>,
    on_match: Notify,
    counters: Arc<Counters>,
    events: EventLog,
    message_type: MessageType,
    color_order: Encoding,
    limits: Limits,
    plugins: Plugins,
    follower: Follower,
    mark: Option<BridgeMark>,
}

impl Ros2Publisher {
    pub(super) fn open(
        graph: &Arc<dyn Graph>,
        names: &Arc<Names>,
        topic: &TopicDescription,
        spec: &TopicSpec,
        context: &Context,
    ) -> Result<Self, GraphError> {
        let wake = context.wake.clone();
        let on_match: Notify = Arc::new(move || wake.ring());
        let message_type = spec.message_type;
        let diagnosis = Diagnosis::new(
            names,
            topic,
            message_type.ros_type(),
            false,
            (spec.match_peers, spec.pinned),
            Arc::clone(&on_match),
        )?;
        let matching = spec.match_peers.then(|| Matching::new(false, topic.qos, spec.pinned));
        Ok(Self {
            graph: Arc::clone(graph),
            writer: graph.advertise_marked(topic, spec.mark.as_ref(), Arc::clone(&on_match))?,
            mark: spec.mark.clone(),
            new: None,
            old: None,
            topic: topic.clone(),
            on_match,
            counters: Arc::clone(&context.counters),
            events: EventLog::new(&context.counters, &topic.name, false),
            message_type,
            color_order: spec.color_order,
            limits: spec.limits,
            plugins: spec.plugins.clone(),
            follower: Follower::new(diagnosis, matching),
        })
    }

    /// Opens a writer with `qos` beside the one there is.
    fn reopen(&mut self, qos: Qos, now: Instant) -> Result<(), GraphError> {
        let topic = TopicDescription { qos, ..self.topic.clone() };
        let mark = self.mark.as_ref();
        let writer = self.graph.advertise_marked(&topic, mark, Arc::clone(&self.on_match))?;
        self.topic = topic;
        // One that was new until now was never used.
        self.new = Some((writer, now + HANDOVER));
        Ok(())
    }

    /// Hands over from one writer to the next, and closes the one before; when to look again.
    fn hand_over(&mut self, now: Instant) -> Option<Instant> {
        if self.old.as_ref().is_some_and(|&(_, closes)| now >= closes) {
            self.old = None;
        }
        match self.new.take() {
            // Nobody hears the old one: there is nothing to wait for.
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
    fn publish(&mut self, payload: &Payload) -> Result<usize, PublishError> {
        let cdr = payload::encode(
            payload,
            self.message_type,
            self.color_order,
            &self.limits,
            &self.plugins,
        )?;
        let parts: Vec<&[u8]> = cdr.pieces().iter().map(AsRef::as_ref).collect();
        self.writer.write(&parts).map_err(|error| match (error, self.topic.qos.history) {
            (GraphError::Timeout { topic, .. }, History::KeepLast(depth)) => {
                let depth = usize::try_from(depth).unwrap_or(usize::MAX);
                PublishError::QueueFull { topic, depth }
            }
            // A keep-all queue is bounded by bytes: the stack's own words say more.
            (error, _) => PublishError::Transport {
                topic: self.topic.name.clone(),
                reason: error.to_string(),
            },
        })?;
        Ok(cdr.len())
    }

    fn link(&self) -> Link {
        let keeps_last = self.topic.qos.durability == Durability::TransientLocal;
        let (writer, matched) = match &self.new {
            Some((new, _)) => (new, self.writer.matched().max(new.matched())),
            None => (&self.writer, self.writer.matched()),
        };
        self.follower.link(matched, writer.incompatible(), &self.topic.qos, keeps_last)
    }

    fn review(&mut self, now: Instant) -> Review {
        self.events.note(self.writer.qos_events(), now);
        self.writer.prepare();
        if let Some((new, _)) = &mut self.new {
            new.prepare();
        }
        let look = self.follower.look(&self.topic.qos, now);
        let mut review = Review { warnings: look.complaints, next: look.next, ..Review::default() };
        if let Some((to, why)) = look.switch {
            let from = self.topic.qos;
            match self.reopen(to, now) {
                Ok(()) => {
                    self.counters.qos_event(QosEvent::Changed, 1);
                    review.changed = Some(QosChange { from, to, why });
                }
                Err(error) => {
                    self.follower.retry(now + CALM);
                    review.warnings.push(format!("cannot be opened again with {to}: {error}"));
                }
            }
        }
        review.next = review.next.into_iter().chain(self.hand_over(now)).min();
        review.qos = Some(self.topic.qos);
        review
    }
}
