//! A topic received: decodes what its connection has put into the inbox.

use std::sync::Arc;

use super::codec;
use super::io::{Command, Handle};
use super::listener_connection::{Arrival, ListenerConnection};
use super::shared::ZeroMqState;
use super::zmtp::Kind;
use wrapyfi_endpoint::{Context, Link, Listener, Receiver, Sample, TakeError, TopicSpec};

/// Receives one topic through the broker.
pub(super) struct ZeroMqListener {
    connection: Arc<ListenerConnection>,
    spec: TopicSpec,
    inbox: Receiver<Arrival>,
    io: Arc<Handle>,
}

impl ZeroMqListener {
    pub(super) fn open(shared: &ZeroMqState, spec: &TopicSpec, context: &Context) -> Self {
        let io = Arc::clone(&shared.io.handle);
        let (connection, inbox) = ListenerConnection::new(shared, spec, context);
        context.wake.attach(&connection);
        io.send(Command::Open(connection.id, Box::new(Arc::clone(&connection))));
        shared.ledger.enter(Kind::Xsub, &spec.topic, &context.counters);
        Self { connection, spec: spec.clone(), inbox, io }
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
        Link { peers: None, waiting_for: self.connection.link.waiting_for(), keeps_last: false }
    }
}

impl Drop for ZeroMqListener {
    fn drop(&mut self) {
        self.io.send(Command::Close(self.connection.id));
    }
}
