//! Sets the parameters of a namespace, one after the other.
//!
//! ```text
//!   publish { gain: 2.5, camera.rate: 30 } ─▶ queue ─▶ task ─▶ setParam /x/gain 2.5, …
//!                                                        └─▶ watched: it is us who says so
//! ```

use std::sync::{Arc, Weak};

use tokio::sync::{mpsc, watch};

use super::values::{to_xml, under};
use super::watched;
use crate::node::Node;
use crate::xmlrpc::{self, text};
use wrapyfi_data::codec::properties_to_set;
use wrapyfi_data::types::Payload;
use wrapyfi_endpoint::{Context, Counters, DropReason, Link, PublishError, Publisher, TopicSpec};

/// Number of parameters that may wait for the master.
const LIMIT: usize = 10_000;

/// A parameter that is to be set, or deleted where it has no value.
struct Change {
    key: String,
    value: Option<xmlrpc::Value>,
    /// Has the end of the node wait for it.
    _lingers: watch::Receiver<()>,
}

/// Sets one namespace.
pub(crate) struct ParameterPublisher {
    node: Arc<Node>,
    key: String,
    max_bytes: usize,
    changes: mpsc::Sender<Change>,
}

impl ParameterPublisher {
    pub(crate) fn open(node: &Arc<Node>, key: &str, spec: &TopicSpec, context: &Context) -> Self {
        let (changes, waiting) = mpsc::channel(LIMIT);
        node.handle.spawn(send(Arc::downgrade(node), waiting, Arc::clone(&context.counters)));
        let max_bytes = spec.limits.message_bytes;
        Self { node: Arc::clone(node), key: key.to_owned(), max_bytes, changes }
    }
}

/// Tells the master what waits, in order, also after the publisher has gone.
async fn send(node: Weak<Node>, mut waiting: mpsc::Receiver<Change>, counters: Arc<Counters>) {
    while let Some(Change { key, value, _lingers }) = waiting.recv().await {
        let Some(node) = node.upgrade() else { return };
        if !watched::setting(&node, &key, value.as_ref()) {
            continue;
        }
        let (method, params) = match value {
            Some(value) => ("setParam", vec![text(&key), value]),
            None => ("deleteParam", vec![text(&key)]),
        };
        let done = node.master.ask(method, params).await;
        watched::was_set(&node, &key, done.is_ok());
        if let Err(error) = done {
            counters.dropped(DropReason::SendFailed);
            tracing::warn!(key, "ROS 1: a parameter was not set: {error}");
        }
    }
}

impl Publisher for ParameterPublisher {
    fn publish(&mut self, payload: &Payload) -> Result<usize, PublishError> {
        let (properties, size) = properties_to_set(payload, self.max_bytes)?;
        if let Some(reason) = self.node.fault() {
            let (topic, reason) = (self.key.clone(), reason.to_string());
            return Err(PublishError::Transport { topic, reason });
        }
        let Ok(places) = self.changes.try_reserve_many(properties.len()) else {
            return Err(PublishError::QueueFull { topic: self.key.clone(), depth: LIMIT });
        };
        for ((name, value), place) in properties.iter().zip(places) {
            let (key, value) = (under(&self.key, name), to_xml(value));
            place.send(Change { key, value, _lingers: self.node.lingering.subscribe() });
        }
        Ok(size)
    }

    fn link(&self) -> Link {
        let fault = self.node.fault();
        Link { peers: Some(usize::from(fault.is_none())), waiting_for: fault, keeps_last: false }
    }
}
