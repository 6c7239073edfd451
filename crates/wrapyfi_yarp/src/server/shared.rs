//! State that all connections of a name server share.

use std::collections::BTreeMap;
use std::net::{IpAddr, Ipv4Addr, SocketAddrV4};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::Instant;

use tokio::sync::Notify;

use wrapyfi_retry::Mutex;

use super::commands::{Asker, NameState, Outcome};
use super::events::Readers;
use super::links::Links;
use super::options::NameServerOptions;
use super::registry::Refusal;
use crate::Bottle;
use crate::port::names::Registration;
use crate::port::{Counters, Network};
use crate::wire::Body;

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

/// A connection as descriptions name it.
#[derive(Debug, Clone)]
pub(super) struct SessionEntry {
    /// The sender; without a slash for those that are no ports.
    pub(super) sender: String,
    /// Carrier with qualifiers.
    pub(super) carrier: String,
    /// Ends it.
    pub(super) end: Arc<Notify>,
}

/// Everything but the sockets.
#[derive(Debug)]
pub(super) struct Shared {
    pub(super) own: Registration,
    pub(super) options: NameServerOptions,
    /// Way to the ports that are connected, and told of changes.
    pub(super) network: Network,
    pub(super) state: Mutex<NameState>,
    pub(super) started: Instant,
    pub(super) counters: Arc<Counters>,
    pub(super) commands: AtomicU64,
    pub(super) sessions: Mutex<BTreeMap<u64, SessionEntry>>,
    pub(super) next_session: AtomicU64,
    pub(super) readers: Readers,
    pub(super) links: Links,
}

impl Shared {
    /// Does a command, and sees to what follows from it.
    pub(super) fn apply(self: &Arc<Self>, command: &Bottle, address: Option<IpAddr>) -> Outcome {
        self.perform(|state, asker| state.apply(command, asker), address)
    }

    /// [`Self::apply`] for a command as it came.
    pub(super) fn apply_body(self: &Arc<Self>, body: &Body, address: Option<IpAddr>) -> Outcome {
        let limit = self.options.limits.max_command_bytes;
        if body.len() > limit {
            return self.refused(Refusal::LongCommand { length: body.len(), limit });
        }
        match body.bottle(self.options.dialect, &self.options.wire) {
            Ok(command) => self.apply(&command, address),
            Err(error) => self.refused(Refusal::Unreadable { reason: error.to_string() }),
        }
    }

    fn refused(self: &Arc<Self>, refusal: Refusal) -> Outcome {
        self.perform(|_, _| NameState::refuse(refusal, false), None)
    }

    fn perform(
        self: &Arc<Self>,
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
        for event in &outcome.events {
            self.readers.tell(event, &self.counters);
        }
        drop(state);
        for link in outcome.links.drain(..).filter(|_| self.options.make_connections) {
            self.links.submit(link, self);
        }
        if let Some(refusal) = &outcome.refused {
            self.counters.add("refused");
            tracing::info!(target: "wrapyfi_yarp::server", %refusal, "refused");
        }
        outcome
    }

    /// Notes that a port does not answer.
    pub(super) fn doubt(&self, name: &str) {
        self.state.lock().subscriptions.doubt(name, self.started.elapsed());
    }

    pub(super) fn status(&self) -> NameServerStatus {
        NameServerStatus {
            names: self.state.lock().registry.len(),
            connections: self.sessions.lock().len(),
            readers: self.readers.names().len(),
            commands: self.commands.load(Relaxed),
            counts: self.counters.all(),
        }
    }
}

/// True when something on this machine has the port number.
fn is_busy(port: u16) -> bool {
    use socket2::{Domain, Socket, Type};
    let address = SocketAddrV4::new(Ipv4Addr::UNSPECIFIED, port);
    let free = Socket::new(Domain::IPV4, Type::STREAM, None).and_then(|socket| {
        // As ports do, lest connections that are closing count. It never listens.
        socket.set_reuse_address(cfg!(unix))?;
        socket.bind(&address.into())
    });
    free.is_err_and(|error| error.kind() == std::io::ErrorKind::AddrInUse)
}
