//! State that all connections of a name server share.

use std::collections::BTreeMap;
use std::net::{IpAddr, Ipv4Addr, SocketAddrV4};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Weak};
use std::time::Instant;

use bytes::Bytes;
use wrapyfi_retry::Mutex;

use super::commands::{Asker, NameState, Outcome};
use super::http;
use super::links::Links;
use super::options::NameServerOptions;
use super::registry::Refusal;
use super::reply::Reply;
use crate::Bottle;
use crate::name::{NameEvent, Target};
use crate::port::core::{Core, NameRequests};
use crate::port::names::Registration;
use crate::port::{Answer, Message, PortPayload};
use crate::wire::Body;
use crate::wire::http::HttpRequest;

/// A name server at one moment.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct NameServerStatus {
    /// Names there are, its own and the discovery group's among them.
    pub names: usize,
    /// Connections open now.
    pub connections: usize,
    /// Readers of changes connected now.
    pub readers: usize,
    /// Commands done and refused, since it started.
    pub commands: u64,
    /// Counts of everything that was refused, lost or dropped, by reason: `refused`,
    /// `too_many_connections`, `event_dropped`, `link_failed`, `idle`, and those of
    /// [`crate::wire::Fault::name`]. Counts of successes: `link_made`, `link_ended`.
    pub counts: BTreeMap<&'static str, u64>,
}

/// Everything but the sockets.
#[derive(Debug)]
pub(super) struct ServerState {
    pub(super) this: Weak<Self>,
    pub(super) own: Registration,
    pub(super) options: NameServerOptions,
    /// The port of the name server, whose outputs are readers of changes.
    pub(super) core: Arc<Core>,
    pub(super) state: Mutex<NameState>,
    pub(super) started: Instant,
    pub(super) commands: AtomicU64,
    pub(super) links: Links,
}

impl ServerState {
    /// Does a command, and sees to what follows from it.
    pub(super) fn apply(&self, command: &Bottle, address: Option<IpAddr>) -> Outcome {
        self.perform(|state, asker| state.apply(command, asker), address)
    }

    /// [`Self::apply`] for a command as it came.
    fn apply_body(&self, body: &Body, address: IpAddr) -> Outcome {
        let limit = self.options.limits.max_command_bytes;
        if body.len() > limit {
            return self.refused(Refusal::LongCommand { length: body.len(), limit });
        }
        match body.bottle(self.options.dialect, &self.options.wire) {
            Ok(command) => self.apply(&command, Some(address)),
            Err(error) => self.refused(Refusal::Unreadable { reason: error.to_string() }),
        }
    }

    fn refused(&self, refusal: Refusal) -> Outcome {
        self.perform(|_, _| NameState::refuse(refusal, false), None)
    }

    fn perform(
        &self,
        what: impl FnOnce(&mut NameState, Asker) -> Outcome,
        address: Option<IpAddr>,
    ) -> Outcome {
        let here = address.is_some_and(|address| {
            address.to_canonical().is_loopback()
                || self.own.host == address.to_canonical().to_string()
        });
        let busy = if here && self.options.skip_busy_ports { is_busy } else { |_| false };
        let asker = Asker { address, now: self.started.elapsed(), busy };
        self.commands.fetch_add(1, Relaxed);
        let mut state = self.state.lock();
        let mut outcome = what(&mut state, asker);
        // Under the lock: everybody hears of changes in the order in which they happened.
        outcome.events.iter().for_each(|event| self.tell(event));
        drop(state);
        for link in outcome.links.drain(..).filter(|_| self.options.make_connections) {
            self.links.submit(link, &self.this);
        }
        if let Some(refusal) = &outcome.refused {
            self.core.fault_counts.add("refused");
            tracing::info!(target: "wrapyfi_yarp::server", %refusal, "refused");
        }
        outcome
    }

    /// Tells a change to all readers, now or never.
    fn tell(&self, event: &NameEvent) {
        // Words and strings have a form in every dialect.
        let payload = PortPayload::bottle(&event.to_bottle(), self.options.dialect);
        let written = self.core.write(Message::new(payload.unwrap_or_default()), |_any| true);
        (0..written.dropped).for_each(|_| self.core.fault_counts.add("event_dropped"));
    }

    /// Notes that a port does not answer.
    pub(super) fn verify(&self, name: &str) {
        self.state.lock().subscriptions.verify(name, self.started.elapsed());
    }

    pub(super) fn status(&self) -> NameServerStatus {
        let connected = *self.core.connected.borrow();
        NameServerStatus {
            names: self.state.lock().registry.len(),
            connections: connected.inputs,
            readers: connected.outputs,
            commands: self.commands.load(Relaxed),
            counts: self.core.fault_counts.all(),
        }
    }
}

impl NameRequests for ServerState {
    fn find(&self, name: &str) -> Option<Registration> {
        let Target { name, network, .. } = Target::parse(name);
        self.state.lock().registry.find(&name, &network)
    }

    fn answer(&self, command: &Body, asker: IpAddr) -> Answer {
        match self.apply_body(command, asker).reply {
            Reply::Bottle(bottle) => Answer::Bottle(bottle),
            lines @ Reply::Lines(_) => Answer::Raw(lines.to_text().into()),
        }
    }

    fn page(&self, request: &HttpRequest, asker: IpAddr) -> Bytes {
        http::answer(request, self, asker)
    }
}

/// True when something on this machine has the port number.
fn is_busy(port: u16) -> bool {
    use socket2::{Domain, Socket, Type};
    let address = SocketAddrV4::new(Ipv4Addr::UNSPECIFIED, port);
    let free = Socket::new(Domain::IPV4, Type::STREAM, None).and_then(|socket| {
        // As ports do, lest connections that are closing count. It never listens.
        socket.set_reuse_address(true)?;
        socket.bind(&address.into())
    });
    free.is_err_and(|error| error.kind() == std::io::ErrorKind::AddrInUse)
}
