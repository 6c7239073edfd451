//! Sets the parameters of a namespace, one after the other.
//!
//! ```text
//!   publish { gain: 2.5, camera.rate: 30 } ─▶ queue ─▶ task ─▶ setParam /x/gain 2.5, …
//!                                                        └─▶ watched: it is us who says so
//! ```

use std::collections::VecDeque;
use std::sync::{Arc, Weak};

use tokio::sync::{Notify, watch};

use super::values::{to_xml, under};
use super::watched;
use crate::node::Node;
use crate::xmlrpc::{self, text};
use wrapyfi_data::codec::properties_to_set;
use wrapyfi_data::types::Payload;
use wrapyfi_endpoint::{
    Context, Counters, DropReason, Link, Mutex, PublishError, Publisher, TopicSpec,
};

/// Sets one namespace.
pub(crate) struct ParameterPublisher {
    node: Arc<Node>,
    key: String,
    max_bytes: usize,
    outbox: Arc<Outbox>,
}

#[derive(Default)]
struct Outbox {
    queue: Mutex<Queue>,
    work: Notify,
}

#[derive(Default)]
struct Queue {
    /// `None` deletes.
    parameters: VecDeque<(String, Option<xmlrpc::Value>)>,
    /// The publisher is gone.
    closed: bool,
    /// Held while something waits.
    lingers: Option<watch::Receiver<()>>,
}

impl Outbox {
    /// Parameters that may wait for the master.
    const LIMIT: usize = 10_000;
}

impl ParameterPublisher {
    pub(crate) fn open(node: &Arc<Node>, key: &str, spec: &TopicSpec, context: &Context) -> Self {
        let outbox = Arc::<Outbox>::default();
        node.handle.spawn(send(
            Arc::downgrade(node),
            Arc::clone(&outbox),
            Arc::clone(&context.counters),
        ));
        let max_bytes = spec.limits.message_bytes;
        Self { node: Arc::clone(node), key: key.to_owned(), max_bytes, outbox }
    }
}

/// Tells the master what waits, in order.
async fn send(node: Weak<Node>, outbox: Arc<Outbox>, counters: Arc<Counters>) {
    loop {
        let (next, closed) = {
            let mut queue = outbox.queue.lock();
            let next = queue.parameters.pop_front();
            if next.is_none() {
                queue.lingers = None;
            }
            (next, queue.closed)
        };
        let Some((key, value)) = next else {
            if closed {
                return;
            }
            outbox.work.notified().await;
            continue;
        };
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
            return Err(PublishError::Transport { topic: self.key.clone(), reason });
        }
        let mut queue = self.outbox.queue.lock();
        if queue.parameters.len().saturating_add(properties.len()) > Outbox::LIMIT {
            let (topic, depth) = (self.key.clone(), Outbox::LIMIT);
            return Err(PublishError::QueueFull { topic, depth });
        }
        for (name, value) in properties.iter() {
            queue.parameters.push_back((under(&self.key, name), to_xml(value)));
        }
        if queue.lingers.is_none() {
            queue.lingers = Some(self.node.lingering.subscribe());
        }
        drop(queue);
        self.outbox.work.notify_one();
        Ok(size)
    }

    fn link(&self) -> Link {
        let fault = self.node.fault();
        Link { peers: Some(usize::from(fault.is_none())), waiting_for: fault, keeps_last: false }
    }
}

impl Drop for ParameterPublisher {
    fn drop(&mut self) {
        // Waiting changes are still sent, and then the task ends.
        self.outbox.queue.lock().closed = true;
        self.outbox.work.notify_one();
    }
}
