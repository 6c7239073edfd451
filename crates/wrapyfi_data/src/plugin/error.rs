//! Errors of plug-ins.

use crate::types::Value;

/// Error of a plug-in that could not read or write an object. The caller adds the key and the place
/// of the object in the message.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::plugin; }
/// use wrapyfi_core::plugin::PluginError;
/// let error = PluginError::not_mine("quantity", &"five".into());
/// assert!(matches!(&error, PluginError::Unsupported { .. }));
/// assert!(error.to_string().starts_with("a str where a quantity should be is not supported; "));
/// ```
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PluginError {
    /// The parts do not follow the plug-in's format.
    #[error("part {part} is malformed: {reason}")]
    Malformed {
        /// Index of the part behind the key, from 0.
        part: usize,
        /// Fault, with its numbers, and its place inside the part.
        reason: String,
    },
    /// A part holds a global or opcode that is never read, because reading it would mean running
    /// it.
    #[error("part {part} names {what}, which is not on the list of what may be read")]
    Refused {
        /// Index of the part behind the key, from 0.
        part: usize,
        /// Name of the global or opcode.
        what: String,
    },
    /// The object is valid, but of a kind that this plug-in does not read or write.
    #[error("{what} is not supported; {remedy}")]
    Unsupported {
        /// Thing that is not supported.
        what: String,
        /// Thing that can be sent instead.
        remedy: String,
    },
    /// A size exceeds its limit; nothing was allocated for it.
    #[error("{what} is {actual}, the limit is {limit}")]
    TooLarge {
        /// Name of the thing that is too large.
        what: String,
        /// Size found.
        actual: u64,
        /// Largest allowed.
        limit: u64,
    },
}

impl PluginError {
    /// Error for an object of a kind that is not read or written, and what can be sent instead.
    pub fn unsupported(what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::Unsupported { what: what.into(), remedy: remedy.into() }
    }

    /// Error for the part number `part`, which does not follow the format.
    pub fn malformed(part: usize, reason: impl Into<String>) -> Self {
        Self::Malformed { part, reason: reason.into() }
    }

    /// Error for a size over its limit.
    pub fn too_large(what: impl Into<String>, actual: usize, limit: usize) -> Self {
        Self::TooLarge { what: what.into(), actual: actual as u64, limit: limit as u64 }
    }

    /// Error for a value that was given to a plug-in of another type.
    pub fn not_mine(wanted: &str, value: &Value) -> Self {
        Self::Unsupported {
            what: format!("a {} where a {wanted} should be", value.kind()),
            remedy: "give the value the origin of the plug-in that writes it".into(),
        }
    }
}
