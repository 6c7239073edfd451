//! Events that a session yields, and the answers that it takes.

use bytes::Bytes;

use crate::Bottle;
use crate::wire::http::HttpRequest;
use crate::wire::{Body, Command};

/// Data that a peer sent.
#[derive(Debug)]
pub(in crate::port) struct Data {
    pub(in crate::port) body: Body,
    /// The last envelope that came on this connection.
    pub(in crate::port) envelope: Option<Bytes>,
    /// True when the peer waits for an answer.
    pub(in crate::port) reply: bool,
}

/// Demand of a peer.
#[derive(Debug)]
pub(in crate::port) enum Event {
    /// Data for the port's owner.
    Data(Data),
    /// An administrative request; answer with a bottle.
    Admin(Bottle),
    /// [`Command::Connect`], [`Command::RemoveOutput`], [`Command::RemoveInput`],
    /// [`Command::Describe`] or [`Command::Reverse`]. Answers are lines, seen on text carriers only.
    Command(Command),
    /// A request to a name server, without `NAME_SERVER`; answer with lines.
    Line(Body),
    /// A request over HTTP; answer with the raw bytes, then the connection closes.
    Http(HttpRequest),
}

/// Answer to a request.
#[derive(Debug, Clone, PartialEq)]
pub enum Answer {
    /// The acknowledgement alone.
    Nothing,
    /// A bottle: bare bytes on binary carriers, a line on text ones.
    Bottle(Bottle),
    /// A serialised object on binary carriers; on text ones the bottle that it reads as.
    Object(Bytes),
    /// Bytes as they are, with their own line ends where they are lines, on every carrier: how a name server answers
    /// requests in its old style, even over tcp.
    Raw(Bytes),
}
