//! State that every port has: its connections, its properties, what it is and where its data go.
//!
//! ```text
//!   listener ─ accept (owner.rs) ─▶ one task a connection (connection.rs) ──▶ Sink: handler, nothing
//!                                       │ admin, commands (administration.rs)
//!                                       ▼
//!   write ─▶ outputs (outputs.rs): one Outbox and one task each (target.rs)
//! ```

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::Arc;

use tokio::net::TcpStream;
use tokio::sync::{Notify, watch};

use wrapyfi_retry::Mutex;

use super::counters::Counters;
use super::link::Link;
use super::message::Received;
use super::network::Network;
use super::open::Admission;
use super::outbox::{Outbox, Overflow};
use super::output::Output;
use super::session::{Answer, SessionOptions};
use crate::wire::Carrier;
use crate::{Bottle, Limits};

/// A future that a handler of requests gives back.
pub(super) type Answering = Pin<Box<dyn Future<Output = Answer> + Send>>;

/// Destination of the data of a port's inputs.
pub(super) enum Sink {
    /// Function, called on the connection's own task.
    Handler(Box<dyn Fn(Received, bool) -> Answering + Send + Sync>),
    /// No destination: messages are acknowledged all the same.
    Nobody,
}

impl Sink {
    /// Sink of a port whose owner gave a function.
    pub(super) fn handler<F, A>(handler: F) -> Self
    where
        F: Fn(Received, bool) -> A + Send + Sync + 'static,
        A: Future<Output = Answer> + Send + 'static,
    {
        Self::Handler(Box::new(move |request, reply| Box::pin(handler(request, reply))))
    }
}

/// Abilities of a port.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Role {
    /// True when outputs may be added.
    pub(super) outputs: bool,
    /// True when there may be one output only, for requests.
    pub(super) client: bool,
    /// Room of each output's queue.
    pub(super) queue: usize,
    /// Message that gives way when the queue is full.
    pub(super) overflow: Overflow,
}

impl Default for Role {
    fn default() -> Self {
        Self { outputs: false, client: false, queue: 1, overflow: Overflow::default() }
    }
}

/// An input, as the port knows it.
#[derive(Debug)]
pub(super) struct Input {
    pub(super) id: u64,
    pub(super) name: String,
    pub(super) carrier: String,
    pub(super) connectionless: bool,
    pub(super) push: bool,
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

pub(super) struct Core {
    pub(super) name: String,
    pub(super) network: Network,
    pub(super) address: SocketAddr,
    pub(super) contact: String,
    pub(super) registered: bool,
    /// True when the owner says that the port is for requests.
    pub(super) rpc: bool,
    /// True when carrier mjpeg is taken.
    pub(super) pictures: bool,
    /// Ports that messages may go to.
    pub(super) readers: Option<Admission>,
    pub(super) role: Role,
    pub(super) sink: Sink,
    pub(super) session: SessionOptions,
    pub(super) limits: Arc<Limits>,
    pub(super) counters: Arc<Counters>,
    pub(super) connections: Mutex<Connections>,
    pub(super) connected: watch::Sender<Connected>,
    /// One output is added at a time.
    pub(super) adding: tokio::sync::Mutex<()>,
    pub(super) closing: watch::Sender<bool>,
    pub(super) closed: watch::Sender<bool>,
}

impl Core {
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
        Outbox::new(self.role.queue, self.role.overflow, (self.session.rooms)())
    }

    /// A connection whose peer reads from now on.
    pub(super) fn reversed(&self, stream: TcpStream) -> Link {
        Link::reversed(stream, Carrier::Text, self.network.link_options())
    }
}
