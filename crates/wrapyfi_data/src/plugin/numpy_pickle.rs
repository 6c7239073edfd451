//! Common parts of the plug-ins that send pickled NumPy arrays: Paddle's and Trax's.

use super::PluginError;
use crate::codec::pickle::{Node, PickleError, PickledArray};
use crate::types::Tensor;

/// Converts an error of the pickle in part 0.
pub(super) fn in_pickle(error: PickleError) -> PluginError {
    match error {
        PickleError::Refused { global, .. } => PluginError::Refused { part: 0, what: global },
        PickleError::TooLarge { what, actual, limit, .. } => {
            PluginError::TooLarge { what: what.to_owned(), actual, limit }
        }
        other => PluginError::malformed(0, other.to_string()),
    }
}

/// Takes an array that was read at `node` as a tensor; an error where it has no numbers.
pub(super) fn numbers(array: PickledArray<'_>, node: Node<'_>) -> Result<Tensor, PluginError> {
    match array {
        PickledArray::Tensor(tensor) => Ok(tensor),
        _ => Err(in_pickle(node.unexpected("an array of numbers"))),
    }
}
