//! An output of a port, and where its messages go.

use std::net::{Ipv4Addr, SocketAddrV4};
use std::os::fd::OwnedFd;
use std::sync::Arc;

use super::outbox::Outbox;
use super::rpc_link::RpcLink;
use crate::wire::Carrier;

/// Destination of an output.
#[derive(Debug, Clone)]
pub(super) enum Kind {
    /// A queue and a task.
    Queue(Arc<Outbox>),
    /// A multicast group: shared by all outputs to it.
    Group(Arc<Group>),
    /// The server of a client of requests.
    Rpc(Arc<RpcLink>),
}

/// The receiver of an output.
#[derive(Debug)]
pub(super) struct Peer {
    pub(super) name: String,
    pub(super) carrier: Carrier,
    /// The carrier with its qualifiers.
    pub(super) carrier_text: String,
    /// Address that the receiver listens on.
    pub(super) contact: String,
}

/// An output, as the port knows it.
#[derive(Debug)]
pub(super) struct Output {
    pub(super) id: u64,
    pub(super) peer: Peer,
    pub(super) kind: Kind,
    /// Socket of the connection, on which the type of service is set.
    pub(super) socket: Option<Arc<OwnedFd>>,
}

/// A multicast group that this port sends to, on one interface.
#[derive(Debug)]
pub(super) struct Group {
    pub(super) interface: Ipv4Addr,
    pub(super) address: SocketAddrV4,
    /// The name under which the group is registered.
    pub(super) name: Option<String>,
    pub(super) outbox: Arc<Outbox>,
}

/// State of one connection.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ConnectionStatus {
    /// The other port.
    pub name: String,
    /// Carrier with qualifiers.
    pub carrier: String,
    /// True when the connection brings data.
    pub incoming: bool,
    /// True when the messages come as datagrams.
    pub connectionless: bool,
    /// False when it is the receiver that asked for the connection.
    pub push: bool,
}
