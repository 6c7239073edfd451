//! Faults of peers, each with a name under which it is counted.

use std::net::IpAddr;
use std::time::Duration;

/// Fault for which a connection is closed, or a message not taken.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Fault {
    /// The first eight bytes begin no known carrier.
    #[error(
        "the first bytes {0:?} begin no carrier of YARP: send `CONNECT name` for text, or connect \
         with tcp, fast_tcp, text_ack, udp or mcast"
    )]
    UnknownHeader(
        /// The bytes, shortened, as text.
        String,
    ),
    /// A carrier that only works between processes of YARP itself.
    #[error("carrier {0} is not supported: connect with tcp, fast_tcp, text_ack, udp or mcast")]
    UnsupportedCarrier(
        /// YARP's name of it.
        &'static str,
    ),
    /// The receiver should apply a modifier, and has none.
    #[error("modifier recv.{0} is not available here: connect without it")]
    MissingModifier(
        /// Name of the modifier.
        String,
    ),
    /// Carrier mjpeg at a port whose messages are no pictures.
    #[error("port {0} has no pictures, which are all that carrier mjpeg brings: connect with tcp")]
    NoPictures(
        /// The port.
        String,
    ),
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
    /// A block of a message has a negative length.
    #[error("a message declares a block of {0} bytes")]
    NegativeLength(
        /// Length as sent.
        i32,
    ),
    /// A message is larger than allowed.
    #[error("a message declares {size} bytes, allowed are {limit}: raise max_message_bytes")]
    MessageTooLarge {
        /// Declared or received so far.
        size: usize,
        /// Limit.
        limit: usize,
    },
    /// A message does not begin with a port command.
    #[error("a message of {0} bytes does not begin with a port command: it was left out")]
    BadCommand(
        /// Declared size of the message.
        usize,
    ),
    /// Bytes stood where a message must begin.
    #[error("{0} bytes stood where a message must begin, with no index in them")]
    NoIndex(
        /// Bytes that were left out.
        usize,
    ),
    /// A line of text does not end.
    #[error("a line of text has more than {0} bytes: raise max_line_bytes")]
    LineTooLong(
        /// Limit.
        usize,
    ),
    /// The connection ended inside a message.
    #[error("the connection ended inside a message, {0} bytes before its end or more")]
    Truncated(
        /// Bytes that are missing at least.
        usize,
    ),
    /// Nothing that identifies a carrier came in time.
    #[error("no complete header within {0:?}")]
    HandshakeTimeout(
        /// The time allowed.
        Duration,
    ),
    /// A message has begun, and nothing more of it comes.
    #[error("a message has begun, and nothing more of it came for {0:?}")]
    NoProgress(
        /// The time allowed.
        Duration,
    ),
    /// Too much waits in this process for a begun message to grow.
    #[error("no room for a message of {0} bytes so far: too much waits in this process")]
    OverBudget(
        /// Number of bytes that have come of the message.
        usize,
    ),
    /// A datagram whose checksum does not fit its content, or with too few bytes.
    #[error("a datagram of {0} bytes is damaged: its checksum does not fit")]
    BadDatagram(
        /// Size of the datagram in bytes.
        usize,
    ),
    /// A datagram of a message is missing.
    #[error("datagram {found} came where {expected} was due: its message is lost")]
    LostDatagram {
        /// Counter that was due.
        expected: i32,
        /// Counter that came.
        found: i32,
    },
    /// A payload is not what it must be.
    #[error("a payload cannot be read: {0}")]
    BadPayload(
        /// Reason in words.
        String,
    ),
    /// An answer over HTTP, or its parts, are not those of a camera.
    #[error("the answer is no MJPEG stream: {0}")]
    BadHttp(
        /// Reason in words.
        String,
    ),
}

impl Fault {
    /// True when the peer did nothing wrong, but asked for something that ports of ours lack.
    #[must_use]
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
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            Self::UnknownHeader(_) => "unknown_header",
            Self::UnsupportedCarrier(_) => "unsupported_carrier",
            Self::MissingModifier(_) => "missing_modifier",
            Self::NoPictures(_) => "no_pictures",
            Self::OtherHost { .. } => "other_host",
            Self::UnixSocket { .. } => "unix_socket",
            Self::NotAdmitted { .. } => "not_admitted",
            Self::NameLength { .. } => "name_length",
            Self::NegativeLength(_) => "negative_length",
            Self::MessageTooLarge { .. } => "message_too_large",
            Self::BadCommand(_) => "bad_command",
            Self::NoIndex(_) => "no_index",
            Self::LineTooLong(_) => "line_too_long",
            Self::Truncated(_) => "truncated",
            Self::HandshakeTimeout(_) => "handshake_timeout",
            Self::NoProgress(_) => "no_progress",
            Self::OverBudget(_) => "over_budget",
            Self::BadDatagram(_) => "bad_datagram",
            Self::LostDatagram { .. } => "lost_datagram",
            Self::BadPayload(_) => "bad_payload",
            Self::BadHttp(_) => "bad_http",
        }
    }
}
