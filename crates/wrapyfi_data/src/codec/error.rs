//! Errors of decoding and encoding, shared by every codec.

/// Error of decoding received bytes.
///
/// `path` is the place of the fault inside the object, for instance `$.frames[3]`; `$` is the
/// whole.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DecodeError {
    /// The bytes do not follow the format.
    #[error("malformed {format} at {path}: {reason}")]
    Malformed {
        /// Format being read: `JSON`, `npy`, `JPEG`, `CDR`, …
        format: &'static str,
        /// Place in the message, from `$`.
        path: String,
        /// Fault, with its numbers.
        reason: String,
    },
    /// A size exceeds its limit; nothing was allocated for it.
    #[error("{what} at {path} is {actual}, the limit is {limit}{}", remedy(.what))]
    TooLarge {
        /// Name of the thing that is too large: `message`, `nesting`, …
        what: &'static str,
        /// Place in the message, from `$`.
        path: String,
        /// Size found.
        actual: u64,
        /// Largest allowed.
        limit: u64,
    },
    /// A valid message, but not of the kind this endpoint carries.
    #[error("expected {expected}, received {actual}")]
    Mismatch {
        /// Kind that the endpoint carries.
        expected: String,
        /// Kind that arrived.
        actual: String,
    },
}

fn remedy(what: &str) -> &'static str {
    if matches!(what, "message" | "memory of the values") { " (raise max_message_mib)" } else { "" }
}

/// Error of encoding a payload.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum EncodeError {
    /// The format has no way to write this.
    #[error("{format} cannot hold {what} at {path}; {remedy}")]
    Unrepresentable {
        /// Format being written.
        format: &'static str,
        /// Thing that cannot be written.
        what: String,
        /// Place in the value, from `$`.
        path: String,
        /// Remedy.
        remedy: String,
    },
    /// The payload is not of the kind this endpoint carries.
    #[error("expected {expected}, was given {actual}")]
    Mismatch {
        /// Kind that the endpoint carries.
        expected: String,
        /// Kind that was given.
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
