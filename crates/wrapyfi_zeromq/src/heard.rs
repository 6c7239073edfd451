//! Events of a connection: words of the peer, and its end.

use bytes::Bytes;

use super::assembly::{NotTaken, TooLarge};
use super::curve;
use super::zmtp::{Breach, Kind};
use wrapyfi_endpoint::DropReason;

/// Cause of the end of a connection.
#[derive(Debug, thiserror::Error)]
pub(super) enum ConnectionEnd {
    #[error("it left")]
    Left,
    #[error(transparent)]
    Breach(#[from] Breach),
    #[error("it offers {theirs} where this side speaks {ours} (endpoints: zeromq: curve)")]
    Mechanism { theirs: String, ours: &'static str },
    #[error("it is a {theirs} socket at {}, and has to connect to {}", .ours.port(), .ours.other().port())]
    OtherPort { theirs: String, ours: Kind },
    #[error(transparent)]
    Curve(#[from] curve::Breach),
    #[error("it sends {0}")]
    TooLarge(#[from] TooLarge),
    #[error("too much waits in this process (limits: waiting_mib)")]
    OverBudget,
    #[error(transparent)]
    Io(#[from] std::io::Error),
}

impl ConnectionEnd {
    /// Reason under which it is counted; none for what happens to every connection.
    pub(super) fn reason(&self) -> Option<&'static str> {
        match self {
            Self::TooLarge(_) => Some(DropReason::Oversize.as_str()),
            Self::OverBudget => Some(DropReason::OverBudget.as_str()),
            Self::Mechanism { .. } => Some("mechanism"),
            Self::OtherPort { .. } => Some("other_port"),
            Self::Curve(breach) => Some(breach.reason()),
            Self::Left | Self::Breach(_) | Self::Io(_) => None,
        }
    }

    /// CURVE key of a peer that is refused; an empty one where it has none, or none that opens anything here. `None`
    /// where it is not its key that is refused.
    pub(super) fn refused_key(&self) -> Option<&str> {
        match self {
            Self::Mechanism { .. } => Some(""),
            Self::Curve(breach) => Some(breach.key().unwrap_or_default()),
            _ => None,
        }
    }

    /// Command that tells the peer, where it is told.
    pub(super) fn farewell(&self) -> Option<&'static [u8]> {
        if let Self::Curve(breach) = self { breach.farewell() } else { None }
    }
}

/// Something that a peer said.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Heard {
    Subscribed(Bytes),
    Unsubscribed(Bytes),
    /// Something that is no subscription.
    Ignored,
    /// Subscription for which there is no room.
    NoRoom(Bytes),
    /// Subscription or message of a topic that the peer's key may not have.
    Denied(Vec<u8>),
    /// Frames of a message.
    Message(Vec<Bytes>),
    /// Message that is passed over.
    NotTaken(NotTaken),
}
