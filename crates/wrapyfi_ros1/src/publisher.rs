//! Publishes a topic: encodes, and hands to the publication.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Instant;

use bytes::Bytes;
use wrapyfi_interfaces::ros1::PairPlan;

use super::config::NAME;
use super::node::{Mark, Node};
use super::publication::{Entry, KEEP_ALL, Keep, Publication};
use super::subscriber::Frame;
use super::{conversion, differences};
use wrapyfi_data::types::{MessageType, Payload, RosMessage};
use wrapyfi_data::{EncodeError, EncodeResult};
use wrapyfi_endpoint::codec::ros1::Ros1Type;
use wrapyfi_endpoint::{
    Context, Durability, ForwardingPublisher, History, Latched, Link, OpenResult, Peers,
    PublishError, Published, Publisher, Review, Role, SampleOrigin, SourceDurability, TopicSpec,
};

/// Sends to one topic.
pub(super) struct Ros1Publisher {
    id: u64,
    node: Arc<Node>,
    publication: Arc<Publication>,
    spec: TopicSpec,
    plan: Option<PairPlan>,
    /// Differences of the two definitions that were not told yet.
    untold: Vec<String>,
    sequence: u32,
    /// True when the publisher was opened as one that latches, whatever it publishes.
    latches: bool,
    /// All that its source publishes is kept there.
    source_latches: bool,
    /// Told to other bridges while the publisher lives.
    _mark: Option<Mark>,
}

impl Ros1Publisher {
    pub(super) fn open(
        node: &Arc<Node>,
        topic: &str,
        offer: (Ros1Type, Option<PairPlan>),
        spec: &TopicSpec,
        context: &Context,
    ) -> OpenResult<Self> {
        Self::enter(node, topic, offer, spec, context, false)
    }

    /// Publishes the status of an action, and says to others that it is the node's own.
    pub(super) fn of_own_action(
        node: &Arc<Node>,
        topic: &str,
        wire_type: Ros1Type,
        spec: &TopicSpec,
        context: &Context,
    ) -> OpenResult<Self> {
        Self::enter(node, topic, (wire_type, None), spec, context, true)
    }

    fn enter(
        node: &Arc<Node>,
        topic: &str,
        (wire_type, plan): (Ros1Type, Option<PairPlan>),
        spec: &TopicSpec,
        context: &Context,
        is_offer: bool,
    ) -> OpenResult<Self> {
        let md5 = wire_type.md5.clone();
        let latches = spec.qos.durability == Durability::TransientLocal;
        let depth = match spec.qos.history {
            History::KeepLast(depth) => usize::try_from(depth).unwrap_or(KEEP_ALL),
            History::KeepAll => KEEP_ALL,
        };
        let id = node.next_id();
        let entry = Entry {
            latches,
            kept: Latched::new(spec.limits.message_bytes),
            warned: false,
            depth,
            counters: Arc::clone(&context.counters),
            wake: context.wake.clone(),
            peers: Peers::of(&spec.options, Peers::TO, NAME, topic)?,
        };
        let publication = node.advertise(
            topic,
            &md5,
            || Publication::new(topic, wire_type, spec.mark.clone(), is_offer),
            |publication| publication.add(id, entry),
        );
        let mark = node.mark(Role::Publisher, topic, &spec.mark);
        let untold = match (&plan, spec.message_type) {
            (Some(plan), MessageType::Ros(ros_type)) => differences::of_plan(plan, ros_type),
            _ => Vec::new(),
        };
        let (node, spec, sequence) = (Arc::clone(node), spec.clone(), 0);
        Ok(Self {
            id,
            node,
            publication,
            spec,
            plan,
            untold,
            sequence,
            latches,
            source_latches: false,
            _mark: mark,
        })
    }

    /// Changes what the publication knows of this publisher.
    fn change(&self, change: impl FnOnce(&mut Entry)) {
        self.publication.change(self.id, change);
    }

    /// Names of the subscribers' nodes.
    pub(super) fn callers(&self) -> BTreeSet<String> {
        self.publication.callers()
    }

