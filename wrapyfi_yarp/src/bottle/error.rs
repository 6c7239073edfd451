//! What can be wrong with a bottle.

use crate::Dialect;

/// Why bytes are not a bottle. Positions count from the start of the bottle.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum BottleError {
    /// The bytes end early.
    #[error("{what} at byte {at} needs {needed} bytes, {left} are left: the message was cut short")]
    Truncated {
        /// What should be there.
        what: &'static str,
        /// Where it begins.
        at: usize,
        /// Its length in bytes.
        needed: usize,
        /// How many bytes there are.
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
        /// Where it stands.
        at: usize,
        /// What the other dialect means by it.
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
        /// Where it stands.
        at: usize,
    },
    /// A bottle begins with the code of a list; this begins with something else.
    #[error("a bottle begins with a list code (256 and above), not with {code}: it is no bottle")]
    NotAList {
        /// The code.
        code: i32,
    },
    /// A length or count below zero.
    #[error("{what} at byte {at} is {length}: lengths cannot be negative, the message is damaged")]
    Negative {
        /// What has the length.
        what: &'static str,
        /// Where the length stands.
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
        /// Where the count stands.
        at: usize,
        /// Least number of bytes that so many elements take.
        needed: usize,
        /// How many bytes there are.
        left: usize,
    },
    /// More elements than the limit.
    #[error(
        "more than {limit} values in one bottle: raise Limits::max_elements, or read it as a vector"
    )]
    TooManyElements {
        /// [`crate::Limits::max_elements`].
        limit: usize,
    },
    /// Lists in lists beyond the limit.
    #[error("lists nested more than {limit} deep at byte {at}: raise Limits::max_depth")]
    TooDeep {
        /// The depth that holds.
        limit: usize,
        /// Where the list begins.
        at: usize,
    },
    /// Longer than a message may be.
    #[error(
        "a bottle of {length} bytes or more, the limit is {limit}: raise Limits::max_message_bytes"
    )]
    TooLong {
        /// Its length, as far as known.
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
        /// Where the bottle ends.
        used: usize,
        /// Length of the message.
        length: usize,
        /// The dialect that was read.
        dialect: Dialect,
    },
}

/// Why a bottle cannot be written as bytes.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum EncodeError {
    /// YARP 3 has no words of eight letters.
    #[error("the vocab {word} has 64 bits, which dialect v3 cannot write: use a string, or v4")]
    NoVocab64 {
        /// The word in its brackets.
        word: String,
    },
    /// A length that 31 bits cannot say.
    #[error("{what} of {length} cannot be written: YARP's lengths end at {max}", max = i32::MAX)]
    TooLong {
        /// What is too long.
        what: &'static str,
        /// Its bytes or elements.
        length: usize,
    },
}

/// Why text is not a bottle. YARP's own reader takes nearly any text; what is refused here are
/// sizes.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum TextError {
    /// Longer than a message may be.
    #[error("text of {length} bytes, the limit is {limit}: raise Limits::max_message_bytes")]
    TooLong {
        /// Its bytes.
        length: usize,
        /// [`crate::Limits::max_message_bytes`].
        limit: usize,
    },
    /// More elements than the limit.
    #[error("more than {limit} values in one bottle: raise Limits::max_elements")]
    TooManyElements {
        /// [`crate::Limits::max_elements`].
        limit: usize,
    },
    /// Lists in lists beyond the limit.
    #[error("lists nested more than {limit} deep: raise Limits::max_depth")]
    TooDeep {
        /// The depth that holds.
        limit: usize,
    },
}
