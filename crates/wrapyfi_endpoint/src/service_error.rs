//! Errors of calls and of servers.

use super::{DropReason, GoalEvent};
use wrapyfi_data::{DecodeError, EncodeError};

impl CallError {
    /// Reason under which the error is counted.
    pub fn drop_reason(&self) -> DropReason {
        match self {
            Self::TimedOut { .. } => DropReason::Expired,
            Self::TooMany { .. } => DropReason::Overloaded,
            Self::NoRoom { .. } => DropReason::OverBudget,
            Self::Request { .. } => DropReason::Unencodable,
            Self::Reply { fault, .. } => fault.into(),
            Self::Refused { .. } | Self::NotReached { .. } => DropReason::Refused,
            Self::Transport { .. } => DropReason::SendFailed,
        }
    }
}

/// Error of a call that has no reply.
///
/// ```
/// # mod wrapyfi_core {
/// #     pub use {wrapyfi_endpoint as endpoint, wrapyfi_data::types};
/// #     pub mod middleware { pub use wrapyfi_endpoint::memory; }
/// # }
/// use std::time::Duration;
/// use wrapyfi_core::endpoint::{Context, Middleware, Request, ServiceSpec};
/// use wrapyfi_core::middleware::memory::Memory;
/// use wrapyfi_core::types::ServiceKind;
/// let spec = ServiceSpec::new("/plan", ServiceKind::NativeObject);
/// let mut client = Memory::new("memory").open_client(&spec, &Context::default())?;
/// let error = client.call(&Request::default(), Duration::from_millis(10)).unwrap_err();
/// assert!(error.to_string().starts_with("\"/plan\" was not answered within 10 ms: "), "{error}");
/// # Ok::<(), wrapyfi_endpoint::OpenError>(())
/// ```
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CallError {
    /// No server answered in time.
    #[error("{service:?} was not answered within {timeout_ms} ms: {why}")]
    TimedOut {
        /// Service.
        service: String,
        /// Time that the call had, in milliseconds.
        timeout_ms: u64,
        /// Stage that the call had reached, and the remedy.
        why: String,
    },
    /// Too many calls wait for their replies.
    #[error("{limit} calls of {service:?} are under way, which is the limit: wait for one to end")]
    TooMany {
        /// Service.
        service: String,
        /// Largest number of calls at once.
        limit: usize,
    },
    /// No room is left for the request in the budget of bytes that wait.
    #[error(
        "a request of {bytes} bytes to {service:?} finds no room: its calls under way hold their share of \
         `limits: {{ waiting_mib }}`; wait for one to end, or raise that"
    )]
    NoRoom {
        /// Service.
        service: String,
        /// Size of the request in bytes.
        bytes: usize,
    },
    /// The arguments have no form on this wire.
    #[error("the request to {service:?} cannot be sent: {fault}")]
    Request {
        /// Service.
        service: String,
        /// Value that cannot be encoded, its place, and the remedy.
        fault: EncodeError,
    },
    /// The answer that came is no reply of this service.
    #[error("the reply of {service:?} cannot be used: {fault}")]
    Reply {
        /// Service.
        service: String,
        /// Fault in the bytes, and its place.
        fault: DecodeError,
    },
    /// The server answered that it has no reply.
    #[error("{service:?} answered with an error: {reason}")]
    Refused {
        /// Service.
        service: String,
        /// Reason in the server's words.
        reason: String,
    },
    /// The server rejected the goal of an action, gave it up, or was asked to.
    #[error("the goal of {service:?} was {}{}{reason}", how.as_str(), if reason.is_empty() { "" } else { ": " })]
    NotReached {
        /// Action.
        service: String,
        /// End of the goal: rejected, aborted or canceled.
        how: GoalEvent,
        /// Reason in the server's words; empty where it gave none.
        reason: String,
    },
    /// The transport failed.
    #[error("{service:?} could not be called: {reason}")]
    Transport {
        /// Service.
        service: String,
        /// Error of the transport, in its words.
        reason: String,
    },
}

/// Error of a server: a request was not served, or an answer not sent.
///
/// ```
/// # mod wrapyfi_core {
/// #     pub use {wrapyfi_endpoint as endpoint, wrapyfi_data::types};
/// #     pub mod middleware { pub use wrapyfi_endpoint::memory; }
/// # }
/// use wrapyfi_core::endpoint::{Context, Middleware, RequestId, ServiceSpec};
/// use wrapyfi_core::middleware::memory::Memory;
/// use wrapyfi_core::types::{ServiceKind, Value};
/// let spec = ServiceSpec::new("/plan", ServiceKind::NativeObject);
/// let mut server = Memory::new("memory").open_server(&spec, &Context::default())?;
/// let error = server.reply(RequestId(7), Ok(Value::Null.into())).unwrap_err();
/// assert!(error.to_string().starts_with("no such request to \"/plan\" waits: "), "{error}");
/// # Ok::<(), wrapyfi_endpoint::OpenError>(())
/// ```
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ServeError {
    /// The bytes are no request of this service, and do not reach the user.
    #[error("a request to {service:?} cannot be served: {fault}")]
    Request {
        /// Service.
        service: String,
        /// Fault in the bytes, and its place.
        fault: String,
        /// Reason under which the request was counted as dropped.
        reason: DropReason,
    },
    /// Too many requests wait for their answers.
    #[error(
        "{limit} requests to {service:?} wait for their answers, which is the limit: answer them, \
         or raise `pending`"
    )]
    Overloaded {
        /// Service.
        service: String,
        /// Largest number of requests at once.
        limit: usize,
    },
    /// No room is left for the request or the reply in the budget of bytes that wait.
    #[error(
        "{bytes} bytes of a call of {service:?} find no room: those under way hold their share of \
         `limits: {{ waiting_mib }}`; answer them, or raise that"
    )]
    NoRoom {
        /// Service.
        service: String,
        /// Size of the request or the reply in bytes.
        bytes: usize,
    },
    /// The answer has no form on this wire.
    #[error("the answer of {service:?} cannot be sent: {fault}")]
    Reply {
        /// Service.
        service: String,
        /// Value that cannot be encoded, its place, and the remedy.
        fault: EncodeError,
    },
    /// The request is not waiting: it was answered, or took too long.
    #[error("no such request to {service:?} waits: it was answered, or took over {timeout_ms} ms")]
    NotWaiting {
        /// Service.
        service: String,
        /// Time that a request has, in milliseconds.
        timeout_ms: u64,
    },
    /// The server has ended.
    #[error("{0:?} has ended")]
    Ended(String),
    /// The transport failed.
    #[error("{service:?} could not be served: {reason}")]
    Transport {
        /// Service.
        service: String,
        /// Error of the transport, in its words.
        reason: String,
    },
}

impl ServeError {
    /// Reason under which the error is counted.
    pub fn drop_reason(&self) -> DropReason {
        match self {
            Self::Request { reason, .. } => *reason,
            Self::Overloaded { .. } => DropReason::Overloaded,
            Self::NoRoom { .. } => DropReason::OverBudget,
            Self::Reply { .. } => DropReason::Unencodable,
            Self::NotWaiting { .. } => DropReason::Expired,
            Self::Ended(_) | Self::Transport { .. } => DropReason::SendFailed,
        }
    }
}

/// Result of serving a request.
///
/// See [`Server`](crate::Server).
pub type ServeResult<T> = Result<T, ServeError>;
