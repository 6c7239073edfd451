//! `PytorchTensor`: a `torch.save` file and the device.
//!
//! ```text
//!   ["PytorchTensor", base64 of a zip, "cuda:0"]
//!                                │
//!      archive/data.pkl ─────────┤ pickle: which storage, offset, size, stride   (read as data)
//!      archive/data/0   ─────────┤ the storage's bytes ──▶ shared, or gathered by the strides
//!      archive/byteorder ────────┘ little or big
//! ```
//!
//! | attribute of the origin | meaning |
//! | --- | --- |
//! | `requires_grad` = `true` | the tensor takes part in learning |
//! | `parameter` = `true` | it is a `torch.nn.Parameter` |
//!
//! Strides are not kept: every tensor becomes row-major.

mod read;
mod write;

use super::{Body, Framework, Part, Plugin, PluginError, Unpacking};
use wrapyfi_data::types::{Dtype, Value};

/// PyTorch's tensors and parameters.
pub(super) struct Torch;

/// The one name that torch gives the folder in the archive when it saves to memory.
const FOLDER: &str = "archive";

/// Element types that have a storage class of their own, as every torch reads them.
const STORAGES: [(&str, Dtype); 12] = [
    ("BFloat16Storage", Dtype::BF16),
    ("BoolStorage", Dtype::Bool),
    ("ByteStorage", Dtype::U8),
    ("CharStorage", Dtype::I8),
    ("ComplexDoubleStorage", Dtype::C128),
    ("ComplexFloatStorage", Dtype::C64),
    ("DoubleStorage", Dtype::F64),
    ("FloatStorage", Dtype::F32),
    ("HalfStorage", Dtype::F16),
    ("IntStorage", Dtype::I32),
    ("LongStorage", Dtype::I64),
    ("ShortStorage", Dtype::I16),
];

/// Element types that torch names beside an untyped storage, since torch 2.3.
const NAMED: [(&str, Dtype); 3] =
    [("uint16", Dtype::U16), ("uint32", Dtype::U32), ("uint64", Dtype::U64)];

impl Plugin for Torch {
    fn key(&self) -> &str {
        Framework::Torch.key()
    }

    fn decode(&self, body: &Body<'_>, context: &Unpacking<'_>) -> Result<Value, PluginError> {
        let tensor = read::tensor(&body.base64(0)?, context)?;
        Ok(tensor.with_device(body.text(1)?).into())
    }

    fn encode(&self, value: &Value) -> Result<Vec<Part>, PluginError> {
        let tensor = value.as_tensor().ok_or_else(|| PluginError::not_mine("tensor", value))?;
        let device = Framework::Torch.label(tensor.device(), "cpu");
        let file = write::file(tensor, &device)?;
        Ok(vec![Part::base64(file), Part::Text(device)])
    }
}
