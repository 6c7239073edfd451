//! The key `devices`: Wrapyfi's options about devices, by their names there.
//!
//! ```text
//!   devices: { load_torch_device: cpu, map_paddle_devices: { "gpu:0": cpu } }  ──▶  DeviceMaps
//! ```

use std::collections::BTreeMap;
use std::fmt;

use serde::de::{self, Visitor};
use serde::{Deserialize, Deserializer};
use serde_saphyr::{Location, Spanned};

use wrapyfi_data::plugin::{DeviceMaps, DeviceOption};
use wrapyfi_endpoint::config::Problem;

/// A device by its name, or by its number alone where a library has one kind (CuPy).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DeviceWord(pub String);

/// Devices by the device that a tensor comes from.
type DeviceTable = BTreeMap<String, DeviceWord>;

macro_rules! options {
    ($($load:ident, $map:ident;)*) => {
        /// Options about devices; [`wrapyfi_data::plugin::DeviceMap`] explains them.
        #[derive(Debug, Clone, Default, Deserialize)]
        #[serde(deny_unknown_fields, default)]
        #[allow(missing_docs)] // the names are the documentation
        pub struct DevicesConfig {
            $(
                pub $load: Option<Spanned<DeviceWord>>,
                pub $map: Option<Spanned<DeviceTable>>,
            )*
        }

        impl DevicesConfig {
            /// Options that are given, by name, and the place of the first.
            fn options(&self) -> (Vec<(&'static str, DeviceOption)>, Option<Location>) {
                let mut options = Vec::new();
                let mut place = None;
                $(
                    if let Some(load) = &self.$load {
                        place.get_or_insert(load.referenced);
                        options.push((stringify!($load), DeviceOption::Load(load.value.0.clone())));
                    }
                    if let Some(map) = &self.$map {
                        place.get_or_insert(map.referenced);
                        let entries = map.value.iter().map(|(from, to)| (from.clone(), to.0.clone()));
                        options.push((stringify!($map), DeviceOption::Map(entries.collect())));
                    }
                )*
                (options, place)
            }
        }
    };
}

options! {
    load_torch_device, map_torch_devices;
    load_mxnet_device, map_mxnet_devices;
    load_paddle_device, map_paddle_devices;
    load_cupy_device, map_cupy_devices;
}

impl DevicesConfig {
    /// Makes maps of the options; a fault is at the first option, or at `section` without one.
    pub(super) fn maps(&self, section: Location) -> Result<DeviceMaps, Problem> {
        let (options, place) = self.options();
        DeviceMaps::from_options(options)
            .map_err(|error| Problem::at(place.unwrap_or(section), error.to_string()))
    }
}

impl<'de> Deserialize<'de> for DeviceWord {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Word;
        impl Visitor<'_> for Word {
            type Value = DeviceWord;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a device, for instance cuda:0")
            }

            fn visit_str<E: de::Error>(self, word: &str) -> Result<DeviceWord, E> {
                Ok(DeviceWord(word.to_owned()))
            }

            fn visit_u64<E: de::Error>(self, index: u64) -> Result<DeviceWord, E> {
                Ok(DeviceWord(index.to_string()))
            }

            fn visit_i64<E: de::Error>(self, index: i64) -> Result<DeviceWord, E> {
                Ok(DeviceWord(index.to_string()))
            }
        }
        deserializer.deserialize_any(Word)
    }
}
