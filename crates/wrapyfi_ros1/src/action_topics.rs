//! The five topics of an action, opened as the node's own listeners and publishers.

use std::sync::Arc;

use super::action_messages::{CommonType, common_types};
use super::config::NAME;
use super::conversion;
use super::listener::Ros1Listener;
use super::node::Node;
use super::publisher::Ros1Publisher;
use wrapyfi_data::types::{MessageType, RosType};
use wrapyfi_endpoint::codec::ros1::Ros1Type;
use wrapyfi_endpoint::{
    ActionSpec, Context, DropReason, Durability, History, OpenError, OpenResult, Overflow, Qos,
    QueueSpec, TopicSpec,
};

/// Messages that wait on a topic: none is repeated, so there is room for those of many goals.
const DEPTH: u32 = 1000;
/// Status arrays that wait: a later one says what an earlier one does.
const STATUSES: u32 = 10;

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
        let kind = self.spec.kind;
        for part in [kind.goal(), kind.result(), kind.feedback()] {
            conversion::offered(&self.node, &self.topic_spec(&self.action, part, DEPTH))?;
        }
        Ok(())
    }

    /// Counts a message that cannot be used.
    pub(super) fn malformed(&self, fault: &str) {
        tracing::debug!("ROS 1: a message of action {} was dropped: {fault}", self.action);
        self.context.counters.dropped(DropReason::Malformed);
    }

    /// Name of a topic.
    pub(super) fn topic(&self, word: &str) -> String {
        format!("{}/{word}", self.action)
    }

    fn topic_spec(&self, topic: &str, ros_type: RosType, depth: u32) -> TopicSpec {
        let queue = QueueSpec {
            depth: usize::try_from(depth).unwrap_or(usize::MAX),
            overflow: Overflow::DropOldest,
        };
        let qos = Qos { history: History::KeepLast(depth), ..Qos::default() };
        let (limits, plugins) = (self.spec.limits, self.spec.plugins.clone());
        TopicSpec {
            qos,
            queue,
            limits,
            plugins,
            ..TopicSpec::new(topic, MessageType::Ros(ros_type))
        }
    }

    /// Bell and clock of the end, with counters of their own: status arrays are no messages of a route.
    fn uncounted(&self) -> Context {
        Context { counters: Arc::default(), ..self.context.clone() }
    }

    fn listen(
        &self,
        word: &str,
        (ros_type, wire_type): (RosType, Ros1Type),
        depth: u32,
        context: &Context,
    ) -> OpenResult<Ros1Listener> {
        let topic = self.topic(word);
        let spec = self.topic_spec(&topic, ros_type, depth);
        Ros1Listener::open(&self.node, &topic, wire_type, &spec, context)
    }

    /// Listens to goals, feedback or results.
    pub(super) fn listen_to(&self, word: &str, part: RosType) -> OpenResult<Ros1Listener> {
        let wanted = conversion::wanted(&self.node, MessageType::Ros(part));
        let wanted = wanted.ok_or_else(|| self.unusable(part))?;
        self.listen(word, (part, wanted), DEPTH, &self.context)
    }

    pub(super) fn listen_to_cancel(&self) -> OpenResult<Ros1Listener> {
        let CommonType { ros_type, wire_type } = &self.cancel;
        self.listen("cancel", (*ros_type, wire_type.clone()), DEPTH, &self.uncounted())
    }

    pub(super) fn listen_to_status(&self) -> OpenResult<Ros1Listener> {
        let CommonType { ros_type, wire_type } = &self.status;
        self.listen("status", (*ros_type, wire_type.clone()), STATUSES, &self.uncounted())
    }

    /// Publishes goals, feedback or results.
    pub(super) fn publish(&self, word: &str, part: RosType) -> OpenResult<Ros1Publisher> {
        let topic = self.topic(word);
        let spec = self.topic_spec(&topic, part, DEPTH);
        let offer = conversion::offered(&self.node, &spec)?.ok_or_else(|| self.unusable(part))?;
        Ros1Publisher::open(&self.node, &topic, offer, &spec, &self.context)
    }

    pub(super) fn publish_cancel(&self) -> OpenResult<Ros1Publisher> {
        self.publish_common("cancel", &self.cancel, Durability::Volatile)
    }

    /// Publishes status arrays; later subscribers get the last one.
    pub(super) fn publish_status(&self) -> OpenResult<Ros1Publisher> {
        self.publish_common("status", &self.status, Durability::TransientLocal)
    }

    fn publish_common(
        &self,
        word: &str,
        CommonType { wire_type, ros_type }: &CommonType,
        durability: Durability,
    ) -> OpenResult<Ros1Publisher> {
        let topic = self.topic(word);
        let mut spec = self.topic_spec(&topic, *ros_type, DEPTH);
        spec.qos.durability = durability;
        let offer = (wire_type.clone(), None);
        Ros1Publisher::open(&self.node, &topic, offer, &spec, &self.uncounted())
    }

    fn unusable(&self, part: RosType) -> OpenError {
        OpenError::transport(NAME, &self.action, format!("ROS 1 has no {part}"))
    }
}
