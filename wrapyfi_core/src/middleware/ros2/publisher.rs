//! Sends a topic: encoding, DDS writer.
//!
//! ```text
//!   publish ─▶ encode ─▶ [header][fields][pixels] ─▶ CdrWriter, one copy
//! ```

use std::sync::Arc;

use super::diagnosis::Diagnosis;
use super::graph::{CdrWriter, Graph, GraphError, TopicDescription};
use super::payload;
use crate::endpoint::{Context, Durability, History, Link, PublishError, Publisher, Qos};
use crate::types::{MessageType, Payload};
use crate::{EncodeError, Limits};

/// A ROS 2 publisher.
pub(super) struct Ros2Publisher {
    writer: Box<dyn CdrWriter>,
    topic: String,
    message_type: MessageType,
    qos: Qos,
    limits: Limits,
    diagnosis: Diagnosis,
}

impl Ros2Publisher {
    pub(super) fn open(
        graph: &Arc<dyn Graph>,
        topic: &TopicDescription,
        message_type: MessageType,
        limits: Limits,
        context: &Context,
    ) -> Result<Self, GraphError> {
        let wake = context.wake.clone();
        let writer = graph.advertise(topic, Arc::new(move || wake.ring()))?;
        let diagnosis =
            Diagnosis::new(Arc::clone(graph), topic.name.clone(), message_type.ros_type(), false);
        let (topic, qos) = (topic.name.clone(), topic.qos);
        Ok(Self { writer, topic, message_type, qos, limits, diagnosis })
    }
}

impl Publisher for Ros2Publisher {
    fn publish(&mut self, payload: &Payload) -> Result<usize, PublishError> {
        let pieces = payload::encode(payload, self.message_type)?;
        let parts: Vec<&[u8]> = pieces.iter().map(AsRef::as_ref).collect();
        let bytes = parts.iter().map(|part| part.len()).sum();
        if bytes > self.limits.message_bytes {
            let (actual, limit) = (bytes as u64, self.limits.message_bytes as u64);
            return Err(EncodeError::TooLarge { actual, limit }.into());
        }
        self.writer.write(&parts).map_err(|error| match error {
            GraphError::Timeout { topic, .. } => PublishError::QueueFull {
                topic,
                depth: match self.qos.history {
                    History::KeepLast(depth) => usize::try_from(depth).unwrap_or(usize::MAX),
                    History::KeepAll => usize::MAX,
                },
            },
            other => {
                PublishError::Transport { topic: self.topic.clone(), reason: other.to_string() }
            }
        })?;
        Ok(bytes)
    }

    fn link(&self) -> Link {
        let keeps_last = self.qos.durability == Durability::TransientLocal;
        self.diagnosis.link(self.writer.matched(), self.writer.incompatible(), keeps_last)
    }
}
