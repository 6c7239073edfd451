//! Why a call has no reply, and why a request was not served.

use super::DropReason;
use crate::{DecodeError, EncodeError};

/// Why a call has no reply.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CallError {
    /// Nobody answered in time.
    #[error("{service:?} was not answered within {timeout_ms} ms: {why}")]
    TimedOut {
        /// Service.
        service: String,
        /// Time the call was given.
        timeout_ms: u64,
        /// How far it came, and what would help.
        why: String,
    },
    /// Too many calls wait for their replies.
    #[error("{limit} calls of {service:?} are under way, which is the limit: wait for one to end")]
    TooMany {
        /// Service.
        service: String,
        /// Most calls at once.
        limit: usize,
    },
    /// The arguments have no form on this wire.
    #[error("the request to {service:?} cannot be sent: {fault}")]
    Request {
        /// Service.
        service: String,
        /// What has no form, where, and what to do instead.
        fault: EncodeError,
    },
    /// What came back is no reply of this service.
    #[error("the reply of {service:?} cannot be used: {fault}")]
    Reply {
        /// Service.
        service: String,
        /// What is wrong, and where.
        fault: DecodeError,
    },
    /// The server says why it has no reply.
    #[error("{service:?} answered with an error: {reason}")]
    Refused {
        /// Service.
        service: String,
        /// The server's words.
        reason: String,
    },
    /// The transport failed.
    #[error("{service:?} could not be called: {reason}")]
    Transport {
        /// Service.
        service: String,
        /// What the transport said.
        reason: String,
    },
}

/// Why a request was not served, or an answer not sent.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ServeError {
    /// The request is none of this service: it never reaches the user.
    #[error("a request to {service:?} cannot be served: {fault}")]
    Request {
        /// Service.
        service: String,
        /// What is wrong, and where.
        fault: String,
        /// Under what it was counted.
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
        /// Most requests at once.
        limit: usize,
    },
    /// The answer has no form on this wire.
    #[error("the answer of {service:?} cannot be sent: {fault}")]
    Reply {
        /// Service.
        service: String,
        /// What has no form, where, and what to do instead.
        fault: EncodeError,
    },
    /// The request is not waiting: it was answered, or took too long.
    #[error("no such request to {service:?} waits: it was answered, or took over {timeout_ms} ms")]
    NotWaiting {
        /// Service.
        service: String,
        /// Time a request has.
        timeout_ms: u64,
    },
    /// The transport failed.
    #[error("{service:?} could not be served: {reason}")]
    Transport {
        /// Service.
        service: String,
        /// What the transport said.
        reason: String,
    },
}
