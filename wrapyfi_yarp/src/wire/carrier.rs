//! The kinds of connections, by name.

use std::fmt;
use std::str::FromStr;

/// How a connection carries messages (protocol section 2).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Carrier {
    /// Binary, every message acknowledged: the default of YARP.
    Tcp,
    /// Binary, nothing acknowledged.
    FastTcp,
    /// Text lines.
    Text,
    /// Text lines, every message acknowledged.
    TextAck,
    /// Datagrams to one receiver.
    Udp,
    /// Datagrams to a multicast group.
    Mcast,
    /// JPEG files over HTTP, which the receiver asks for.
    Mjpeg,
}

impl Carrier {
    /// All of them.
    pub const ALL: [Self; 7] =
        [Self::Tcp, Self::FastTcp, Self::Text, Self::TextAck, Self::Udp, Self::Mcast, Self::Mjpeg];

    /// YARP's name of it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Tcp => "tcp",
            Self::FastTcp => "fast_tcp",
            Self::Text => "text",
            Self::TextAck => "text_ack",
            Self::Udp => "udp",
            Self::Mcast => "mcast",
            Self::Mjpeg => "mjpeg",
        }
    }

    /// Whether commands and payloads are lines of text.
    #[must_use]
    pub const fn is_text(self) -> bool {
        matches!(self, Self::Text | Self::TextAck)
    }

    /// Whether each message is answered by an acknowledgement.
    #[must_use]
    pub const fn acknowledges(self) -> bool {
        matches!(self, Self::Tcp | Self::TextAck)
    }

    /// Whether messages go in datagrams, after a TCP connection that only set this up.
    #[must_use]
    pub const fn is_connectionless(self) -> bool {
        matches!(self, Self::Udp | Self::Mcast)
    }

    /// Whether the sender of data opens the connection.
    #[must_use]
    pub const fn is_push(self) -> bool {
        !matches!(self, Self::Mjpeg)
    }
}

impl fmt::Display for Carrier {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A carrier that is not one of [`Carrier::ALL`].
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "carrier {0:?} is unknown: use tcp, fast_tcp, text, text_ack, udp, mcast or mjpeg (shmem, local \
     and unix_stream need YARP's own process at the other end)"
)]
pub struct UnknownCarrier(
    /// The name that was given.
    pub String,
);

impl FromStr for Carrier {
    type Err = UnknownCarrier;

    fn from_str(name: &str) -> Result<Self, UnknownCarrier> {
        let found = Self::ALL.into_iter().find(|carrier| carrier.name() == name);
        found.ok_or_else(|| UnknownCarrier(name.to_owned()))
    }
}
