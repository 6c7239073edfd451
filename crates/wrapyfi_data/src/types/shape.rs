//! The one error of values whose bytes must fit the header beside them.

/// Error of bytes that do not fit the header that describes them.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::types; }
/// use wrapyfi_core::types::{Dtype, Tensor};
/// let error = Tensor::new(Dtype::F32, [2, 2], vec![0_u8; 4]).unwrap_err();
/// assert_eq!(error.to_string(), "float32 array [2, 2] needs 16 bytes, 4 are there");
/// ```
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ShapeError {
    /// The bytes are too few or too many.
    #[error("{what} needs {expected} bytes, {actual} are there")]
    Length {
        /// Thing that the header describes, with its numbers.
        what: String,
        /// Number of bytes that the header asks for.
        expected: usize,
        /// Number of bytes given.
        actual: usize,
    },
    /// The header asks for more than memory can hold.
    #[error("{0} is larger than memory can be")]
    Overflow(String),
    /// The rows overlap.
    #[error("{what}: a step of {step} bytes is less than a row of {row} bytes")]
    Step {
        /// Thing that the header describes, with its numbers.
        what: String,
        /// Number of bytes from one row to the next.
        step: usize,
        /// Size of one row's pixels in bytes.
        row: usize,
    },
    /// The sound has no channels.
    #[error("sound needs at least 1 channel, 0 are given")]
    NoChannels,
}

/// Number of elements of an array with this shape; `None` when it overflows. An extent of 0 makes
/// any shape empty, as in NumPy.
pub fn element_count(shape: &[usize]) -> Option<usize> {
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
        None => Err(ShapeError::Overflow(what())),
        Some(expected) if expected != actual => {
            Err(ShapeError::Length { what: what(), expected, actual })
        }
        Some(_) => Ok(()),
    }
}
