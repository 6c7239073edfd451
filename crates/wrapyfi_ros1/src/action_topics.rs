//! The five topics of an action, opened as the node's own listeners and publishers.

use std::sync::Arc;

use wrapyfi_interfaces::named;

use super::action_messages::{CommonType, common_types};
use super::config::NAME;
use super::conversion;
use super::listener::Ros1Listener;
use super::node::Node;
use super::publisher::Ros1Publisher;
use wrapyfi_data::types::MessageType;
use wrapyfi_endpoint::codec::ros1::Ros1Type;
use wrapyfi_endpoint::{
    ActionSpec, Context, DropReason, Durability, History, OpenError, OpenResult, Overflow, Qos,
    QueueSpec, TopicSpec,
};

/// Messages that wait on a topic: none is repeated, so there is room for those of many goals.
const DEPTH: u32 = 1000;
/// Status arrays that wait: a later one says what an earlier one does.
const STATUSES: u32 = 10;

named! {
    /// A topic of an action.
    pub(super) enum ActionTopic {
        Goal => "goal",
        Cancel => "cancel",
        Status => "status",
        Feedback => "feedback",
        Result => "result",
    }
    /// Last word of its name.
    pub fn word;
}

/// Node, name and settings that the topics of an action share.
pub(super) struct ActionTopics {
    pub(super) node: Arc<Node>,
    /// Absolute name of the action.
    pub(super) action: String,
    pub(super) spec: ActionSpec,
    pub(super) context: Context,
    cancel: CommonType,
    status: CommonType,
}

impl ActionTopics {
    pub(super) fn new(
        node: &Arc<Node>,
        action: String,
        spec: &ActionSpec,
        context: &Context,
    ) -> OpenResult<Self> {
        let [cancel, status] = common_types(node, &spec.action, spec.kind)?;
        let (node, spec, context) = (Arc::clone(node), spec.clone(), context.clone());
        Ok(Self { node, action, spec, context, cancel, status })
    }

    /// Fails where the action can never be offered, because a part of it has no definition.
    pub(super) fn check(&self) -> OpenResult<()> {
        for part in [ActionTopic::Goal, ActionTopic::Result, ActionTopic::Feedback] {
            let (spec, ..) = self.settings(part, DEPTH);
            conversion::offered(&self.node, &TopicSpec { topic: self.action.clone(), ..spec })?;
        }
        Ok(())
    }

    /// Counts a message that cannot be used.
    pub(super) fn malformed(&self, fault: &str) {
        tracing::debug!("ROS 1: a message of action {} was dropped: {fault}", self.action);
        self.context.counters.dropped(DropReason::Malformed);
    }

    /// Name of a topic.
    pub(super) fn topic(&self, topic: ActionTopic) -> String {
        format!("{}/{topic}", self.action)
    }

    /// Settings of a topic; its type on the wire, where all actions have the same; its context. Those that all actions
    /// have the same way are no messages of a route, and counted apart.
    fn settings(&self, topic: ActionTopic, depth: u32) -> (TopicSpec, Option<&Ros1Type>, Context) {
        let kind = self.spec.kind;
        let (ros_type, common) = match topic {
            ActionTopic::Goal => (kind.goal(), None),
            ActionTopic::Cancel => (self.cancel.ros_type, Some(&self.cancel.wire_type)),
            ActionTopic::Status => (self.status.ros_type, Some(&self.status.wire_type)),
            ActionTopic::Feedback => (kind.feedback(), None),
            ActionTopic::Result => (kind.result(), None),
        };
        let queue = QueueSpec {
            depth: usize::try_from(depth).unwrap_or(usize::MAX),
            overflow: Overflow::DropOldest,
        };
        let spec = TopicSpec {
            qos: Qos { history: History::KeepLast(depth), ..Qos::default() },
            queue,
            limits: self.spec.limits,
            plugins: self.spec.plugins.clone(),
            ..TopicSpec::new(self.topic(topic), MessageType::Ros(ros_type))
        };
        let mut context = self.context.clone();
        if common.is_some() {
            context.counters = Arc::default();
        }
        (spec, common, context)
    }

    pub(super) fn listen_to(&self, topic: ActionTopic) -> OpenResult<Ros1Listener> {
        let depth = if topic == ActionTopic::Status { STATUSES } else { DEPTH };
        let (spec, common, context) = self.settings(topic, depth);
        let wanted = || conversion::wanted(&self.node, spec.message_type);
        let wire_type = common.cloned().or_else(wanted).ok_or_else(|| self.unusable(&spec))?;
        Ros1Listener::open(&self.node, &spec.topic, wire_type, &spec, &context)
    }

    /// Publishes on a topic; later subscribers get the last status array.
    pub(super) fn publish(&self, topic: ActionTopic) -> OpenResult<Ros1Publisher> {
        let (mut spec, common, context) = self.settings(topic, DEPTH);
        if topic == ActionTopic::Status {
            spec.qos.durability = Durability::TransientLocal;
        }
        if let (ActionTopic::Status, Some(wire_type)) = (topic, common) {
            let wire_type = wire_type.clone();
            return Ros1Publisher::of_own_action(
                &self.node,
                &spec.topic,
                wire_type,
                &spec,
                &context,
            );
        }
        let offer = match common {
            Some(wire_type) => Some((wire_type.clone(), None)),
            None => conversion::offered(&self.node, &spec)?,
        };
        let offer = offer.ok_or_else(|| self.unusable(&spec))?;
        Ros1Publisher::open(&self.node, &spec.topic, offer, &spec, &context)
    }

    fn unusable(&self, spec: &TopicSpec) -> OpenError {
        let part = spec.message_type.ros_type();
        OpenError::transport(NAME, &self.action, format!("ROS 1 has no {part}"))
    }
}
