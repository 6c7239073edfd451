//! Faults of peers, each with a name under which it is counted.

use std::net::IpAddr;
use std::time::Duration;

/// Fault for which a connection is closed, or a message not taken.
#[derive(Debug, Clone, PartialEq, Eq, strum::IntoStaticStr, thiserror::Error)]
#[strum(serialize_all = "snake_case")]
pub enum Fault {
    /// The first eight bytes, which are kept shortened as text, begin no known carrier.
    #[error(
        "the first bytes {0:?} begin no carrier of YARP: send `CONNECT name` for text, or connect \
         with tcp, fast_tcp, text_ack, udp or mcast"
    )]
    UnknownHeader(String),
    /// A carrier, by YARP's name, that only works between processes of YARP itself.
    #[error("carrier {0} is not supported: connect with tcp, fast_tcp, text_ack, udp or mcast")]
    UnsupportedCarrier(&'static str),
    /// The receiver should apply the modifier of this name, and has none.
    #[error("modifier recv.{0} is not available here: connect without it")]
    MissingModifier(String),
    /// Carrier mjpeg at the port of this name, whose messages are no pictures.
    #[error("port {0} has no pictures, which are all that carrier mjpeg brings: connect with tcp")]
    NoPictures(String),
    /// Carrier `unix_stream` between two hosts.
    #[error(
        "carrier unix_stream is for one host, and {other} is not on the one of {own}: connect with tcp"
    )]
    OtherHost {
        /// Our end.
        own: IpAddr,
        /// The other end.
        other: IpAddr,
    },
    /// The unix socket of a connection cannot be made or reached.
    #[error(
        "unix socket {path} {reason}: set YARP_RUNTIME_DIR to the same folder of your own for all \
         programs, or connect with tcp"
    )]
    UnixSocket {
        /// Path of the socket at which the ends meet.
        path: String,
        /// Reason why the ends do not meet there.
        reason: String,
    },
    /// The length of a sender's name is outside what YARP reads.
    #[error("a sender's name has {length} bytes, allowed are 1 to {limit} with its NUL")]
    NameLength {
        /// Length as sent.
        length: i64,
        /// Most bytes, the NUL among them.
        limit: usize,
    },
    /// The program at the other end is none of those that the port takes.
    #[error("{name:?} at {address} is not among those that may connect here")]
    NotAdmitted {
        /// Name as the program says it.
        name: String,
        /// Address of its connection.
        address: String,
    },
    /// A block of a message has a negative length, kept as it was sent.
    #[error("a message declares a block of {0} bytes")]
    NegativeLength(i32),
    /// A message is larger than allowed.
    #[error("a message declares {size} bytes, allowed are {limit}: raise max_message_bytes")]
    MessageTooLarge {
        /// Declared or received so far.
        size: usize,
        /// Limit.
        limit: usize,
    },
    /// A message of this declared size does not begin with a port command.
    #[error("a message of {0} bytes does not begin with a port command: it was left out")]
    BadCommand(usize),
    /// So many bytes stood where a message must begin, and were left out.
    #[error("{0} bytes stood where a message must begin, with no index in them")]
    NoIndex(usize),
    /// A line of text does not end within this limit.
    #[error("a line of text has more than {0} bytes: raise max_line_bytes")]
    LineTooLong(usize),
    /// The connection ended inside a message, of which at least so many bytes are missing.
    #[error("the connection ended inside a message, {0} bytes before its end or more")]
    Truncated(usize),
    /// Nothing that identifies a carrier came in the time allowed.
    #[error("no complete header within {0:?}")]
    HandshakeTimeout(Duration),
    /// A message has begun, and nothing more of it came in the time allowed.
    #[error("a message has begun, and nothing more of it came for {0:?}")]
    NoProgress(Duration),
    /// Too much waits in this process for a message, of which so many bytes have come, to grow.
    #[error("no room for a message of {0} bytes so far: too much waits in this process")]
    OverBudget(usize),
    /// A datagram of so many bytes whose checksum does not fit its content, or that is too short.
    #[error("a datagram of {0} bytes is damaged: its checksum does not fit")]
    BadDatagram(usize),
    /// A datagram of a message is missing.
    #[error("datagram {found} came where {expected} was due: its message is lost")]
    LostDatagram {
        /// Counter that was due.
        expected: i32,
        /// Counter that came.
        found: i32,
    },
    /// A payload is not what it must be, for a reason in words.
    #[error("a payload cannot be read: {0}")]
    BadPayload(String),
    /// An answer over HTTP, or its parts, are not those of a camera, for a reason in words.
    #[error("the answer is no MJPEG stream: {0}")]
    BadHttp(String),
}

impl Fault {
    /// True when the peer did nothing wrong, but asked for something that ports of ours lack.
    pub const fn is_refusal(&self) -> bool {
        matches!(
            self,
            Self::UnsupportedCarrier(_)
                | Self::MissingModifier(_)
                | Self::NoPictures(_)
                | Self::OtherHost { .. }
                | Self::UnixSocket { .. }
                | Self::NotAdmitted { .. }
        )
    }

    /// The name under which it is counted.
    pub fn name(&self) -> &'static str {
        self.into()
    }
}
