//! Common parts of the plug-ins that send pickles.

use super::{Body, Part, PluginError, Unpacking};
use crate::pickle::{self, Allowed, Node, PickleError, PickledArray, Writer};
use wrapyfi_data::types::Tensor;

/// Converts an error of the pickle in part 0.
pub(super) fn in_pickle(error: PickleError) -> PluginError {
    in_member("", error)
}

/// Converts an error of the pickle under the name `place` in part 0: `data.pkl: `.
pub(super) fn in_member(place: &str, error: PickleError) -> PluginError {
    match error {
        PickleError::Refused { global, .. } => PluginError::Refused { part: 0, what: global },
        PickleError::TooLarge { what, actual, limit, .. } => {
            PluginError::TooLarge { what: format!("{place}{what}"), actual, limit }
        }
        other => PluginError::malformed(0, format!("{place}{other}")),
    }
}

/// Takes an array that was read at `node` as a tensor; an error where it has no numbers.
pub(super) fn numbers(array: PickledArray<'_>, node: Node<'_>) -> Result<Tensor, PluginError> {
    match array {
        PickledArray::Tensor(tensor) => Ok(tensor),
        _ => Err(in_pickle(node.unexpected("an array of numbers"))),
    }
}

/// The pickle in part 0, with its buffers in the parts behind it.
pub(super) fn pickled(
    body: &Body<'_>,
    allowed: &Allowed,
    context: &Unpacking<'_>,
) -> Result<pickle::Pickle, PluginError> {
    let data = body.latin1(0)?;
    let buffers = (1..body.len()).map(|part| body.base64(part)).collect::<Result<Vec<_>, _>>()?;
    pickle::read(&data, &buffers, allowed, context.limits).map_err(in_pickle)
}

/// The parts in which [`pickled`] finds what was written.
pub(super) fn parts_of(pickle: Writer) -> Vec<Part> {
    let (data, buffers) = pickle.finish();
    let buffers = buffers.into_iter().map(Part::base64);
    std::iter::once(Part::Latin1(data.into())).chain(buffers).collect()
}
