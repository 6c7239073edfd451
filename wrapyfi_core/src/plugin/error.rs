//! Why a plug-in refused an object.

use crate::types::Value;

/// Why a plug-in could not read or write an object. The caller adds the key and where in the
/// message the object lies.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PluginError {
    /// The parts do not follow the plug-in's format.
    #[error("part {part} is malformed: {reason}")]
    Malformed {
        /// Index behind the key, from 0.
        part: usize,
        /// What is wrong, with the numbers, and where inside the part.
        reason: String,
    },
    /// A part holds something that is never read, because reading it would mean running it.
    #[error("part {part} names {what}, which is not on the list of what may be read")]
    Refused {
        /// Index behind the key, from 0.
        part: usize,
        /// The global or opcode.
        what: String,
    },
    /// Valid, but of a kind that this plug-in does not read or write.
    #[error("{what} is not supported; {remedy}")]
    Unsupported {
        /// What it is.
        what: String,
        /// What can be sent instead.
        remedy: String,
    },
    /// A size exceeds its limit; nothing was allocated for it.
    #[error("{what} is {actual}, the limit is {limit}")]
    TooLarge {
        /// What is too large.
        what: String,
        /// Size found.
        actual: u64,
        /// Largest allowed.
        limit: u64,
    },
}

impl PluginError {
    /// A value given to a plug-in that writes another type.
    #[must_use]
    pub fn not_mine(wanted: &str, value: &Value) -> Self {
        Self::Unsupported {
            what: format!("a {} where a {wanted} should be", value.kind()),
            remedy: "give the value the origin of the plug-in that writes it".into(),
        }
    }
}
