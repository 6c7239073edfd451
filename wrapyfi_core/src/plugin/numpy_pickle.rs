//! NumPy arrays as they stand in pickles: what Paddle and Trax send.
//!
//! ```text
//!   _reconstruct(ndarray, (0,), b'b')  then the state  (1, shape, dtype, fortran, bytes)
//!   _frombuffer(buffer, dtype, shape, order)
//! ```

use super::PluginError;
use crate::codec::npy;
use crate::codec::pickle::{Node, PickleError};
use crate::types::{Dtype, Tensor, element_count, swap_byte_order};

/// Most dimensions an array may have, as in NumPy.
const MAX_DIMENSIONS: usize = 64;

const RECONSTRUCT: [&str; 2] =
    ["numpy.core.multiarray._reconstruct", "numpy._core.multiarray._reconstruct"];
const FROM_BUFFER: [&str; 2] =
    ["numpy.core.numeric._frombuffer", "numpy._core.numeric._frombuffer"];

/// An error of the pickle in part 0.
pub(super) fn in_pickle(error: PickleError) -> PluginError {
    match error {
        PickleError::Refused { global, .. } => PluginError::Refused { part: 0, what: global },
        PickleError::TooLarge { what, actual, limit, .. } => {
            PluginError::TooLarge { what: what.to_owned(), actual, limit }
        }
        other => PluginError::Malformed { part: 0, reason: other.to_string() },
    }
}

/// The array at `node`.
pub(super) fn array(node: Node<'_>) -> Result<Tensor, PluginError> {
    if let Ok(call) = node.call_of(&FROM_BUFFER) {
        let [data, dtype, shape, order] = call.args().exact().map_err(in_pickle)?;
        let fortran = match order.str().map_err(in_pickle)? {
            "C" => false,
            "F" => true,
            _ => return Err(in_pickle(order.unexpected("the order C or F"))),
        };
        return tensor(dtype, shape, fortran, data);
    }
    let call = node.call_of(&RECONSTRUCT).map_err(in_pickle)?;
    filled(call.state().map_err(in_pickle)?)
}

/// True for the function that makes an empty array.
pub(super) fn is_reconstruct(node: Node<'_>) -> bool {
    RECONSTRUCT.iter().any(|name| node.is_global(name))
}

/// The array that `state` makes of an empty one.
pub(super) fn filled(state: Node<'_>) -> Result<Tensor, PluginError> {
    let [_version, shape, dtype, fortran, data] =
        state.tuple().and_then(|parts| parts.exact()).map_err(in_pickle)?;
    tensor(dtype, shape, fortran.bool().map_err(in_pickle)?, data)
}

fn tensor(
    dtype: Node<'_>,
    shape: Node<'_>,
    fortran: bool,
    data: Node<'_>,
) -> Result<Tensor, PluginError> {
    let (number, big_endian) = element_type(dtype)?;
    let extents = shape.tuple().map_err(in_pickle)?;
    if extents.len() > MAX_DIMENSIONS {
        return Err(PluginError::TooLarge {
            what: format!("number of dimensions at {}", shape.path()),
            actual: extents.len() as u64,
            limit: MAX_DIMENSIONS as u64,
        });
    }
    let extents: Vec<usize> =
        extents.iter().map(|extent| extent.size()).collect::<Result<_, _>>().map_err(in_pickle)?;
    let misfit = |reason: String| PluginError::Malformed { part: 0, reason };
    let mut bytes = data.bytes().map_err(in_pickle)?;
    // Before anything is moved, not after.
    let wanted = element_count(&extents).and_then(|count| count.checked_mul(number.size()));
    if wanted == Some(bytes.len()) && wanted != Some(0) {
        if fortran {
            bytes = npy::to_row_major(bytes, &extents, number.size());
        }
        if big_endian && number.scalar_size() > 1 {
            let mut swapped = bytes.to_vec();
            swap_byte_order(&mut swapped, number.scalar_size());
            bytes = swapped.into();
        }
    }
    Tensor::new(number, extents, bytes).map_err(|error| misfit(format!("{}: {error}", data.path())))
}

/// Element type and whether it is big-endian.
fn element_type(node: Node<'_>) -> Result<(Dtype, bool), PluginError> {
    let call = node.call("numpy.dtype").map_err(in_pickle)?;
    let code = call.arg(0).map_err(in_pickle)?;
    let unknown = || in_pickle(code.unexpected("the code of a number type"));
    let dtype = if code.is_global("ml_dtypes.bfloat16") {
        Dtype::BF16
    } else {
        let code = code.str().map_err(in_pickle)?;
        let same =
            |dtype: &Dtype| dtype.npy_descr().is_some_and(|descr| descr.get(1..) == Some(code));
        Dtype::ALL.into_iter().find(same).ok_or_else(unknown)?
    };
    let big_endian = match call.find_state() {
        None => false,
        Some(state) => {
            let parts = state.tuple().map_err(in_pickle)?;
            let order = parts.get(1).map_err(in_pickle)?;
            match order.str().map_err(in_pickle)? {
                "<" | "|" | "=" => false,
                ">" => true,
                _ => return Err(in_pickle(order.unexpected("a byte order"))),
            }
        }
    };
    Ok((dtype, big_endian))
}
