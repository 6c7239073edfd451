//! The one error of values whose bytes must fit the header beside them.

/// Bytes that do not fit the header that describes them.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ShapeError {
    /// Too few or too many bytes.
    #[error("{what} needs {expected} bytes, {actual} are there")]
    Length {
        /// What is described, with its numbers.
        what: String,
        /// Bytes the header asks for.
        expected: usize,
        /// Bytes given.
        actual: usize,
    },
    /// A header that asks for more than memory can hold.
    #[error("{what} is larger than memory can be")]
    Overflow {
        /// What is described, with its numbers.
        what: String,
    },
    /// Rows that overlap.
    #[error("{what}: a step of {step} bytes is less than a row of {row} bytes")]
    Step {
        /// What is described, with its numbers.
        what: String,
        /// Bytes from one row to the next.
        step: usize,
        /// Bytes of one row's pixels.
        row: usize,
    },
    /// Sound without channels.
    #[error("sound needs at least 1 channel, 0 are given")]
    NoChannels,
}

/// Elements of an array with this shape; `None` when that overflows. An extent of 0 makes any
/// shape empty, as in NumPy.
pub(crate) fn element_count(shape: &[usize]) -> Option<usize> {
    if shape.contains(&0) {
        return Some(0);
    }
    shape.iter().try_fold(1_usize, |count, &extent| count.checked_mul(extent))
}

/// Checks that `actual` bytes hold `shape` elements of `itemsize` bytes.
pub(crate) fn check_length(
    shape: &[usize],
    itemsize: usize,
    actual: usize,
    what: impl Fn() -> String,
) -> Result<(), ShapeError> {
    match element_count(shape).and_then(|count| count.checked_mul(itemsize)) {
        None => Err(ShapeError::Overflow { what: what() }),
        Some(expected) if expected != actual => {
            Err(ShapeError::Length { what: what(), expected, actual })
        }
        Some(_) => Ok(()),
    }
}
