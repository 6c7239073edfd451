//! Why a call has no reply.

use wrapyfi_interfaces::dynamic::ValueError;

use crate::middleware::ros2::graph::GraphError;

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
    /// The request is none of this service.
    #[error("the request does not fit {service:?}: {fault}")]
    Request {
        /// Service.
        service: String,
        /// What is wrong, and where.
        fault: Box<ValueError>,
    },
    /// The reply is none of this service.
    #[error("the reply of {service:?} cannot be read: {fault}")]
    Reply {
        /// Service.
        service: String,
        /// What is wrong, and where.
        fault: String,
    },
    /// DDS refused.
    #[error(transparent)]
    Graph(#[from] GraphError),
}
