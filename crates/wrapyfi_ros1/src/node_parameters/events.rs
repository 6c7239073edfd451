//! Changes of a node's parameters, as ROS 2 tells of them.
//!
//! ```text
//!   NodeParameters ─ all of them, then what came, changed and went ─▶ EventQueue ─▶ take
//! ```

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Instant;

use bytes::Bytes;
use wrapyfi_interfaces::Message as _;
use wrapyfi_interfaces::rcl_interfaces::msg::ParameterEvent;

use super::found::node_of_events;
use super::source::{NodeParameters, SharedParameters};
use crate::node::Node;
use wrapyfi_data::types::{MessageType, RosMessage, RosType};
use wrapyfi_endpoint::{
    Context, DropReason, Link, Listener, Mutex, Sample, TakeError, TopicSpec, Wake,
};
use wrapyfi_node::parameters::MAX_EVENTS;

/// Events that were not taken.
pub(super) struct EventQueue {
    context: Context,
    events: Mutex<VecDeque<(Bytes, Instant)>>,
}

impl EventQueue {
    pub(super) fn put(&self, event: &ParameterEvent) {
        let cdr = event.encode().to_bytes();
        self.context.counters.received(cdr.len());
        let mut events = self.events.lock();
        if events.len() >= MAX_EVENTS {
            events.pop_front();
            self.context.counters.dropped(DropReason::QueueFull);
        }
        events.push_back((cdr, self.context.clock.now()));
        drop(events);
        self.context.wake.ring();
    }
}

/// Listens to the events of one node.
pub(crate) struct ParameterEvents {
    parameters: Arc<NodeParameters>,
    queue: Arc<EventQueue>,
    ros_type: RosType,
    /// Rings when the link has changed.
    _bell: Arc<Wake>,
}

impl ParameterEvents {
    /// A listener, where topic and type are those of a node's events.
    pub(crate) fn open(
        shared: &SharedParameters,
        node: &Arc<Node>,
        topic: &str,
        spec: &TopicSpec,
        context: &Context,
    ) -> Option<Self> {
        let MessageType::Ros(ros_type) = spec.message_type else { return None };
        let parameters = shared.of(node, node_of_events(topic, ros_type)?);
        let queue = Arc::new(EventQueue { context: context.clone(), events: Mutex::default() });
        let bell = parameters.ring(&context.wake);
        parameters.tell(&queue);
        Some(Self { parameters, queue, ros_type, _bell: bell })
    }
}

impl Listener for ParameterEvents {
    fn take(&mut self) -> Result<Option<Sample>, TakeError> {
        let Some((cdr, received_at)) = self.queue.events.lock().pop_front() else {
            return Ok(None);
        };
        let wire_bytes = cdr.len();
        let payload = RosMessage::new(self.ros_type, cdr).into();
        Ok(Some(Sample { payload, wire_bytes, received_at, origin: None }))
    }

    fn link(&self) -> Link {
        let waiting_for = self.parameters.waiting_for();
        Link { peers: Some(usize::from(waiting_for.is_none())), waiting_for, keeps_last: false }
    }
}
