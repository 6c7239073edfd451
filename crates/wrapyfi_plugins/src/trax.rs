//! `TraxArray`: a pickled JAX array. Trax works with those, and Wrapyfi sends them in this way where
//! Trax is installed.
//!
//! ```text
//!   ["TraxArray", pickle as Latin-1, base64 of a buffer, …]
//!                    │
//!                    └ jax._src.array._reconstruct_array(_reconstruct, (ndarray, (0,), b'b'),
//!                                  (1, shape, dtype, fortran, bytes), {'weak_type': False})
//! ```
//!
//! | attribute of the origin | meaning |
//! | --- | --- |
//! | `weak_type` = `true` | JAX took the element type from a Python number |

use super::pickled::{in_pickle, numbers, parts_of, pickled};
use super::{Body, Part, Plugin, PluginError, Unpacking};
use crate::pickle::{Allowed, Writer};
use wrapyfi_data::types::{Origin, Value};

/// JAX arrays under Trax.
pub(super) struct Trax;

/// Names that NumPy's function for an empty array has had.
const RECONSTRUCT: [&str; 2] =
    ["numpy.core.multiarray._reconstruct", "numpy._core.multiarray._reconstruct"];

impl Plugin for Trax {
    fn key(&self) -> &str {
        "TraxArray"
    }

    fn decode(&self, body: &Body<'_>, context: &Unpacking<'_>) -> Result<Value, PluginError> {
        let pickle = pickled(body, &Allowed::JAX, context)?;
        let call = pickle.root().call("jax._src.array._reconstruct_array").map_err(in_pickle)?;
        let [function, _empty, state, facts] = call.args().exact().map_err(in_pickle)?;
        if !RECONSTRUCT.iter().any(|name| function.is_global(name)) {
            return Err(in_pickle(function.unexpected("NumPy's _reconstruct")));
        }
        let weak = match facts.dict().map_err(in_pickle)?.find("weak_type") {
            Some(weak) => weak.bool().map_err(in_pickle)?,
            None => false,
        };
        let origin = Origin::new(self.key());
        let origin = if weak { origin.with("weak_type", "true") } else { origin };
        let tensor = numbers(state.array_state().map_err(in_pickle)?, state)?;
        Ok(tensor.with_origin(origin).into())
    }

    fn encode(&self, value: &Value) -> Result<Vec<Part>, PluginError> {
        let tensor = value.as_tensor().ok_or_else(|| PluginError::not_mine("tensor", value))?;
        let weak = tensor.origin().and_then(|origin| origin.get("weak_type")) == Some("true");
        let mut to = Writer::of_protocol(4);
        to.global("jax._src.array", "_reconstruct_array").mark().empty_array();
        to.array_state(tensor.dtype(), tensor.shape(), tensor.data());
        to.mark().str("weak_type").bool(weak).dict_since_mark().tuple_since_mark().reduce();
        Ok(parts_of(to))
    }
}
