//! Tensors of candle, on the device that the label names: the feature `candle`.
//!
//! ```text
//!   Tensor { device: "cuda:0", … } ── to_candle ──▶ candle_core::Tensor on CUDA device 0
//!   (label as the device map left it)               (a CPU, where the label says so or is empty)
//! ```
//!
//! Candle runs on CUDA devices where it is built with `candle-cuda`; any other label is an error,
//! never a silent CPU.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use candle_core::{DType, Device, DeviceLocation};
use half::{bf16, f16};

use super::dtype::Dtype;
use super::element::Element;
use super::tensor::Tensor;

/// Error of converting between a tensor and candle's.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::types; }
/// use wrapyfi_core::types::{CandleError, Dtype};
/// let error = CandleError::Dtype(Dtype::Bool).to_string();
/// assert!(error.starts_with("candle has no bool tensors; it has "), "{error}");
/// ```
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CandleError {
    /// Candle has no such elements.
    #[error("candle has no {0} tensors; it has {known}", known = names(CANDLE_DTYPES))]
    Dtype(Dtype),
    /// No type here has such elements.
    #[error(
        "a candle tensor of {0:?}, which no type here holds; convert it first, for instance to F32"
    )]
    Foreign(DType),
    /// The label is no device of candle, as built.
    #[error(
        "the device {label:?} is not available: {reason}; map it with load_<library>_device or map_<library>_devices"
    )]
    Device {
        /// Label of the tensor.
        label: String,
        /// Cause.
        reason: String,
    },
    /// The product of the extents is larger than any memory, beside an extent of 0.
    #[error("candle cannot hold the empty shape {0:?}: its extents overflow")]
    Shape(Vec<usize>),
    /// Candle refused, for instance because the device is out of memory.
    #[error("candle: {0}")]
    Candle(#[from] candle_core::Error),
}

/// Element types that both [`Tensor`] and candle have.
const CANDLE_DTYPES: [Dtype; 9] = [
    Dtype::U8,
    Dtype::U32,
    Dtype::I16,
    Dtype::I32,
    Dtype::I64,
    Dtype::BF16,
    Dtype::F16,
    Dtype::F32,
    Dtype::F64,
];

fn names(dtypes: [Dtype; 9]) -> String {
    dtypes.map(Dtype::name).join(", ")
}

impl Tensor {
    /// Converts to candle's tensor, on the device of the label: `cpu`, `cpu:0` or none for the CPU;
    /// `cuda`, `cuda:1`, `gpu:1` for CUDA devices. The elements are copied once.
    ///
    /// # Errors
    /// When candle has no such elements, or no such device as built.
    pub fn to_candle(&self) -> Result<candle_core::Tensor, CandleError> {
        self.to_candle_on(&device_of(self.device())?)
    }

    /// As [`Tensor::to_candle`], on a device that the caller chose, whatever the label says.
    ///
    /// # Errors
    /// When candle has no such elements, or the device refuses.
    pub fn to_candle_on(&self, device: &Device) -> Result<candle_core::Tensor, CandleError> {
        let extents = self.shape.iter().map(|&extent| extent.max(1));
        if extents.clone().try_fold(1_usize, usize::checked_mul).is_none() {
            return Err(CandleError::Shape(self.shape.clone()));
        }
        match self.dtype {
            Dtype::U8 => self.upload::<u8>(device),
            Dtype::U32 => self.upload::<u32>(device),
            Dtype::I16 => self.upload::<i16>(device),
            Dtype::I32 => self.upload::<i32>(device),
            Dtype::I64 => self.upload::<i64>(device),
            Dtype::BF16 => self.upload::<bf16>(device),
            Dtype::F16 => self.upload::<f16>(device),
            Dtype::F32 => self.upload::<f32>(device),
            Dtype::F64 => self.upload::<f64>(device),
            dtype => Err(CandleError::Dtype(dtype)),
        }
    }

    fn upload<T: Element + candle_core::WithDType>(
        &self,
        device: &Device,
    ) -> Result<candle_core::Tensor, CandleError> {
        let shape = self.shape.as_slice();
        Ok(match self.as_slice::<T>() {
            Some(elements) => candle_core::Tensor::from_slice(elements, shape, device)?,
            None => {
                let elements = self.to_vec::<T>().ok_or(CandleError::Dtype(self.dtype))?;
                candle_core::Tensor::from_vec(elements, shape, device)?
            }
        })
    }

    /// Converts candle's tensor: elements are copied into row-major order, and labelled with their
    /// device. The tensor belongs to no library yet: see [`Tensor::with_origin`].
    ///
    /// # Errors
    /// When no type here holds the elements, or candle cannot copy them.
    pub fn from_candle(tensor: &candle_core::Tensor) -> Result<Self, CandleError> {
        let label = match tensor.device().location() {
            DeviceLocation::Cpu => "cpu".to_owned(),
            DeviceLocation::Cuda { gpu_id } => format!("cuda:{gpu_id}"),
            DeviceLocation::Metal { gpu_id } => format!("mps:{gpu_id}"),
        };
        let copied = match tensor.dtype() {
            DType::U8 => download::<u8>(tensor),
            DType::U32 => download::<u32>(tensor),
            DType::I16 => download::<i16>(tensor),
            DType::I32 => download::<i32>(tensor),
            DType::I64 => download::<i64>(tensor),
            DType::BF16 => download::<bf16>(tensor),
            DType::F16 => download::<f16>(tensor),
            DType::F32 => download::<f32>(tensor),
            DType::F64 => download::<f64>(tensor),
            dtype => Err(CandleError::Foreign(dtype)),
        };
        Ok(copied?.with_device(label))
    }
}

fn download<T: Element + candle_core::WithDType>(
    tensor: &candle_core::Tensor,
) -> Result<Tensor, CandleError> {
    let elements = tensor.flatten_all()?.to_vec1::<T>()?;
    let misfit = |error: super::ShapeError| candle_core::Error::Msg(error.to_string());
    Ok(Tensor::from_elements(tensor.dims(), elements).map_err(misfit)?)
}

/// Device that a label names.
fn device_of(label: &str) -> Result<Device, CandleError> {
    let refused = |reason: &str| CandleError::Device {
        label: label.chars().take(64).collect(),
        reason: reason.to_owned(),
    };
    let (kind, index) = label.split_once(':').unwrap_or((label, "0"));
    let index: usize =
        index.parse().map_err(|error| refused(&format!("its index is no number ({error})")))?;
    match kind {
        "" | "cpu" => Ok(Device::Cpu),
        "cuda" | "gpu" => {
            cuda(index).map_err(|error| refused(error.to_string().lines().next().unwrap_or("")))
        }
        "mps" | "metal" => Err(refused("Metal is not supported")),
        _ => Err(refused("candle knows cpu and cuda")),
    }
}

/// CUDA device of this index, always the same object, because candle refuses operations across two.
fn cuda(index: usize) -> Result<Device, candle_core::Error> {
    static OPEN: Mutex<BTreeMap<usize, Device>> = Mutex::new(BTreeMap::new());
    if !cfg!(feature = "candle-cuda") {
        return Err(candle_core::Error::Msg("built without CUDA, the feature candle-cuda".into()));
    }
    let mut open = OPEN.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(device) = open.get(&index) {
        return Ok(device.clone());
    }
    let device = Device::new_cuda(index)?;
    open.insert(index, device.clone());
    Ok(device)
}
