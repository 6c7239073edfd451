//! `PaddleTensor`: a pickled pair of name and NumPy array, and the place.
//!
//! ```text
//!   ["PaddleTensor", base64 of a pickle, "gpu:0"]
//!                       │
//!                       └ ("generated_tensor_0", ndarray)      read as data, never run
//! ```
//!
//! Paddle has no `uint16`: where its arrays say so, they hold the bits of `bfloat16`.
//!
//! | attribute of the origin | meaning |
//! | --- | --- |
//! | `name` | the tensor's name in Paddle |

use super::pickled::{in_pickle, numbers};
use super::{Body, Framework, Part, Plugin, PluginError, Unpacking};
use crate::pickle::{self, Allowed, Writer};
use wrapyfi_data::types::{Dtype, Origin, Value};

/// PaddlePaddle's tensors.
pub(super) struct Paddle;

/// Name of a tensor that has none.
const UNNAMED: &str = "generated_tensor_0";

impl Plugin for Paddle {
    fn key(&self) -> &str {
        Framework::Paddle.key()
    }

    fn decode(&self, body: &Body<'_>, context: &Unpacking<'_>) -> Result<Value, PluginError> {
        let file = body.base64(0)?;
        let pickle =
            pickle::read(&file, &[], &Allowed::PADDLE, context.limits).map_err(in_pickle)?;
        let [name, data] =
            pickle.root().tuple().and_then(|pair| pair.exact()).map_err(in_pickle)?;
        let tensor = match numbers(data.array().map_err(in_pickle)?, data)? {
            bits if bits.dtype() == Dtype::U16 => pickle::bits_of_bfloat16(bits),
            tensor => tensor,
        };
        element_type(tensor.dtype())?;
        let name = name.str().map_err(in_pickle)?;
        let origin = Origin::new(self.key()).with("name", name);
        Ok(tensor.with_origin(origin).with_device(body.text(1)?).into())
    }

    fn encode(&self, value: &Value) -> Result<Vec<Part>, PluginError> {
        let tensor = value.as_tensor().ok_or_else(|| PluginError::not_mine("tensor", value))?;
        let dtype = element_type(tensor.dtype())?;
        let name = tensor.origin().and_then(|origin| origin.get("name")).unwrap_or(UNNAMED);
        let mut to = Writer::of_protocol(4);
        to.str(name).empty_array().reduce();
        to.array_state(dtype, tensor.shape(), tensor.data()).build().tuple(2);
        let (file, _) = to.finish();
        let place = Framework::Paddle.label(tensor.device(), "cpu");
        Ok(vec![Part::base64(file), Part::Text(place)])
    }
}

/// Element type on the wire for elements of this type.
fn element_type(dtype: Dtype) -> Result<Dtype, PluginError> {
    match dtype {
        Dtype::BF16 => Ok(Dtype::U16),
        Dtype::U16 | Dtype::U32 | Dtype::U64 => {
            Err(PluginError::unsupported(format!("a Paddle tensor of {dtype}"), "send it as int64"))
        }
        other => Ok(other),
    }
}
