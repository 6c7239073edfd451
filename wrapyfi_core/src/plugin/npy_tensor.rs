//! `TensorflowTensor`, `JAXTensor`, `MXNetTensor`, `CuPyArray`: a `.npy` file, and the device where
//! the plug-in says it.
//!
//! ```text
//!   ["MXNetTensor", "k05VTVBZ…", "cpu:0"]  ◀─▶  Tensor { device: "cpu:0", origin: MXNetTensor, … }
//! ```

use super::{Body, Context, Part, Plugin, PluginError};
use crate::codec::npy::{self, NpyArray};
use crate::types::{Origin, Value};

/// A plug-in whose object is a `.npy` file.
#[derive(Debug, Clone, Copy)]
pub(super) struct NpyTensor {
    key: &'static str,
    /// Device of a tensor without a label; `None` where no device is sent.
    device: Option<&'static str>,
}

impl NpyTensor {
    /// All of them. JAX and TensorFlow send no device.
    pub(super) const ALL: [Self; 4] = [
        Self { key: "TensorflowTensor", device: None },
        Self { key: "JAXTensor", device: None },
        Self { key: "MXNetTensor", device: Some("cpu:0") },
        Self { key: "CuPyArray", device: Some("cuda:0") },
    ];
}

impl Plugin for NpyTensor {
    fn key(&self) -> &str {
        self.key
    }

    fn decode(&self, body: &Body<'_>, _context: &Context<'_>) -> Result<Value, PluginError> {
        let array = npy::read(&body.base64(0)?)
            .map_err(|error| PluginError::Malformed { part: 0, reason: error.to_string() })?;
        let NpyArray::Tensor(tensor) = array else {
            return Err(body.expected(0, "an array of numbers"));
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
        if let Some(default) = self.device {
            let device = if tensor.device().is_empty() { default } else { tensor.device() };
            parts.push(Part::Text(device.to_owned()));
        }
        Ok(parts)
    }
}
