//! `TensorflowTensor`, `JAXTensor`, `MXNetTensor`, `CuPyArray`: a `.npy` file, with the device for
//! some of them.
//!
//! JAX and TensorFlow lose the name of `bfloat16` on the way: their files say two bytes of anything
//! (`V2`), which no other type of theirs does. It is read as `bfloat16`, and written as `float32`,
//! which holds every value of it: Wrapyfi cannot read back what it wrote itself.
//!
//! ```text
//!   ["MXNetTensor", "k05VTVBZ…", "cpu:0"]  ◀─▶  Tensor { device: "cpu:0", origin: MXNetTensor, … }
//! ```

use super::{Body, Framework, Part, Plugin, PluginError, Unpacking};
use crate::malformed;
use wrapyfi_data::codec::npy::{self, NpyArray};
use wrapyfi_data::types::{Dtype, Origin, Tensor, Value};

/// A plug-in whose object is a `.npy` file.
#[derive(Debug, Clone, Copy)]
pub(super) struct NpyTensor {
    key: &'static str,
    /// Library whose device stands beside the file, and the device of a tensor without a label.
    device: Option<(Framework, &'static str)>,
}

impl NpyTensor {
    /// All these plug-ins. JAX and TensorFlow send no device.
    pub(super) const ALL: [Self; 4] = [
        Self { key: "TensorflowTensor", device: None },
        Self { key: "JAXTensor", device: None },
        Self { key: "MXNetTensor", device: Some((Framework::MxNet, "cpu:0")) },
        Self { key: "CuPyArray", device: Some((Framework::CuPy, "cuda:0")) },
    ];
}

impl Plugin for NpyTensor {
    fn key(&self) -> &str {
        self.key
    }

    fn decode(&self, body: &Body<'_>, _context: &Unpacking<'_>) -> Result<Value, PluginError> {
        let tensor = match npy::read(&body.base64(0)?).map_err(malformed)? {
            NpyArray::Tensor(tensor) => tensor,
            NpyArray::Array(array) if self.device.is_none() && is_void(&array.descr, 2) => {
                Tensor::new(Dtype::BF16, array.shape, array.data).map_err(malformed)?
            }
            NpyArray::Array(array) => {
                return Err(PluginError::unsupported(
                    format!("an array of {}", array.descr.chars().take(64).collect::<String>()),
                    "send numbers, for instance float32",
                ));
            }
        };
        let tensor = tensor.with_origin(Origin::new(self.key));
        Ok(match self.device {
            Some(_) => tensor.with_device(body.text(1)?),
            None => tensor,
        }
        .into())
    }

    fn encode(&self, value: &Value) -> Result<Vec<Part>, PluginError> {
        let tensor = value.as_tensor().ok_or_else(|| PluginError::not_mine("tensor", value))?;
        let (header, data) = npy::shared_parts(tensor);
        let mut parts = vec![Part::Base64(header.into(), data)];
        if let Some((framework, default)) = self.device {
            parts.push(Part::Text(framework.label(tensor.device(), default)));
        }
        Ok(parts)
    }
}

/// True for the code of `size` bytes of any content, in whichever byte order.
fn is_void(descr: &str, size: usize) -> bool {
    let code = descr.trim_matches(['\'', '"']).trim_start_matches(['<', '|', '=']);
    code == format!("V{size}")
}
