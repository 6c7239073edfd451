//! An endpoint that sets the parameters of a node.

use super::ServiceOptions;
use super::listener::link;
use super::{ParameterClient, ParameterClientError, ParameterResult};
use crate::graph::Peers;
use crate::ros2::Ros2;
use wrapyfi_data::Limits;
use wrapyfi_data::codec::properties_to_set;
use wrapyfi_data::types::Payload;
use wrapyfi_endpoint::{Context, Link, PublishError, Publisher, TopicSpec, Wake};

/// Sets parameters of one node. Each message waits for the node's answer.
pub(crate) struct PropertiesPublisher {
    client: ParameterClient,
    max_bytes: usize,
    wake: Wake,
}

impl PropertiesPublisher {
    pub(crate) fn open(ros2: &Ros2, spec: &TopicSpec, context: &Context) -> ParameterResult<Self> {
        let max_bytes = spec.limits.message_bytes;
        // No longer than the end of the program may wait for it.
        let options = ServiceOptions { max_bytes, timeout: Limits::SHUTDOWN };
        Ok(Self {
            client: ParameterClient::open(ros2, &spec.topic, &options, &context.wake)?,
            max_bytes,
            wake: context.wake.clone(),
        })
    }
}

impl Publisher for PropertiesPublisher {
    fn publish(&mut self, payload: &Payload) -> Result<usize, PublishError> {
        let (properties, size) = properties_to_set(payload, self.max_bytes)?;
        if self.client.servers() == Peers::None {
            let topic = self.client.node().to_owned();
            return Err(PublishError::NoConsumer(topic));
        }
        let set = self.client.set(properties);
        // Waiting for the answer has heard what rang for others.
        self.wake.ring();
        set.map(|()| size).map_err(|error| {
            let (topic, reason) = (self.client.node().to_owned(), error.to_string());
            match error {
                ParameterClientError::Refused { .. } => PublishError::Refused { topic, reason },
                _ => PublishError::Transport { topic, reason },
            }
        })
    }

    fn link(&self) -> Link {
        link(self.client.node(), &self.client.servers(), None)
    }
}
