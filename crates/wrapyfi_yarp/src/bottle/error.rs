//! Errors of bottles that are read or written.

use crate::Dialect;

/// Error of reading a bottle. Offsets count from the start of the bottle.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum BottleError {
    /// The bytes end early.
    #[error("{what} at byte {at} needs {needed} bytes, {left} are left: the message was cut short")]
    Truncated {
        /// Name of the missing part.
        what: &'static str,
        /// Offset of the part in bytes.
        at: usize,
        /// Length of the part in bytes.
        needed: usize,
        /// Number of bytes that are left.
        left: usize,
    },
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
    /// A type code that no dialect has.
    #[error(
        "type code {code} at byte {at} is none of YARP's: the message is damaged, or not a bottle"
    )]
    UnknownCode {
        /// The code.
        code: i32,
        /// Offset of the code in bytes.
        at: usize,
    },
    /// A bottle begins with the code of a list; this begins with something else.
    #[error("a bottle begins with a list code (256 and above), not with {0}: it is no bottle")]
    NotAList(i32),
    /// A length or count below zero.
    #[error("{what} at byte {at} is {length}: lengths cannot be negative, the message is damaged")]
    Negative {
        /// Name of the part with the length.
        what: &'static str,
        /// Offset of the length in bytes.
        at: usize,
        /// The length.
        length: i32,
    },
    /// More elements than the bytes behind the count can hold.
    #[error(
        "a list of {count} elements at byte {at} needs {needed} bytes or more, {left} are left: \
         the message is damaged"
    )]
    CountBeyondBytes {
        /// Elements announced.
        count: usize,
        /// Offset of the count in bytes.
        at: usize,
        /// Least number of bytes that so many elements take.
        needed: usize,
        /// Number of bytes that are left.
        left: usize,
    },
    /// More elements than the limit.
    #[error(
        "more than {0} values in one bottle: raise Limits::max_elements, or read it as a vector"
    )]
    TooManyElements(usize),
    /// Lists in lists beyond the limit.
    #[error("lists nested more than {limit} deep: raise Limits::max_depth")]
    TooDeep {
        /// Limit.
        limit: usize,
    },
    /// Longer than a message may be.
    #[error(
        "a bottle of {length} bytes or more, the limit is {limit}: raise Limits::max_message_bytes"
    )]
    TooLong {
        /// Length of the bottle in bytes, as far as known.
        length: usize,
        /// [`crate::Limits::max_message_bytes`].
        limit: usize,
    },
    /// Bytes behind a bottle that should fill its message.
    #[error(
        "the bottle ends after {used} of {length} bytes: the message is damaged, or in a dialect \
         other than {dialect}"
    )]
    Surplus {
        /// Length of the bottle in bytes.
        used: usize,
        /// Length of the message.
        length: usize,
        /// The dialect that was read.
        dialect: Dialect,
    },
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
