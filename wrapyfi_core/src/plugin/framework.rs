//! The libraries whose tensors have a device on the wire, and how each one spells it.

/// A library whose tensors say on the wire where they are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Framework {
    /// PyTorch: `cpu`, `cuda:0`.
    Torch,
    /// MXNet: `cpu:0`, `cuda:0` (it says `gpu` itself, Wrapyfi's wire does not).
    MxNet,
    /// PaddlePaddle: `cpu`, `gpu:0`.
    Paddle,
    /// CuPy: `cuda:0`, never a CPU.
    CuPy,
}

impl Framework {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Torch, Self::MxNet, Self::Paddle, Self::CuPy];

    /// The word in the names of its options: `torch` in `load_torch_device`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Torch => "torch",
            Self::MxNet => "mxnet",
            Self::Paddle => "paddle",
            Self::CuPy => "cupy",
        }
    }

    /// Key of its plug-in.
    #[must_use]
    pub fn key(self) -> &'static str {
        match self {
            Self::Torch => "PytorchTensor",
            Self::MxNet => "MXNetTensor",
            Self::Paddle => "PaddleTensor",
            Self::CuPy => "CuPyArray",
        }
    }

    /// Name of the option that says where tensors go unless the map says otherwise.
    #[must_use]
    pub fn load_option(self) -> String {
        format!("load_{}_device", self.name())
    }

    /// Name of the option that says where tensors of each device go.
    #[must_use]
    pub fn map_option(self) -> String {
        format!("map_{}_devices", self.name())
    }

    /// Kinds of devices it knows, as they stand on its wire.
    fn kinds(self) -> &'static [&'static str] {
        match self {
            Self::Torch => &["cpu", "cuda", "mps", "xpu", "xla", "hpu", "npu", "mkldnn", "meta"],
            Self::MxNet => &["cpu", "cuda", "cpu_pinned", "cpu_shared"],
            Self::Paddle => &["cpu", "gpu", "gpu_pinned", "xpu", "npu", "mlu", "ipu"],
            Self::CuPy => &["cuda"],
        }
    }

    /// `device` as this library's wire spells it: `gpu` and `cuda` are one word.
    #[must_use]
    pub fn spell(self, device: &str) -> String {
        match self {
            Self::Paddle => device.replace("cuda", "gpu"),
            Self::Torch | Self::MxNet | Self::CuPy => device.replace("gpu", "cuda"),
        }
    }

    /// Label of a tensor on `device`, as this library's wire has it; `default` where it has none.
    pub(super) fn label(self, device: &str, default: &str) -> String {
        self.spell(if device.is_empty() { default } else { device })
    }

    /// A device in an option, checked and spelled as on the wire.
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
            return Err(DeviceError::NoCpu { option: option.into() });
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

/// Why options about devices are refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum DeviceError {
    /// No option of a library that has devices.
    #[error("unknown option {option:?}; {hint}options: {known}")]
    UnknownOption {
        /// Its name.
        option: String,
        /// The nearest one, or nothing.
        hint: String,
        /// All there are.
        known: String,
    },
    /// A name where devices by name belong, or the other way round.
    #[error("{option} should be {wanted}")]
    WrongForm {
        /// The option.
        option: String,
        /// What it takes.
        wanted: &'static str,
    },
    /// A device that the library does not know.
    #[error(
        "{option}: {device:?} is no device of this library; write one of {kinds}, with an index where there are several, for instance {example:?}"
    )]
    UnknownDevice {
        /// The option.
        option: String,
        /// What it says.
        device: String,
        /// The kinds there are.
        kinds: String,
        /// A device as it should be written.
        example: &'static str,
    },
    /// A CPU as target of an array that lives on CUDA devices only.
    #[error("{option}: CuPy has no CPU arrays; write a CUDA device, for instance \"cuda:0\"")]
    NoCpu {
        /// The option.
        option: String,
    },
    /// Two entries that answer the same question differently.
    #[error("{option}: {device} goes to {first} and to {second}; leave one out")]
    Clash {
        /// The options.
        option: String,
        /// The device that has two targets.
        device: String,
        /// One target.
        first: String,
        /// The other.
        second: String,
    },
}
