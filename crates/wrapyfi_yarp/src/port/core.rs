//! State that every port has: its connections, its properties, what it is and where its data go.
//!
//! ```text
//!   listener ─ accept (owner.rs) ─▶ one task a connection (connection.rs) ──▶ handler
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
use super::output::{ConnectionStatus, Output};
use super::session::{Answer, SessionOptions};
use crate::wire::Carrier;
use crate::{Bottle, Limits};

/// A future that a handler of requests gives back.
pub(super) type Answering = Pin<Box<dyn Future<Output = Answer> + Send>>;

/// Function of a port's owner, called with what comes on the connection's own task.
pub(super) type Handler = Box<dyn Fn(Received, bool) -> Answering + Send + Sync>;

/// The function that an owner gave, as one of all types.
pub(super) fn handler<F, A>(handler: F) -> Handler
where
    F: Fn(Received, bool) -> A + Send + Sync + 'static,
    A: Future<Output = Answer> + Send + 'static,
{
    Box::new(move |request, reply| Box::pin(handler(request, reply)))
}

/// Abilities of a port.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Role {
    /// Nothing but inputs.
    Input,
    /// Outputs may be added.
    Output,
    /// There may be one output only, for requests.
    Client,
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
    /// Nobody takes the data where there is none: messages are acknowledged all the same.
    pub(super) handler: Option<Handler>,
    /// Room of each output's queue.
    pub(super) queue: usize,
    /// Message that gives way when the queue is full.
    pub(super) overflow: Overflow,
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
        Outbox::new(self.queue, self.overflow, (self.session.rooms)())
    }

    /// A connection whose peer reads from now on.
    pub(super) fn reversed(&self, stream: TcpStream) -> Link {
        Link::reversed(stream, Carrier::Text, self.network.link_options())
    }
}
