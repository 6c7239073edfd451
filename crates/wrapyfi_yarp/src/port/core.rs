//! State that every port has: its connections, its properties, what it is and where its data go.
//!
//! ```text
//!   listener ─ accept (life.rs) ─▶ one task a connection (connection.rs) ──▶ handler
//!                                       │ admin, commands (administration.rs)
//!                                       ▼
//!   write ─▶ outputs (outputs.rs): one Outbox and one task each (target.rs)
//! ```

use std::collections::BTreeMap;
use std::fmt;
use std::net::{IpAddr, SocketAddr};
use std::pin::Pin;
use std::sync::{Arc, Weak};
use std::time::Duration;

use bytes::Bytes;
use tokio::sync::{Notify, watch};

use wrapyfi_retry::Mutex;

use super::fault_counts::FaultCounts;
use super::message::Received;
use super::names::Registration;
use super::network::Network;
use super::open::{Opened, PortOptions};
use super::outbox::Outbox;
use super::output::{ConnectionStatus, Output};
use super::session::Answer;
use crate::wire::Body;
use crate::wire::http::HttpRequest;
use crate::{Bottle, WireLimits};

/// A future that a handler of requests gives back.
pub(super) type Answering = Pin<Box<dyn Future<Output = Answer> + Send>>;

/// Function of a port's owner, called with what comes on the connection's own task.
pub(super) type Handler = Box<dyn Fn(Received, bool) -> Answering + Send + Sync>;

/// Abilities of a port.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Role {
    /// Nothing but inputs.
    Input,
    /// Outputs may be added.
    Output,
    /// There may be one output only, for requests.
    Client,
}

/// The name server whose own port a port is.
pub(crate) trait NameRequests: Send + Sync {
    /// Place of a port, which is named as in a request to connect to it.
    fn find(&self, name: &str) -> Option<Registration>;

    /// Does a command; its answer.
    fn answer(&self, command: &Body, asker: IpAddr) -> Answer;

    /// The whole answer to a browser.
    fn page(&self, request: &HttpRequest, asker: IpAddr) -> Bytes;
}

/// Part of a name server's port that other ports lack.
pub(crate) struct NameService {
    pub(crate) requests: Weak<dyn NameRequests>,
    /// Time after which a connection with one-line commands that says nothing is closed.
    pub(crate) idle_timeout: Duration,
    /// Most outputs: readers of changes.
    pub(crate) max_readers: usize,
}

/// An input, as the port knows it.
#[derive(Debug)]
pub(super) struct Input {
    pub(super) id: u64,
    pub(super) status: ConnectionStatus,
    pub(super) stop: Arc<Notify>,
}

#[derive(Default)]
pub(super) struct Connections {
    pub(super) inputs: Vec<Input>,
    pub(super) outputs: Vec<Output>,
    pub(super) properties: BTreeMap<String, Bottle>,
    next_id: u64,
}

/// Number of connections of a port.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Connected {
    /// Number of connections that bring data.
    pub inputs: usize,
    /// Number of connections that take data away.
    pub outputs: usize,
}

pub(crate) struct Core {
    pub(super) name: String,
    pub(crate) network: Network,
    pub(super) address: SocketAddr,
    pub(super) contact: String,
    /// Number told in the answer to a binary header. Peers ignore it.
    pub(super) number: u16,
    pub(super) options: PortOptions,
    pub(super) role: Role,
    /// No program takes the data where there is none: messages are acknowledged all the same.
    pub(super) handler: Option<Handler>,
    pub(super) name_service: Option<NameService>,
    pub(super) limits: Arc<WireLimits>,
    pub(crate) fault_counts: FaultCounts,
    pub(super) connections: Mutex<Connections>,
    pub(crate) connected: watch::Sender<Connected>,
    /// One output is added at a time.
    pub(super) adding: tokio::sync::Mutex<()>,
    pub(super) closing: watch::Sender<bool>,
    pub(super) closed: watch::Sender<bool>,
}

impl fmt::Debug for Core {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, address, .. } = self;
        f.debug_struct("Core").field("name", name).field("address", address).finish_non_exhaustive()
    }
}

impl Core {
    /// The state of a port that listens, and has no connections yet.
    pub(crate) fn new(
        network: &Network,
        opened: Opened,
        options: PortOptions,
        role: Role,
        handler: Option<Handler>,
        name_service: Option<NameService>,
    ) -> Self {
        let Opened { name, address, contact, number } = opened;
        Self {
            name,
            network: network.clone(),
            address,
            contact,
            number,
            options,
            role,
            handler,
            name_service,
            limits: Arc::new(network.limits().clone()),
            fault_counts: FaultCounts::default(),
            connections: Mutex::default(),
            connected: watch::Sender::new(Connected::default()),
            adding: tokio::sync::Mutex::new(()),
            closing: watch::Sender::new(false),
            closed: watch::Sender::new(false),
        }
    }

    /// A number that no other connection of this port has.
    pub(super) fn new_id(connections: &mut Connections) -> u64 {
        connections.next_id += 1;
        connections.next_id
    }

    /// Tells those who watch how many connections there are.
    pub(super) fn ring(&self, connections: &Connections) {
        let (inputs, outputs) = (connections.inputs.len(), connections.outputs.len());
        let now = Connected { inputs, outputs };
        self.connected.send_if_modified(|known| std::mem::replace(known, now) != now);
    }

    /// Makes the queue of another target.
    pub(super) fn new_outbox(&self) -> Outbox {
        Outbox::new(self.options.queue, self.options.overflow, (self.network.0.rooms)())
    }

    /// True where a name server has as many readers as it may have.
    pub(super) fn is_full(&self) -> bool {
        let most = self.name_service.as_ref().map_or(usize::MAX, |names| names.max_readers);
        let is_full = self.connections.lock().outputs.len() >= most;
        if is_full {
            self.fault_counts.add("too_many_readers");
        }
        is_full
    }
}
