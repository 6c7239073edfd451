//! A topic received: decodes what its connection has put into the inbox.

use std::sync::Arc;

use super::codec;
use super::reception::{Arrival, Reception};
use super::shared::ZeroMqState;
use super::socket::Socket;
use super::zmtp::Kind;
use wrapyfi_endpoint::{Context, Link, Listener, Receiver, Sample, TakeError, TopicSpec};

/// Receives one topic through the broker.
pub(super) struct ZeroMqListener {
    socket: Arc<Socket<Reception>>,
    spec: TopicSpec,
    inbox: Receiver<Arrival>,
}

impl ZeroMqListener {
    pub(super) fn open(shared: &ZeroMqState, spec: &TopicSpec, context: &Context) -> Self {
        let (socket, inbox) = Reception::open(shared, spec, context);
        shared.ledger.enter(Kind::Xsub, &spec.topic, &context.counters);
        Self { socket, spec: spec.clone(), inbox }
    }
}

impl Listener for ZeroMqListener {
    fn take(&mut self) -> Result<Option<Sample>, TakeError> {
        let Some(arrival) = self.inbox.pop() else { return Ok(None) };
        let payload = codec::decode(&arrival.frames, &self.spec, arrival.stamp)?;
        let Arrival { wire_bytes, received_at, .. } = arrival;
        Ok(Some(Sample { payload, wire_bytes, received_at, origin: None }))
    }

    fn discard(&mut self) -> bool {
        self.inbox.pop().is_some()
    }

    fn link(&self) -> Link {
        // A broker does not tell listeners who publishes.
        Link { peers: None, waiting_for: self.socket.link.waiting_for(), keeps_last: false }
    }
}

impl Drop for ZeroMqListener {
    fn drop(&mut self) {
        self.socket.close();
    }
}
