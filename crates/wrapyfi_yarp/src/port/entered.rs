//! An input on its port's list, and what it hands to the port's owner.

use std::sync::Arc;

use tokio::sync::Notify;

use super::core::{Core, Input};
use super::message::{PortPayload, Received};
use super::output::ConnectionStatus;
use super::session::{Answer, Data, Session};
use crate::wire::{Body, Carrier};

/// An entry in the list of inputs, while this lives.
pub(super) struct Entered {
    core: Arc<Core>,
    id: u64,
    pub(super) name: Arc<str>,
    pub(super) stop: Arc<Notify>,
}

impl Entered {
    /// Enters an input. A rooted name drives out the older connection of that name.
    pub(super) fn new(core: &Arc<Core>, session: &Session) -> Self {
        let stop = Arc::new(Notify::new());
        let name = &session.name;
        let mut connections = core.connections.lock();
        if name.starts_with('/') {
            for older in connections.inputs.iter().filter(|input| input.status.name == *name) {
                older.stop.notify_one();
                core.fault_counts.add("replaced");
            }
            connections.inputs.retain(|input| input.status.name != *name);
        }
        let id = Core::new_id(&mut connections);
        let status = ConnectionStatus {
            name: name.clone(),
            carrier: session.carrier_text.clone(),
            incoming: true,
            connectionless: session.carrier.is_some_and(Carrier::is_connectionless),
            push: session.carrier.is_none_or(Carrier::is_push),
        };
        connections.inputs.push(Input { id, status, stop: Arc::clone(&stop) });
        core.ring(&connections);
        drop(connections);
        Self { core: Arc::clone(core), id, name: name.as_str().into(), stop }
    }

    /// Hands data to the owner of the port; the answer for the sender.
    pub(super) async fn deliver(&self, Data { body, envelope, reply }: Data) -> Answer {
        let core = &self.core;
        let is_text = matches!(body, Body::Text(_));
        let (dialect, limits) = (core.network.dialect(), Arc::clone(&core.limits));
        let payload = match PortPayload::received(body, dialect, &limits) {
            Ok(payload) => payload,
            Err(fault) => {
                core.fault_counts.count(&fault);
                return Answer::Nothing;
            }
        };
        let Some(handler) = &core.handler else { return Answer::Nothing };
        let (from, connection) = (Arc::clone(&self.name), self.id);
        let received = Received { payload, envelope, from, connection, is_text, dialect, limits };
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
