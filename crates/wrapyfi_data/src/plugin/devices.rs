//! Devices for received tensors: Wrapyfi's `load_<library>_device` and `map_<library>_devices`.
//!
//! ```text
//!   "cuda:0" on the wire ──▶ map["cuda:0"], else the default ──▶ label of the decoded tensor
//!                            (neither: it stays "cuda:0")          │
//!                                                                  └ with the feature `candle`:
//!                                                                    Tensor::to_candle puts it there
//! ```
//!
//! The rules are those of Wrapyfi's plug-ins, except that Wrapyfi lets `load_…_device` overwrite
//! the entry `default` of a map silently; here that is an error.

use std::collections::BTreeMap;
use std::fmt;

use super::framework::{DeviceError, Framework};

/// Map from the device labels of one library's tensors to the devices here.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DeviceMap {
    framework: Framework,
    default: Option<String>,
    devices: BTreeMap<String, String>,
}

impl DeviceMap {
    /// Makes a map of `load_<library>_device` and `map_<library>_devices`. The entry `default` of
    /// the map has the meaning of `load`.
    ///
    /// ```
    /// use wrapyfi_data::plugin::{DeviceMap, Framework};
    /// let map = DeviceMap::new(Framework::Torch, Some("cuda:0"), [("cuda:0", "cpu")])?;
    /// assert_eq!(map.target("cuda:0"), Some("cpu"));
    /// assert_eq!(map.target("cuda:1"), Some("cuda:0"));
    /// # Ok::<(), wrapyfi_data::plugin::DeviceError>(())
    /// ```
    ///
    /// # Errors
    /// When a device is unknown to the library, or two entries clash.
    pub fn new<'a>(
        framework: Framework,
        load: Option<&str>,
        map: impl IntoIterator<Item = (&'a str, &'a str)>,
    ) -> Result<Self, DeviceError> {
        let (load_option, map_option) = (framework.load_option(), framework.map_option());
        let clash = |option: &str, device: &str, first: &str, second: &str| DeviceError::Clash {
            option: option.to_owned(),
            device: device.to_owned(),
            first: first.to_owned(),
            second: second.to_owned(),
        };
        let mut default = load.map(|device| framework.read(&load_option, device)).transpose()?;
        let mut devices = BTreeMap::<String, String>::new();
        for (from, to) in map {
            let target = framework.read(&map_option, to)?;
            if from == "default" {
                match &default {
                    Some(first) if *first != target => {
                        let option = format!("{load_option} and {map_option}");
                        return Err(clash(&option, "default", first, &target));
                    }
                    _ => default = Some(target),
                }
                continue;
            }
            // CuPy's arrays may come from nowhere else, but its wire is not checked for that.
            let from = framework.read(&map_option, from)?;
            if let Some(first) = devices.get(&from).filter(|first| **first != target) {
                return Err(clash(&map_option, &from, first, &target));
            }
            devices.insert(from, target);
        }
        if framework == Framework::CuPy && default.is_none() {
            default = Some("cuda:0".to_owned());
        }
        Ok(Self { framework, default, devices })
    }

    /// Device for a tensor labelled `device`; `None` where it keeps its label.
    pub fn target(&self, device: &str) -> Option<&str> {
        let named = match self.devices.get(device) {
            // Labels are spelled right by Wrapyfi, but not by every sender.
            None if !self.devices.is_empty() => self.devices.get(&self.framework.spell(device)),
            found => found,
        };
        named.or(self.default.as_ref()).map(String::as_str)
    }
}

/// An option about devices, as a script passes it to Wrapyfi's `register`.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::plugin; }
/// use wrapyfi_core::plugin::{DeviceMaps, DeviceOption};
/// let map = DeviceOption::Map(vec![("cuda:0".into(), "cpu".into())]);
/// let maps = DeviceMaps::from_options([("map_torch_devices", map)])?;
/// assert_eq!(maps.target("PytorchTensor", "cuda:0"), Some("cpu"));
/// # Ok::<(), wrapyfi_data::plugin::DeviceError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum DeviceOption {
    /// Value of `load_<library>_device`.
    Load(String),
    /// Value of `map_<library>_devices`.
    Map(Vec<(String, String)>),
}

