//! Sends a topic: encoding, DDS writer.
//!
//! ```text
//!   publish ─▶ encode ─▶ [header][fields][pixels] ─▶ CdrWriter, one copy
//! ```

use std::sync::Arc;

use super::diagnosis::Diagnosis;
use super::graph::{CdrWriter, Graph, GraphError, TopicDescription};
use super::payload;
use crate::Limits;
use crate::endpoint::{
    Context, Durability, History, Link, PublishError, Publisher, Qos, TopicSpec,
};
use crate::plugin::Plugins;
use crate::types::{Encoding, MessageType, Payload};

/// A ROS 2 publisher.
pub(super) struct Ros2Publisher {
    writer: Box<dyn CdrWriter>,
    topic: String,
    message_type: MessageType,
    qos: Qos,
    color_order: Encoding,
    limits: Limits,
    plugins: Plugins,
    diagnosis: Diagnosis,
}

impl Ros2Publisher {
    pub(super) fn open(
        graph: &Arc<dyn Graph>,
        topic: &TopicDescription,
        spec: &TopicSpec,
        context: &Context,
    ) -> Result<Self, GraphError> {
        let wake = context.wake.clone();
        let writer = graph.advertise(topic, Arc::new(move || wake.ring()))?;
        let message_type = spec.message_type;
        let diagnosis =
            Diagnosis::new(Arc::clone(graph), topic.name.clone(), message_type.ros_type(), false);
        Ok(Self {
            writer,
            topic: topic.name.clone(),
            message_type,
            qos: topic.qos,
            color_order: spec.color_order,
            limits: spec.limits,
            plugins: spec.plugins.clone(),
            diagnosis,
        })
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
        self.writer.write(&parts).map_err(|error| match (error, self.qos.history) {
            (GraphError::Timeout { topic, .. }, History::KeepLast(depth)) => {
                let depth = usize::try_from(depth).unwrap_or(usize::MAX);
                PublishError::QueueFull { topic, depth }
            }
            // A keep-all queue is bounded by bytes: the stack's own words say more.
            (error, _) => {
                PublishError::Transport { topic: self.topic.clone(), reason: error.to_string() }
            }
        })?;
        Ok(cdr.len())
    }

    fn link(&self) -> Link {
        let keeps_last = self.qos.durability == Durability::TransientLocal;
        self.diagnosis.link(self.writer.matched(), self.writer.incompatible(), keeps_last)
    }
}
