//! Errors of opening topics, and of taking and sending messages.

use super::{DropReason, Interaction, StartError};
use crate::codec::DecodeError;
use crate::network::ReachedByOthers;
use wrapyfi_data::EncodeError;
use wrapyfi_data::types::MessageType;

/// Error of opening an endpoint.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_endpoint as endpoint; }
/// use wrapyfi_core::endpoint::OpenError;
/// let error = OpenError::transport("zeromq", "/camera", "no sockets are left".into());
/// assert_eq!(error.to_string(), "zeromq could not open \"/camera\": no sockets are left");
/// assert!(error.is_transient()); // a later try may succeed
/// ```
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum OpenError {
    /// The name breaks the middleware's rules for names.
    #[error("{middleware} topic name {topic:?} is not valid: {reason}")]
    InvalidName {
        /// Middleware asked.
        middleware: &'static str,
        /// Name of the topic as given.
        topic: String,
        /// Rule that the name breaks.
        reason: String,
    },
    /// The middleware does not carry this type.
    #[error("{middleware} does not carry {}; {remedy}", message_type.ros_type())]
    UnsupportedType {
        /// Middleware asked.
        middleware: &'static str,
        /// Type asked for.
        message_type: MessageType,
        /// Types that the middleware can carry instead.
        remedy: String,
    },
    /// A setting of the endpoint has a value that the middleware does not accept.
    #[error("{middleware}: option {option} of {topic:?} is {found}, it must be {wanted}")]
    InvalidOption {
        /// Middleware asked.
        middleware: &'static str,
        /// Name of the topic or service.
        topic: String,
        /// Name of the option.
        option: String,
        /// Value of the option.
        found: String,
        /// Values that the option may have.
        wanted: String,
    },
    /// The middleware does not have this interaction.
    #[error(
        "{middleware} has no {interaction}s, so {name:?} cannot be called or offered there: name another \
         middleware before it"
    )]
    NotCarried {
        /// Middleware asked.
        middleware: String,
        /// Interaction that it does not have.
        interaction: Interaction,
        /// Name as given.
        name: String,
    },
    /// The middleware has not started; it is tried again.
    #[error("{middleware} to start: {fault}")]
    NotStarted {
        /// Middleware asked.
        middleware: &'static str,
        /// Error of the last try.
        fault: StartError,
    },
    /// The middleware can never start with its settings.
    #[error("{middleware} does not start: {reason}")]
    Refused {
        /// Middleware asked.
        middleware: &'static str,
        /// Setting that is wrong, and the remedy.
        reason: String,
    },
    /// Other machines would reach the endpoint, and no setting permits it.
    #[error("{0}")]
    NotLoopback(String),
    /// The transport refused; opening again later may succeed.
    #[error("{middleware} could not open {topic:?}: {reason}")]
    Transport {
        /// Middleware asked.
        middleware: &'static str,
        /// Name as given.
        topic: String,
        /// Error of the transport, in its words.
        reason: String,
    },
}

/// Result of opening an endpoint.
///
/// See [`OpenError`].
pub type OpenResult<T> = Result<T, OpenError>;

/// Result of opening an endpoint whose type only its middleware knows.
///
/// See [`Middleware::open_listener`](crate::Middleware::open_listener).
pub type Opened<T> = OpenResult<Box<T>>;

impl From<ReachedByOthers> for OpenError {
    fn from(error: ReachedByOthers) -> Self {
        Self::NotLoopback(error.to_string())
    }
}

impl OpenError {
    /// Error of a name that breaks a rule for names.
    pub fn invalid_name(middleware: &'static str, topic: &str, reason: String) -> Self {
        Self::InvalidName { middleware, topic: topic.to_owned(), reason }
    }

    /// Error of a transport that refused.
    pub fn transport(middleware: &'static str, topic: &str, reason: String) -> Self {
        Self::Transport { middleware, topic: topic.to_owned(), reason }
    }

    pub(crate) fn not_carried(middleware: &str, interaction: Interaction, name: &str) -> Self {
        let (middleware, name) = (middleware.to_owned(), name.to_owned());
        Self::NotCarried { middleware, interaction, name }
    }

    /// True when trying again later can help.
    pub fn is_transient(&self) -> bool {
        matches!(self, Self::Transport { .. } | Self::NotStarted { .. })
    }
}

/// Error of a listener whose next message could not be used: the bytes are no message of its type.
///
/// See [`DecodeError`].
pub type TakeError = DecodeError;

/// Error of a message that was not sent.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_endpoint as endpoint; }
/// use wrapyfi_core::endpoint::{DropReason, PublishError};
/// let error = PublishError::NoConsumer("/camera".into());
/// assert_eq!(error.to_string(), "nobody listens to \"/camera\"");
/// assert_eq!(error.drop_reason(), DropReason::NoConsumer);
/// ```
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PublishError {
    /// The payload has no form on this wire.
    #[error(transparent)]
    Encode(#[from] EncodeError),
    /// No program listens, and the transport keeps nothing for later: the message was not sent.
    #[error("nobody listens to {0:?}")]
    NoConsumer(String),
    /// The transport's send queue is full.
    #[error(
        "send queue of {topic:?} is full ({depth} messages): the consumer is slower than the source"
    )]
    QueueFull {
        /// Topic published to.
        topic: String,
        /// Number of messages that the queue holds.
        depth: usize,
    },
    /// As much waits to be sent as may wait in this process.
    #[error(
        "{0:?} waits for a consumer that is slower than the source, and no more may wait in this process \
         (limits: waiting_mib)"
    )]
    OverBudget(String),
    /// The receiver did not accept all that the message asks of it.
    #[error("{reason}")]
    Refused {
        /// Name published to.
        topic: String,
        /// Part that was refused, the receiver that refused it, and the cause.
        reason: String,
    },
    /// The transport failed.
    #[error("could not send to {topic:?}: {reason}")]
    Transport {
        /// Topic published to.
        topic: String,
        /// Error of the transport, in its words.
        reason: String,
    },
}

/// Result of publishing: number of bytes that go on the wire.
///
/// See [`Publisher::publish`](crate::Publisher::publish).
pub type Published = Result<usize, PublishError>;

impl PublishError {
    /// Reason under which the error is counted.
    pub fn drop_reason(&self) -> DropReason {
        match self {
            Self::Encode(_) => DropReason::Unencodable,
            Self::NoConsumer(_) => DropReason::NoConsumer,
            Self::QueueFull { .. } => DropReason::SendQueueFull,
            Self::OverBudget(_) => DropReason::OverBudget,
            Self::Refused { .. } => DropReason::Refused,
            Self::Transport { .. } => DropReason::SendFailed,
        }
    }
}