/// Device maps of all libraries.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::plugin; }
/// use wrapyfi_core::plugin::{DeviceMaps, DeviceOption, Plugins};
/// let maps = DeviceMaps::from_options([
///     ("load_torch_device", DeviceOption::Load("cpu".into())),
///     ("map_paddle_devices", DeviceOption::Map(vec![("gpu:0".into(), "cpu".into())])),
/// ])?;
/// assert_eq!(maps.target("PytorchTensor", "cuda:0"), Some("cpu"));
/// assert_eq!(maps.target("PaddleTensor", "gpu:1"), None);
/// let plugins = Plugins::none().with_devices(maps);
/// # let _ = plugins;
/// # Ok::<(), wrapyfi_data::plugin::DeviceError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct DeviceMaps(BTreeMap<Framework, DeviceMap>);

impl DeviceMaps {
    /// Makes maps of options with Wrapyfi's names.
    ///
    /// # Errors
    /// When an option or a device is unknown, or two entries clash.
    pub fn from_options<'a>(
        options: impl IntoIterator<Item = (&'a str, DeviceOption)>,
    ) -> Result<Self, DeviceError> {
        let mut loads = BTreeMap::<Framework, String>::new();
        let mut maps = BTreeMap::<Framework, Vec<(String, String)>>::new();
        for (name, value) in options {
            let of = |spell: fn(Framework) -> String| {
                Framework::ALL.into_iter().find(|&framework| spell(framework) == name)
            };
            match (of(Framework::load_option), of(Framework::map_option), value) {
                (Some(framework), _, DeviceOption::Load(device)) => {
                    loads.insert(framework, device);
                }
                (_, Some(framework), DeviceOption::Map(devices)) => {
                    maps.entry(framework).or_default().extend(devices);
                }
                (None, None, _) => return Err(unknown_option(name)),
                (load, ..) => {
                    let wanted =
                        if load.is_some() { "one device" } else { "a map of devices to devices" };
                    return Err(DeviceError::WrongForm { option: name.to_owned(), wanted });
                }
            }
        }
        let mut all = Self::default();
        for framework in Framework::ALL {
            let load = loads.get(&framework).map(String::as_str);
            let map = maps.get(&framework);
            if load.is_some() || map.is_some() {
                let entries = map.into_iter().flatten().map(|(from, to)| (&**from, &**to));
                all = all.with(DeviceMap::new(framework, load, entries)?);
            }
        }
        Ok(all)
    }

    /// Adds `map`, which replaces the one of its library.
    #[doc(hidden)]
    #[must_use]
    pub fn with(mut self, map: DeviceMap) -> Self {
        self.0.insert(map.framework, map);
        self
    }

    /// Adds the maps of `other`, which replace those of the same libraries.
    #[must_use]
    pub fn or_from(mut self, other: &Self) -> Self {
        for (framework, map) in &other.0 {
            self.0.entry(*framework).or_insert_with(|| map.clone());
        }
        self
    }

    /// True when there are no maps, so that every tensor keeps its label.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Maps of all libraries.
    #[doc(hidden)]
    pub fn iter(&self) -> impl Iterator<Item = &DeviceMap> {
        self.0.values()
    }

    /// Device for a tensor of the plug-in `key` labelled `device`; `None` where it keeps its label.
    pub fn target(&self, key: &str, device: &str) -> Option<&str> {
        let framework = Framework::ALL.into_iter().find(|framework| framework.key() == key)?;
        self.0.get(&framework)?.target(device)
    }
}

impl fmt::Display for DeviceMaps {
    /// Writes the maps for tables: `torch cpu->cuda:0 *->cpu`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, map) in self.iter().enumerate() {
            let separator = if index > 0 { ", " } else { "" };
            write!(f, "{separator}{}", map.framework.name())?;
            for (from, to) in &map.devices {
                write!(f, " {from}->{to}")?;
            }
            if let Some(default) = &map.default {
                write!(f, " *->{default}")?;
            }
        }
        Ok(())
    }
}

