//! Settings of a session, the events that it yields, and the answers that it takes.
//!
//! ```text
//!   SessionOptions ─▶ Session ─▶ Event ─▶ Answer ─▶ Session        SessionError: why it ended
//! ```

use std::io;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;

use crate::port::counters::Counters;
use crate::port::open::Admission;
use crate::port::room::{Boundless, Rooms};
use crate::wire::http::HttpRequest;
use crate::wire::{Body, Command, Fault};
use crate::{Bottle, Dialect, Limits};

/// Settings that sessions have in common.
#[derive(Debug, Clone)]
pub struct SessionOptions {
    /// Encoding of bottles.
    pub dialect: Dialect,
    /// Limits of everything that the session reads.
    pub limits: Limits,
    /// Time until a header must be complete.
    pub handshake_timeout: Duration,
    /// Time until the next byte of a message that has begun.
    pub progress_timeout: Duration,
    /// Makes the room of a connection's begun messages.
    pub rooms: Rooms,
    /// Number told in the answer to a binary header: the port that listens. Peers ignore it.
    pub own_port: u16,
    /// Folder of the sockets of carrier `unix_stream`; `None` refuses the carrier.
    pub runtime_folder: Option<PathBuf>,
    /// Counters of the faults of peers.
    pub counters: Arc<Counters>,
    /// Programs that may connect; everybody where there is none.
    pub admission: Option<Admission>,
}

impl Default for SessionOptions {
    fn default() -> Self {
        Self {
            dialect: Dialect::default(),
            limits: Limits::default(),
            handshake_timeout: Duration::from_secs(5),
            progress_timeout: Duration::from_secs(30),
            rooms: || Box::new(Boundless),
            own_port: 0,
            runtime_folder: None,
            counters: Arc::default(),
            admission: None,
        }
    }
}

/// Reason why a session ended, other than by goodbye.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// The peer closed before it sent a whole header: somebody looked whether we live.
    #[error("the peer closed without a header")]
    Silent,
    /// The peer broke a rule; the connection cannot go on.
    #[error(transparent)]
    Fault(#[from] Fault),
    /// The socket failed.
    #[error("the connection failed: {0}")]
    Io(#[from] io::Error),
    /// A reply cannot be written in the dialect.
    #[error("the reply cannot be written: {0}")]
    Encode(#[from] crate::bottle::EncodeError),
}

/// Data that a peer sent.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Data {
    /// The payload.
    pub body: Body,
    /// The last envelope that came on this connection.
    pub envelope: Option<Bytes>,
    /// True when the peer waits for an answer.
    pub reply: bool,
}

/// Demand of a peer.
#[derive(Debug, Clone, PartialEq)]
pub enum Event {
    /// Data for the port's owner.
    Data(Data),
    /// An administrative request; answer with a bottle.
    Admin(Bottle),
    /// [`Command::Connect`], [`Command::RemoveOutput`], [`Command::RemoveInput`],
    /// [`Command::Describe`] or [`Command::Reverse`]. Answers are lines, seen on text carriers only.
    Command(Command),
    /// A request to a name server, without `NAME_SERVER`; answer with lines.
    Line(Bytes),
    /// A request over HTTP; answer with the raw bytes, then the connection closes.
    Http(HttpRequest),
}

/// Answer to an [`Event`].
#[derive(Debug, Clone, PartialEq)]
pub enum Answer {
    /// The acknowledgement alone.
    Nothing,
    /// A bottle: bare bytes on binary carriers, a line on text ones.
    Bottle(Bottle),
    /// A serialised object on binary carriers; on text ones the bottle that it reads as.
    Object(Bytes),
    /// Text as it is, with its own line ends, on every carrier: how a name server answers requests
    /// in its old style, even over tcp.
    Lines(String),
    /// Bytes as they are.
    Raw(Bytes),
}
