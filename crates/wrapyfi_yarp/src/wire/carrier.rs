//! The kinds of connections, by name.

use std::str::FromStr;

use super::{Sender, bare, number};

/// Carrier of a connection's messages (protocol section 2).
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, strum::Display, strum::IntoStaticStr,
)]
#[strum(serialize_all = "snake_case")]
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
    /// A unix socket between two ports of one host, nothing acknowledged.
    UnixStream,
    /// The same with the qualifier `ack`: every message acknowledged.
    #[strum(serialize = "unix_stream")]
    UnixStreamAck,
}

impl Carrier {
    /// All that have a name of their own.
    pub const ALL: [Self; 8] = [
        Self::Tcp,
        Self::FastTcp,
        Self::Text,
        Self::TextAck,
        Self::Udp,
        Self::Mcast,
        Self::Mjpeg,
        Self::UnixStream,
    ];

    /// YARP's name of it.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// Carrier that the qualifiers of `sender` turn this one into.
    #[must_use]
    pub fn qualified(self, sender: &Sender) -> Self {
        let acknowledged = sender.qualifiers.iter().any(|qualifier| qualifier.key == "ack");
        if self == Self::UnixStream && acknowledged { Self::UnixStreamAck } else { self }
    }

    /// True when messages go over a unix socket, after a TCP connection that only says who meets
    /// there.
    pub const fn is_unix(self) -> bool {
        matches!(self, Self::UnixStream | Self::UnixStreamAck)
    }

    /// True when commands and payloads are lines of text.
    pub const fn is_text(self) -> bool {
        matches!(self, Self::Text | Self::TextAck)
    }

    /// The acknowledgement of a message; empty where there is none.
    pub const fn ack(self) -> &'static [u8] {
        match self {
            Self::Tcp => &number::ACK,
            Self::TextAck => b"<ACK>\r\n",
            Self::UnixStreamAck => &bare::ACK,
            _ => &[],
        }
    }

    /// True when messages go in datagrams, after a TCP connection that only set this up.
    pub const fn is_connectionless(self) -> bool {
        matches!(self, Self::Udp | Self::Mcast)
    }

    /// True when the sender of data opens the connection.
    pub const fn is_push(self) -> bool {
        !matches!(self, Self::Mjpeg)
    }
}

/// A carrier that is not one of [`Carrier::ALL`].
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "carrier {0:?} is unknown: use tcp, fast_tcp, text, text_ack, udp, mcast, mjpeg or unix_stream \
     (shmem and local need YARP's own process at both ends)"
)]
pub struct UnknownCarrier(pub String);

impl FromStr for Carrier {
    type Err = UnknownCarrier;

    fn from_str(name: &str) -> Result<Self, UnknownCarrier> {
        let found = Self::ALL.into_iter().find(|carrier| carrier.name() == name);
        found.ok_or_else(|| UnknownCarrier(name.to_owned()))
    }
}