fn unknown_option(option: &str) -> DeviceError {
    let known: Vec<String> = Framework::ALL
        .into_iter()
        .flat_map(|framework| [framework.load_option(), framework.map_option()])
        .collect();
    DeviceError::UnknownOption {
        option: option.chars().take(64).collect(),
        hint: crate::did_you_mean(option, &known),
        known: known.join(", "),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(
        framework: Framework,
        load: Option<&str>,
        map: &[(&str, &str)],
    ) -> Result<DeviceMap, DeviceError> {
        DeviceMap::new(framework, load, map.iter().copied())
    }

    #[test]
    fn a_named_device_goes_before_the_default() {
        let torch =
            map(Framework::Torch, Some("cuda:0"), &[("cpu", "cuda:0"), ("cuda:0", "cpu")]).unwrap();
        assert_eq!(torch.target("cpu"), Some("cuda:0"));
        assert_eq!(torch.target("cuda:0"), Some("cpu"));
        assert_eq!(torch.target("cuda:1"), Some("cuda:0"));
        let torch = map(Framework::Torch, None, &[("cuda:0", "cpu")]).unwrap();
        assert_eq!(torch.target("cuda:1"), None);
        let torch = map(Framework::Torch, None, &[("default", "cpu")]).unwrap();
        assert_eq!(torch.target("cuda:1"), Some("cpu"));
    }

    #[test]
    fn gpu_and_cuda_are_one_word() {
        // As in Wrapyfi's own example for Paddle.
        let paddle =
            map(Framework::Paddle, Some("gpu:0"), &[("cpu", "cuda:0"), ("gpu:0", "cpu")]).unwrap();
        assert_eq!(paddle.target("cpu"), Some("gpu:0"));
        assert_eq!(paddle.target("cuda:0"), Some("cpu"));
        let mxnet = map(Framework::MxNet, None, &[("gpu:0", "cpu"), ("cpu:0", "gpu:1")]).unwrap();
        assert_eq!(mxnet.target("cuda:0"), Some("cpu"));
        assert_eq!(mxnet.target("cpu:0"), Some("cuda:1"));
    }

    #[test]
    fn cupy_lands_on_the_first_gpu_and_never_on_a_cpu() {
        let cupy = map(Framework::CuPy, None, &[("cuda:1", "cuda:2")]).unwrap();
        assert_eq!(cupy.target("cuda:1"), Some("cuda:2"));
        assert_eq!(cupy.target("cuda:5"), Some("cuda:0"));
        assert_eq!(map(Framework::CuPy, Some("3"), &[]).unwrap().target("cuda:0"), Some("cuda:3"));
        for cpu in ["cpu", "cpu:0"] {
            let error = map(Framework::CuPy, Some(cpu), &[]).unwrap_err();
            assert!(matches!(error, DeviceError::NoCpu { .. }), "{error}");
        }
    }

    #[test]
    fn clashes_are_errors() {
        let error = map(Framework::Torch, Some("cuda:0"), &[("default", "cpu")]).unwrap_err();
        assert_eq!(
            error.to_string(),
            "load_torch_device and map_torch_devices: default goes to cuda:0 and to cpu; leave one out"
        );
        assert!(map(Framework::Torch, Some("cpu"), &[("default", "cpu")]).is_ok());
        let error = map(Framework::MxNet, None, &[("gpu:0", "cpu"), ("cuda:0", "gpu:1")]);
        assert!(matches!(error, Err(DeviceError::Clash { device, .. }) if device == "cuda:0"));
    }

    #[test]
    fn what_is_unknown_is_named_with_the_nearest() {
        for wrong in ["", "cud:0", "cuda:x", "cuda:0:1", "cuda:", "cuda:123456", ":0", "CPU"] {
            let error = map(Framework::Torch, Some(wrong), &[]).unwrap_err();
            assert!(matches!(error, DeviceError::UnknownDevice { .. }), "{wrong:?}: {error}");
        }
        let load = |name| DeviceMaps::from_options([(name, DeviceOption::Load("cpu".into()))]);
        let error = load("load_toch_device").unwrap_err().to_string();
        assert!(error.contains("did you mean `load_torch_device`?"), "{error}");
        assert!(matches!(load("load_jax_device"), Err(DeviceError::UnknownOption { .. })));
        assert!(matches!(load("map_torch_devices"), Err(DeviceError::WrongForm { .. })));
    }

    #[test]
    fn maps_of_a_route_replace_those_of_their_library() {
        let of = |framework, load| map(framework, Some(load), &[]).unwrap();
        let defaults = DeviceMaps::default()
            .with(of(Framework::Torch, "cuda:0"))
            .with(of(Framework::Paddle, "cpu"));
        let route = DeviceMaps::default().with(of(Framework::Torch, "cpu")).or_from(&defaults);
        assert_eq!(route.target("PytorchTensor", "cuda:3"), Some("cpu"));
        assert_eq!(route.target("PaddleTensor", "gpu:0"), Some("cpu"));
        assert_eq!(route.target("JAXTensor", ""), None);
        assert_eq!(route.to_string(), "torch *->cpu, paddle *->cpu");
    }
}
