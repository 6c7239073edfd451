//! Errors of decoding and encoding, shared by every codec.

use crate::endpoint::DropReason;

/// Why received bytes are no message.
///
/// `path` is where inside the object the fault lies, for instance `$.frames[3]`; `$` is the whole.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DecodeError {
    /// The bytes do not follow the format.
    #[error("malformed {format} at {path}: {reason}")]
    Malformed {
        /// Format being read: `JSON`, `npy`, `JPEG`, `CDR`, …
        format: &'static str,
        /// Where.
        path: String,
        /// What is wrong, with the numbers.
        reason: String,
    },
    /// A size exceeds its limit; nothing was allocated for it.
    #[error("{what} at {path} is {actual}, the limit is {limit}{}", remedy(.what))]
    TooLarge {
        /// What is too large: `message`, `nesting`, …
        what: &'static str,
        /// Where.
        path: String,
        /// Size found.
        actual: u64,
        /// Largest allowed.
        limit: u64,
    },
    /// A valid message, but not of the kind this endpoint carries.
    #[error("expected {expected}, received {actual}")]
    Mismatch {
        /// What the endpoint carries.
        expected: String,
        /// What arrived.
        actual: String,
    },
}

fn remedy(what: &str) -> &'static str {
    if matches!(what, "message" | "memory of the values") { " (raise max_message_mib)" } else { "" }
}

impl DecodeError {
    /// The counter it belongs to.
    #[must_use]
    pub fn drop_reason(&self) -> DropReason {
        match self {
            Self::Malformed { .. } => DropReason::Malformed,
            Self::TooLarge { what: "nesting", .. } => DropReason::Nesting,
            Self::TooLarge { .. } => DropReason::Oversize,
            Self::Mismatch { .. } => DropReason::Mismatch,
        }
    }
}

/// Why a payload has no form on a wire.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum EncodeError {
    /// The format has no way to write this.
    #[error("{format} cannot hold {what} at {path}; {remedy}")]
    Unrepresentable {
        /// Format being written.
        format: &'static str,
        /// What cannot be written.
        what: String,
        /// Where in the value.
        path: String,
        /// What to do instead.
        remedy: String,
    },
    /// The payload is not of the kind this endpoint carries.
    #[error("expected {expected}, was given {actual}")]
    Mismatch {
        /// What the endpoint carries.
        expected: String,
        /// What was given.
        actual: String,
    },
    /// The encoded message would exceed its limit.
    #[error("message would be {actual} bytes, the limit is {limit} (raise max_message_mib)")]
    TooLarge {
        /// Encoded size in bytes.
        actual: u64,
        /// Largest allowed.
        limit: u64,
    },
}
