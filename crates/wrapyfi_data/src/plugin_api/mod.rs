//! Interface between codecs and plug-ins: the trait, the set of plug-ins, the parts of an object, devices.
//!
//! Plug-ins of Wrapyfi's own keys read and write with codecs, and codecs know plug-ins by this interface: it
//! is a module of its own, below both, and [`crate::plugin`] shows it to users.

mod body;
mod devices;
mod error;
mod framework;
mod plugin;
mod set;

pub use body::{Body, Part};
pub use devices::{DeviceMap, DeviceMaps, DeviceOption};
pub use error::PluginError;
pub use framework::{DeviceError, Framework};
pub use plugin::{Plugin, Unpacking};
pub use set::Plugins;

pub(crate) use body::Element;
pub(crate) use error::malformed;
