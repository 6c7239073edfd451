//! Connections whose both ends are in this process, to a broker of its own.
//!
//! ```text
//!   socket ── End::of(its address, Side::Ours) ──▶ ENDS ◀── End::of(the same, Side::Broker) ── broker
//!                                  both are there: neither asks whether the other lives
//! ```
//!
//! The end of the process ends both, so that a question is of no use; a thousand routes at rest spent a third of their
//! processor time on such questions.

use std::collections::BTreeSet;
use std::net::SocketAddr;

use wrapyfi_endpoint::Mutex;

/// Open ends: the address of the socket that has connected, and the side.
static ENDS: Mutex<BTreeSet<(SocketAddr, Side)>> = Mutex::new(BTreeSet::new());

/// Side of a connection.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Side {
    /// A socket of ours that has connected.
    Ours,
    /// A broker of ours that has accepted.
    Broker,
}

/// One end of an open connection.
#[derive(Debug)]
pub(super) struct End {
    socket: SocketAddr,
    side: Side,
}

impl End {
    /// The end at `side` of the connection that `socket` has made.
    pub(super) fn of(mut socket: SocketAddr, side: Side) -> Self {
        // A broker that listens at all addresses sees one of IPv4 in the form of IPv6.
        socket.set_ip(socket.ip().to_canonical());
        ENDS.lock().insert((socket, side));
        Self { socket, side }
    }

    /// True while the other end is in this process too.
    pub(super) fn has_other(&self) -> bool {
        let other = match self.side {
            Side::Ours => Side::Broker,
            Side::Broker => Side::Ours,
        };
        ENDS.lock().contains(&(self.socket, other))
    }
}

impl Drop for End {
    fn drop(&mut self) {
        ENDS.lock().remove(&(self.socket, self.side));
    }
}
