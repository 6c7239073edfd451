//! An input on its port's list, and what it hands to the port's owner.

use std::sync::Arc;

use tokio::sync::Notify;

use super::core::{Core, Input};
use super::message::{PortPayload, Received};
use super::output::ConnectionStatus;
use super::session::{Answer, Data};
use crate::wire::Body;

/// An entry in the list of inputs, while this lives.
pub(super) struct Entered {
    core: Arc<Core>,
    id: u64,
    pub(super) name: Arc<str>,
    pub(super) stop: Arc<Notify>,
}

impl Entered {
    /// Enters an input. A rooted name drives out the older connection of that name.
    pub(super) fn new(
        core: &Arc<Core>,
        name: String,
        carrier: String,
        connectionless: bool,
        push: bool,
    ) -> Self {
        let stop = Arc::new(Notify::new());
        let shared: Arc<str> = name.as_str().into();
        let mut connections = core.connections.lock();
        if name.starts_with('/') {
            for older in connections.inputs.iter().filter(|input| input.status.name == name) {
                older.stop.notify_one();
                core.counters.add("replaced");
            }
            connections.inputs.retain(|input| input.status.name != name);
        }
        let id = Core::new_id(&mut connections);
        let status = ConnectionStatus { name, carrier, incoming: true, connectionless, push };
        connections.inputs.push(Input { id, status, stop: Arc::clone(&stop) });
        core.ring(&connections);
        drop(connections);
        Self { core: Arc::clone(core), id, name: shared, stop }
    }

    /// Hands data to whoever reads them; the answer for the sender.
    pub(super) async fn deliver(&self, data: Data) -> Answer {
        let core = &self.core;
        let Data { body, envelope, reply } = data;
        let is_text = matches!(body, Body::Text(_));
        let payload =
            match PortPayload::received(body, core.network.dialect(), core.network.limits()) {
                Ok(payload) => payload,
                Err(fault) => {
                    core.counters.count(&fault);
                    return Answer::Nothing;
                }
            };
        self.hand(payload, envelope, is_text, reply).await
    }

    /// Hands over what came without a session.
    pub(super) async fn put(&self, payload: PortPayload, envelope: Option<bytes::Bytes>) {
        self.hand(payload, envelope, false, false).await;
    }

    async fn hand(
        &self,
        payload: PortPayload,
        envelope: Option<bytes::Bytes>,
        is_text: bool,
        reply: bool,
    ) -> Answer {
        let Some(handler) = &self.core.handler else { return Answer::Nothing };
        let received = Received {
            payload,
            envelope,
            from: Arc::clone(&self.name),
            connection: self.id,
            is_text,
            dialect: self.core.network.dialect(),
            limits: Arc::clone(&self.core.limits),
        };
        handler(received, reply).await
    }
}

impl Drop for Entered {
    fn drop(&mut self) {
        let mut connections = self.core.connections.lock();
        connections.inputs.retain(|input| input.id != self.id);
        self.core.ring(&connections);
    }
}
