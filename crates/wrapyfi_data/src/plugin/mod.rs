//! Interface between codecs and plug-ins: the trait, the set of plug-ins, the parts of an object, devices.
//!
//! ```text
//!   {"__wrapyfi__": [key, part, part, …]}
//!                     │    └────┴─ Body ──▶ Plugin::decode ──▶ Value
//!                     └ Plugins: key ─▶ plug-in               (refused: Tagged, carried intact)
//!
//!   Value ── plugin_key ──▶ Plugin::encode ──▶ [Part, …] ──▶ the same text
//! ```
//!
//! Codecs know plug-ins by this interface alone. Those of Wrapyfi's own keys are in the crate `wrapyfi_plugins`, above this
//! one, because they read and write with codecs.

mod body;
mod devices;
mod error;
mod framework;
mod interface;
mod set;

pub use body::{Body, Part};
pub use devices::{DeviceMap, DeviceMaps, DeviceOption};
pub use error::PluginError;
pub use framework::{DeviceError, Framework};
pub use interface::{Plugin, Unpacking};
pub use set::Plugins;

pub(crate) use body::Element;
