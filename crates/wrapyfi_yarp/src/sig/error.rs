//! Faults of images, sounds, vectors and matrices.

/// Fault of the bytes of an object, or of an object that is to be written. `what` is `an image`, `a sound`, and
/// so on.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SigError {
    /// The bytes end too early.
    #[error("{what} of {needed} bytes, {given} were given: the message was cut short")]
    Truncated {
        /// Object.
        what: &'static str,
        /// Bytes that there should be.
        needed: usize,
        /// Bytes that there are.
        given: usize,
    },
    /// The bytes are something else.
    #[error("byte {at} holds {found}, {what} has {wanted} there ({part})")]
    Other {
        /// Object.
        what: &'static str,
        /// Value that stands there, or the reason that another number may.
        part: &'static str,
        /// Place of the first difference.
        at: usize,
        /// Number that stands there.
        found: i32,
        /// Number that the object has there.
        wanted: i32,
    },
    /// The bytes are of another version, for a reason in words.
    #[error("{0}")]
    OtherVersion(String),
    /// The object is larger than allowed.
    #[error("{what} of {length} bytes, the limit is {limit}: raise WireLimits::max_message_bytes")]
    TooLong {
        /// Object.
        what: &'static str,
        /// Bytes of the object.
        length: usize,
        /// Limit.
        limit: usize,
    },
    /// The parts of the object contradict each other, as the words say.
    #[error("{0}: the message is damaged")]
    Damaged(String),
    /// The object is one that YARP, or the dialect, does not have, as the words say.
    #[error("{0}")]
    Unsupported(String),
    /// A bottle without the elements of a sound.
    #[error("the bottle is no sound: it has to be samples, channels, 2, frequency (numbers)")]
    Bottle,
}

impl SigError {
    /// True for bytes that are something else, and not a damaged object.
    pub const fn is_mismatch(&self) -> bool {
        matches!(self, Self::Other { .. } | Self::OtherVersion(_) | Self::Bottle)
    }
}

/// A size that was read.
pub(super) fn size(what: &'static str, part: &'static str, value: i32) -> Result<usize, SigError> {
    let negative = |_error| SigError::Damaged(format!("{what} whose {part} is {value}"));
    usize::try_from(value).map_err(negative)
}

/// A size as it is written.
pub(super) fn written(what: &str, part: &str, value: usize) -> Result<i32, SigError> {
    i32::try_from(value).map_err(|_error| unwritable(what, part, value))
}

/// Fault of a size that does not fit in a message.
pub(super) fn unwritable(what: &str, part: &str, value: usize) -> SigError {
    let max = i32::MAX;
    let text =
        format!("{what} whose {part} is {value} cannot be written: YARP's sizes end at {max}");
    SigError::Unsupported(text)
}

/// Fault of an image whose width, height and size of a pixel contradict the number of bytes.
pub(super) fn contradictory(
    (width, height): (usize, usize),
    pixel_bytes: usize,
    image_bytes: usize,
) -> SigError {
    SigError::Damaged(format!(
        "{width} x {height} pixels of {pixel_bytes} bytes do not fit {image_bytes} bytes of rows"
    ))
}

/// Checks numbers that every object of the kind has: what stands there, its place, the number, and the right one.
pub(super) fn check(
    what: &'static str,
    fixed: impl IntoIterator<Item = (&'static str, usize, i32, i32)>,
) -> Result<(), SigError> {
    match fixed.into_iter().find(|(_, _, found, wanted)| found != wanted) {
        Some((part, at, found, wanted)) => Err(SigError::Other { what, part, at, found, wanted }),
        None => Ok(()),
    }
}
