//! Entries of one connection in `getBusInfo` and `getBusStats` of the slave API.

/// One connection of a topic.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct BusLink {
    /// Number of the connection in this node.
    pub(super) id: u64,
    /// The other end: a node's name, or the address of its XML-RPC server.
    pub(super) peer: String,
    /// The socket at the other end.
    pub(super) address: String,
    /// Messages flow.
    pub(super) connected: bool,
    /// Messages so far.
    pub(super) messages: u64,
    /// Bytes so far.
    pub(super) bytes: u64,
}
