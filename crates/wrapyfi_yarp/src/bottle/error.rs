//! Errors of bottles that are read or written.

use crate::Dialect;

/// Error of reading a bottle. Offsets count from the start of the bottle.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum BottleError {
    /// Bytes that are no whole bottle: they end early, or lie about their lengths, or have a type
    /// code that no dialect has.
    #[error("{0}")]
    Damaged(String),
    /// A type code of the other dialect, so the peer speaks that one.
    #[error(
        "type code {code} at byte {at} is {meaning} of YARP's dialect {other}, but this connection \
         reads {dialect}: set its dialect to {other}",
        other = dialect.other()
    )]
    OtherDialect {
        /// The code.
        code: i32,
        /// Offset of the code in bytes.
        at: usize,
        /// Meaning of the code in the other dialect.
        meaning: &'static str,
        /// The dialect that was read.
        dialect: Dialect,
    },
    /// More elements than the limit.
    #[error(
        "more than {0} values in one bottle: raise WireLimits::max_elements, or read it as a vector"
    )]
    TooManyElements(usize),
    /// Lists in lists beyond the limit.
    #[error("lists nested more than {limit} deep: raise WireLimits::max_depth")]
    TooDeep {
        /// Limit.
        limit: usize,
    },
    /// Longer than a message may be.
    #[error(
        "a bottle of {length} bytes or more, the limit is {limit}: raise WireLimits::max_message_bytes"
    )]
    TooLong {
        /// Length of the bottle in bytes, as far as known.
        length: usize,
        /// [`crate::WireLimits::max_message_bytes`].
        limit: usize,
    },
}

impl BottleError {
    /// Reads a length, which is not negative.
    pub(super) fn length(what: &str, at: usize, length: i32) -> Result<usize, Self> {
        usize::try_from(length).ok().ok_or_else(|| {
            Self::Damaged(format!(
                "{what} at byte {at} is {length}: lengths cannot be negative, the message is damaged"
            ))
        })
    }
}

/// Error of writing a bottle as bytes.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum EncodeError {
    /// YARP 3 has no words of eight letters.
    #[error("the vocab {0} has 64 bits, which dialect v3 cannot write: use a string, or v4")]
    NoVocab64(String),
    /// A length that 31 bits cannot say.
    #[error("{what} of {length} cannot be written: YARP's lengths end at {max}", max = i32::MAX)]
    TooLong {
        /// Name of the part that is too long.
        what: &'static str,
        /// Number of its bytes or elements.
        length: usize,
    },
}