    /// Sends a message that begins with what `head` makes of its number, and ends with `part`, if there is one.
    pub(super) fn send_part(
        &mut self,
        head: impl FnOnce(u32) -> Vec<u8>,
        part: Option<&RosMessage>,
    ) -> Published {
        let mut pieces = vec![head(self.sequence).into()];
        if let (Some(part), Some(plan)) = (part, &self.plan) {
            pieces.push(conversion::to_ros1(part, plan, 0, &self.spec.limits)?.into());
        }
        let keep = if self.latches { Keep::LastOf(None) } else { Keep::No };
        let frame = self.frame(pieces)?;
        self.send_frame(&frame, keep)
    }

    fn encode(&mut self, payload: &Payload) -> EncodeResult<Frame> {
        let pieces = conversion::encode(payload, self.plan.as_ref(), self.sequence, &self.spec)?;
        self.frame(pieces)
    }

    fn frame(&mut self, pieces: Vec<Bytes>) -> EncodeResult<Frame> {
        self.sequence = self.sequence.wrapping_add(1);
        let size: usize = pieces.iter().map(Bytes::len).sum();
        let (actual, limit) = (size as u64, u64::from(u32::MAX));
        Frame::new(pieces).ok_or(EncodeError::TooLarge { actual, limit })
    }

    /// While no program subscribes nothing is encoded, unless it is kept.
    fn send(&mut self, payload: &Payload, keep: Keep) -> Published {
        if keep == Keep::No && self.publication.subscribers() == 0 {
            return Err(PublishError::NoConsumer(self.spec.topic.clone()));
        }
        let frame = self.encode(payload)?;
        self.send_frame(&frame, keep)
    }

    fn send_frame(&self, frame: &Frame, keep: Keep) -> Published {
        let reached = self.publication.send(self.id, frame, keep);
        if reached == 0 && keep == Keep::No {
            return Err(PublishError::NoConsumer(self.spec.topic.clone()));
        }
        Ok(frame.len())
    }
}

impl Publisher for Ros1Publisher {
    fn publish(&mut self, payload: &Payload) -> Published {
        let keep = if self.latches { Keep::LastOf(None) } else { Keep::No };
        self.send(payload, keep)
    }

    fn forwarding(&mut self) -> Option<&mut dyn ForwardingPublisher> {
        Some(self)
    }

    fn review(&mut self, _now: Instant) -> Review {
        Review { warnings: std::mem::take(&mut self.untold), ..Review::default() }
    }

    fn link(&self) -> Link {
        let peers = self.publication.subscribers();
        let awaited = || {
            let awaited = self.publication.awaited();
            self.node.core.announces_loopback(Some(&awaited)).unwrap_or(awaited)
        };
        let waiting_for = (peers == 0).then(|| self.node.fault().unwrap_or_else(awaited));
        let keeps_last = self.latches || self.source_latches;
        Link { peers: Some(peers), waiting_for, keeps_last }
    }
}

impl ForwardingPublisher for Ros1Publisher {
    fn forward(&mut self, payload: &Payload, origin: Option<SampleOrigin>) -> Published {
        match origin {
            Some(SampleOrigin { publisher, keeps: 1.. })
                if self.latches || self.spec.match_peers =>
            {
                self.send(payload, Keep::LastOf(Some(publisher)))
            }
            _ => self.publish(payload),
        }
    }

    fn forget(&mut self, publisher: u64) {
        self.change(|entry| _ = entry.kept.forget(&Some(publisher)));
    }

    fn forget_all(&mut self) {
        self.change(|entry| entry.kept.retain(Option::is_none));
    }

    fn follow_source(&mut self, source: SourceDurability) {
        let keeps_last = match source {
            SourceDurability::All => true,
            SourceDurability::NotAll => false,
            // Publishers that are gone may come back as they were.
            SourceDurability::Unknown | SourceDurability::NoPublisher => return,
        };
        if !self.spec.match_peers || keeps_last == self.source_latches {
            return;
        }
        self.source_latches = keeps_last;
        self.change(|entry| entry.latches = self.latches || keeps_last);
    }
}

impl Drop for Ros1Publisher {
    fn drop(&mut self) {
        self.publication.remove(self.id);
        self.node.unadvertise(&self.publication.topic, &self.publication);
    }
}
