//! Libraries whose tensors have a device on the wire, and the spelling of each one's devices.

use wrapyfi_interfaces::named;

named! {
    /// A library whose tensors have a device on the wire.
    ///
    /// ```
    /// use wrapyfi_data::plugin::Framework;
    /// assert_eq!(Framework::Torch.key(), "PytorchTensor");
    /// assert_eq!(Framework::Paddle.map_option(), "map_paddle_devices");
    /// assert_eq!(Framework::Paddle.spell("cuda:0"), "gpu:0");
    /// ```
    #[derive(PartialOrd, Ord)]
    pub enum Framework {
        /// PyTorch: `cpu`, `cuda:0`.
        Torch => "torch",
        /// MXNet: `cpu:0`, `cuda:0` (it says `gpu` itself, Wrapyfi's wire does not).
        MxNet => "mxnet",
        /// PaddlePaddle: `cpu`, `gpu:0`.
        Paddle => "paddle",
        /// CuPy: `cuda:0`, never a CPU.
        CuPy => "cupy",
    }
    /// Word for the library in the names of its options: `torch` in `load_torch_device`.
    pub fn name;
}

impl Framework {
    /// Key of the library's plug-in.
    pub fn key(self) -> &'static str {
        match self {
            Self::Torch => "PytorchTensor",
            Self::MxNet => "MXNetTensor",
            Self::Paddle => "PaddleTensor",
            Self::CuPy => "CuPyArray",
        }
    }

    /// Name of the option for the device of tensors that the map does not name.
    pub fn load_option(self) -> String {
        format!("load_{}_device", self.name())
    }

    /// Name of the option that maps devices to devices.
    pub fn map_option(self) -> String {
        format!("map_{}_devices", self.name())
    }

    /// Kinds of devices that the library knows, as they stand on its wire.
    fn kinds(self) -> &'static [&'static str] {
        match self {
            Self::Torch => &["cpu", "cuda", "mps", "xpu", "xla", "hpu", "npu", "mkldnn", "meta"],
            Self::MxNet => &["cpu", "cuda", "cpu_pinned", "cpu_shared"],
            Self::Paddle => &["cpu", "gpu", "gpu_pinned", "xpu", "npu", "mlu", "ipu"],
            Self::CuPy => &["cuda"],
        }
    }

    /// Spells `device` as this library's wire does: `gpu` and `cuda` are one word.
    pub fn spell(self, device: &str) -> String {
        match self {
            Self::Paddle => device.replace("cuda", "gpu"),
            Self::Torch | Self::MxNet | Self::CuPy => device.replace("gpu", "cuda"),
        }
    }

    /// Label of a tensor on `device`, as this library's wire has it; `default` where it has none.
    pub fn label(self, device: &str, default: &str) -> String {
        self.spell(if device.is_empty() { default } else { device })
    }

    /// Reads a device in an option, checked and spelled as on the wire.
    pub(super) fn read(self, option: &str, device: &str) -> Result<String, DeviceError> {
        let mut spelled = self.spell(device);
        if self == Self::CuPy && is_number(&spelled) {
            spelled = format!("cuda:{spelled}");
        }
        let (kind, index) = match spelled.split_once(':') {
            Some((kind, index)) => (kind, Some(index)),
            None => (&*spelled, None),
        };
        if self == Self::CuPy && kind == "cpu" {
            return Err(DeviceError::NoCpu(option.into()));
        }
        let complete = index.is_some_and(is_number) || (index.is_none() && self != Self::CuPy);
        if complete && self.kinds().contains(&kind) {
            return Ok(spelled);
        }
        Err(DeviceError::UnknownDevice {
            option: option.into(),
            device: device.chars().take(64).collect(),
            kinds: self.kinds().join(", "),
            example: if self == Self::Paddle { "gpu:0" } else { "cuda:0" },
        })
    }
}

/// True for the index of a device.
fn is_number(text: &str) -> bool {
    (1..=5).contains(&text.len()) && text.bytes().all(|digit| digit.is_ascii_digit())
}

/// Error of options about devices.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::plugin; }
/// use wrapyfi_core::plugin::{DeviceMaps, DeviceOption};
/// let cpu = ("load_cupy_device", DeviceOption::Load("cpu".into()));
/// let error = DeviceMaps::from_options([cpu]).unwrap_err();
/// assert!(error.to_string().starts_with("load_cupy_device: CuPy has no CPU arrays; "), "{error}");
/// ```
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum DeviceError {
    /// The option belongs to no library that has devices.
    #[error("unknown option {option:?}; {hint}options: {known}")]
    UnknownOption {
        /// Name of the option.
        option: String,
        /// `did you mean …? ` with the nearest option, or nothing.
        hint: String,
        /// Names of all options.
        known: String,
    },
    /// The option has one device where it takes a map, or the other way round.
    #[error("{option} should be {wanted}")]
    WrongForm {
        /// Name of the option.
        option: String,
        /// Values that the option takes.
        wanted: &'static str,
    },
    /// A device that the library does not know.
    #[error(
        "{option}: {device:?} is no device of this library; write one of {kinds}, with an index where there are several, for instance {example:?}"
    )]
    UnknownDevice {
        /// Name of the option.
        option: String,
        /// Device that the option names.
        device: String,
        /// Kinds of devices that the library knows.
        kinds: String,
        /// Example of a device.
        example: &'static str,
    },
    /// The target is a CPU, and arrays of the library live on CUDA devices only.
    #[error("{0}: CuPy has no CPU arrays; write a CUDA device, for instance \"cuda:0\"")]
    NoCpu(String),
    /// Two entries give a device different targets.
    #[error("{option}: {device} goes to {first} and to {second}; leave one out")]
    Clash {
        /// Names of the options.
        option: String,
        /// Device that has two targets.
        device: String,
        /// Target in the first entry.
        first: String,
        /// Target in the second entry.
        second: String,
    },
}
