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

use super::numpy_pickle::{in_pickle, numbers};
use super::pickle_text::PickleText;
use super::{Body, Part, Plugin, PluginError, Unpacking};
use crate::codec::pickle::{self, Allowed};
use crate::types::{Origin, Tensor, Value};

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
        let file = body.latin1(0)?;
        let buffers =
            (1..body.len()).map(|part| body.base64(part)).collect::<Result<Vec<_>, _>>()?;
        let pickle =
            pickle::read(&file, &buffers, &Allowed::JAX, context.limits).map_err(in_pickle)?;
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
        let file = write(tensor).ok_or_else(|| PluginError::TooLarge {
            what: "the pickle of the array".into(),
            actual: tensor.data().len() as u64,
            limit: u32::MAX.into(),
        })?;
        Ok(vec![Part::Latin1(file.into())])
    }
}

fn write(tensor: &Tensor) -> Option<Vec<u8>> {
    let weak = tensor.origin().and_then(|origin| origin.get("weak_type")) == Some("true");
    let mut out = PickleText::with_room(4, tensor.data().len());
    out.global("jax._src.array", "_reconstruct_array");
    out.raw(b"(");
    out.numpy_reconstruct();
    out.numpy_state(tensor.dtype(), tensor.shape(), tensor.data())?;
    out.raw(b"}");
    out.text("weak_type")?;
    out.bool(weak);
    out.raw(b"stR");
    Some(out.finish())
}
