//! Why a pickle is not read, or not understood.

use super::super::{DecodeError, EncodeError};

/// Why a pickle is refused. Every variant says where: a byte of the pickle, as `pickletools.dis`
/// counts them, or the path of an object inside it.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PickleError {
    /// A function or class that is not on the list: nothing was imported, nothing was called.
    #[error("the pickle names {global}, which is not on the list of data constructors (byte {at})")]
    Refused {
        /// `module.name` as the pickle has it, shortened where it is long.
        global: String,
        /// Byte of the opcode.
        at: usize,
    },
    /// An instruction that could do more than build data, or none of Python's.
    #[error("{opcode} at byte {at}: {reason}")]
    Opcode {
        /// Its name in Python's `pickletools`, or its code.
        opcode: String,
        /// Byte of the opcode.
        at: usize,
        /// Why it is refused.
        reason: String,
    },
    /// The pickle ends early, or claims a length that is not there.
    #[error("the pickle ends early: {what} at byte {at} needs {needed} bytes, {left} are left")]
    Truncated {
        /// What was being read.
        what: &'static str,
        /// Byte where it begins.
        at: usize,
        /// Bytes it claims.
        needed: u64,
        /// Bytes that are there.
        left: usize,
    },
    /// A size exceeds its limit; nothing was allocated for it.
    #[error("{what} at byte {at} is {actual}, the limit is {limit}{}", remedy(.what))]
    TooLarge {
        /// What is too large: `memory of the pickle`, `memo index`, …
        what: &'static str,
        /// Byte of the opcode.
        at: usize,
        /// Size found.
        actual: u64,
        /// Largest allowed.
        limit: u64,
    },
    /// A buffer that should travel beside the pickle is missing.
    #[error("the pickle uses out-of-band buffer number {wanted}, {count} came with it (byte {at})")]
    Buffer {
        /// How many buffers are needed at least.
        wanted: usize,
        /// How many came.
        count: usize,
        /// Byte of the opcode.
        at: usize,
    },
    /// The object is not what its place asks for.
    #[error("{path} should be {expected}, it is {actual} (byte {at})")]
    Unexpected {
        /// Where in the object: `$._mgr.args[0]`.
        path: String,
        /// What belongs there.
        expected: String,
        /// What is there.
        actual: String,
        /// Byte of the opcode that made it.
        at: usize,
    },
    /// The object is of the right kind, but its parts make no value.
    #[error("the {what} at {path} cannot be read: {reason} (byte {at})")]
    Invalid {
        /// What it should be.
        what: &'static str,
        /// Where in the object.
        path: String,
        /// What is wrong, with the numbers.
        reason: String,
        /// Byte of the opcode that made it.
        at: usize,
    },
}

fn remedy(what: &str) -> &'static str {
    match what {
        "pickle with its buffers" | "memory of the pickle" | "memory of the object" => {
            " (raise max_message_mib)"
        }
        _ => "",
    }
}

impl PickleError {
    /// The same as an error of the message that holds the pickle at `path`.
    #[must_use]
    pub fn at(self, path: &str) -> DecodeError {
        let path = path.to_owned();
        match self {
            Self::TooLarge { what, actual, limit, .. } => {
                DecodeError::TooLarge { what, path, actual, limit }
            }
            other => DecodeError::Malformed { format: "pickle", path, reason: other.to_string() },
        }
    }
}

impl From<PickleError> for DecodeError {
    fn from(error: PickleError) -> Self {
        error.at("$")
    }
}

/// What this protocol has no way to write.
pub(super) fn unwritable(what: impl Into<String>, remedy: &str) -> EncodeError {
    EncodeError::Unrepresentable {
        format: "pickle",
        what: what.into(),
        path: "$".to_owned(),
        remedy: remedy.to_owned(),
    }
}
