//! Why a topic cannot be opened, and why a message was not taken or sent.

use super::DropReason;
use crate::EncodeError;
use crate::codec::DecodeError;
use crate::network::ReachedByOthers;
use crate::types::MessageType;

/// Why an endpoint could not be opened.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum OpenError {
    /// The name breaks the middleware's rules for names.
    #[error("{middleware} topic name {topic:?} is not valid: {reason}")]
    InvalidName {
        /// Middleware asked.
        middleware: &'static str,
        /// Name as given.
        topic: String,
        /// The rule it breaks.
        reason: String,
    },
    /// The middleware does not carry this type.
    #[error("{middleware} does not carry {}; {remedy}", message_type.ros_type())]
    UnsupportedType {
        /// Middleware asked.
        middleware: &'static str,
        /// Type asked for.
        message_type: MessageType,
        /// What can be asked for instead.
        remedy: String,
    },
    /// A setting of the endpoint has no meaning there.
    #[error("{middleware}: option {option} of {topic:?} is {found}, it must be {wanted}")]
    InvalidOption {
        /// Middleware asked.
        middleware: &'static str,
        /// Name of the topic or service.
        topic: String,
        /// The option.
        option: String,
        /// Its value.
        found: String,
        /// What may be written.
        wanted: String,
    },
    /// The middleware has topics only.
    #[error(
        "{middleware} has no services, so {service:?} cannot be called or offered there: use \
         zeromq, yarp, ros or ros2"
    )]
    NoServices {
        /// Middleware asked.
        middleware: String,
        /// Service as given.
        service: String,
    },
    /// The middleware has not started; it is tried again.
    #[error("{middleware} to start: {reason}")]
    NotStarted {
        /// Middleware asked.
        middleware: &'static str,
        /// Why the last try failed.
        reason: String,
    },
    /// The middleware can never start with its settings.
    #[error("{middleware} does not start: {reason}")]
    Refused {
        /// Middleware asked.
        middleware: &'static str,
        /// What is wrong with them.
        reason: String,
    },
    /// Other machines would reach it, and nobody said that they may.
    #[error(transparent)]
    NotLoopback(#[from] ReachedByOthers),
    /// The transport refused; opening again later may succeed.
    #[error("{middleware} could not open {topic:?}: {reason}")]
    Transport {
        /// Middleware asked.
        middleware: &'static str,
        /// Name as given.
        topic: String,
        /// What the transport said.
        reason: String,
    },
}

impl OpenError {
    /// True when trying again later can help.
    #[must_use]
    pub fn is_transient(&self) -> bool {
        matches!(self, Self::Transport { .. } | Self::NotStarted { .. })
    }
}

/// Why the next message of a listener could not be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TakeError {
    /// Its bytes are no message of the listener's type.
    #[error(transparent)]
    Decode(#[from] DecodeError),
}

impl TakeError {
    /// The counter it belongs to.
    #[must_use]
    pub fn drop_reason(&self) -> DropReason {
        match self {
            Self::Decode(error) => error.drop_reason(),
        }
    }
}

/// Why a message was not sent.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PublishError {
    /// The payload has no form on this wire.
    #[error(transparent)]
    Encode(#[from] EncodeError),
    /// Nobody listens, and the transport keeps nothing for later: the message was not sent.
    #[error("nobody listens to {topic:?}")]
    NoConsumer {
        /// Topic published to.
        topic: String,
    },
    /// The transport's send queue is full.
    #[error(
        "send queue of {topic:?} is full ({depth} messages): the consumer is slower than the source"
    )]
    QueueFull {
        /// Topic published to.
        topic: String,
        /// Messages the queue holds.
        depth: usize,
    },
    /// Who was to take the message did not accept all that it says.
    #[error("{reason}")]
    Refused {
        /// Name published to.
        topic: String,
        /// What was refused, by whom and why.
        reason: String,
    },
    /// The transport failed.
    #[error("could not send to {topic:?}: {reason}")]
    Transport {
        /// Topic published to.
        topic: String,
        /// What the transport said.
        reason: String,
    },
}

impl PublishError {
    /// The counter it belongs to.
    #[must_use]
    pub fn drop_reason(&self) -> DropReason {
        match self {
            Self::Encode(_) => DropReason::Unencodable,
            Self::NoConsumer { .. } => DropReason::NoConsumer,
            Self::QueueFull { .. } => DropReason::SendQueueFull,
            Self::Refused { .. } => DropReason::Refused,
            Self::Transport { .. } => DropReason::SendFailed,
        }
    }
}
