//! Receives a topic: takes from the inbox and decodes.
//!
//! ```text
//!   ListenerConnections ─▶ inbox ─▶ take ─▶ ROS 1 bytes ─▶ payload
//!                └─ discard_except_latched ─▶ the newest of each publisher that latches ─┘
//! ```

use std::sync::Arc;
use std::time::Instant;

use super::config::NAME;
use super::conversion;
use super::listener_connections::{Arrival, ListenerConnections, Wanted};
use super::node::Node;
use wrapyfi_endpoint::codec::ros1::Ros1Type;
use wrapyfi_endpoint::{
    Absent, Context, DropReason, ForwardingListener, Latched, Link, Listener, OpenResult, Peers,
    Receiver, Review, Role, Sample, SampleOrigin, SourceDurability, TakeError, TopicSpec, inbox,
};

/// Receives one topic.
pub(super) struct Ros1Listener {
    node: Arc<Node>,
    topic: String,
    connections: Arc<ListenerConnections>,
    inbox: Receiver<Arrival>,
    spec: TopicSpec,
    /// Latched messages that came while no listener wanted them, by publisher.
    latched: Latched<u64, Arrival>,
}

impl Ros1Listener {
    pub(super) fn open(
        node: &Arc<Node>,
        topic: &str,
        wire_type: Ros1Type,
        spec: &TopicSpec,
        context: &Context,
    ) -> OpenResult<Self> {
        let (sender, receiver) = inbox(spec.queue, context);
        let limit = spec.limits.message_bytes;
        let type_name = wire_type.name.clone();
        let ignore_through = spec.ignore_through.clone();
        let peers = Peers::of(&spec.options, Peers::FROM, NAME, topic)?;
        let wanted =
            Wanted { wire_type, message_type: spec.message_type, limit, ignore_through, peers };
        let connections = ListenerConnections::new(&node.core, topic, wanted, sender);
        node.listen(topic, &type_name, &connections);
        Ok(Self {
            node: Arc::clone(node),
            topic: topic.to_owned(),
            connections,
            inbox: receiver,
            spec: spec.clone(),
            latched: Latched::new(spec.limits.message_bytes),
        })
    }

    /// Takes the next message as it came.
    pub(super) fn next(&mut self) -> Option<Arrival> {
        self.latched.pop().or_else(|| self.inbox.pop())
    }

    /// Connections to the publishers.
    pub(super) fn connections(&self) -> &ListenerConnections {
        &self.connections
    }
}

impl Listener for Ros1Listener {
    fn take(&mut self) -> Result<Option<Sample>, TakeError> {
        let Some(arrival) = self.next() else { return Ok(None) };
        let Arrival { message, received_at, plan, source, latched } = arrival;
        let payload = conversion::decode(&message, plan.as_ref(), &self.spec)?;
        let origin = Some(SampleOrigin { publisher: source, keeps: u32::from(latched) });
        Ok(Some(Sample { payload, wire_bytes: message.len() + 4, received_at, origin }))
    }

    fn discard(&mut self) -> bool {
        self.next().is_some()
    }

    fn forwarding(&mut self) -> Option<&mut dyn ForwardingListener> {
        Some(self)
    }

    fn review(&mut self, _now: Instant) -> Review {
        Review { warnings: self.connections.untold_differences(), ..Review::default() }
    }

    fn link(&self) -> Link {
        let (peers, why) = self.connections.connected();
        let waiting_for = (peers == 0).then(|| {
            let nobody = || {
                Absent::new(Role::Publisher, "a ROS 1 node that publishes", NAME, &self.topic)
                    .into()
            };
            self.node.fault().or(why).unwrap_or_else(nobody)
        });
        Link { peers: Some(peers), waiting_for, keeps_last: false }
    }
}

impl ForwardingListener for Ros1Listener {
    fn discard_except_latched(&mut self) -> Option<u64> {
        let arrival = self.inbox.pop()?;
        if !arrival.latched {
            return Some(1);
        }
        Some(self.latched.keep(arrival.source, arrival))
    }

    fn ended_publisher(&mut self) -> Option<u64> {
        // Not before the last of its messages.
        if !self.inbox.is_empty() {
            return None;
        }
        let gone = self.connections.ended_publisher()?;
        if self.latched.forget(&gone) {
            self.connections.counters().dropped(DropReason::NoConsumer);
        }
        Some(gone)
    }

    fn durability(&self) -> SourceDurability {
        self.connections.keeping()
    }
}

impl Drop for Ros1Listener {
    fn drop(&mut self) {
        let latched = self.latched.messages().len() as u64;
        self.connections.counters().dropped_many(DropReason::NoConsumer, latched);
        self.node.unlisten(&self.topic, &self.connections);
    }
}
