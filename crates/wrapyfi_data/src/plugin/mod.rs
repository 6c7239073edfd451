//! Plug-ins, which read and write the objects behind Wrapyfi's plug-in keys.
//!
//! ```text
//!   {"__wrapyfi__": [key, part, part, …]}
//!                     │    └────┴─ Body ──▶ Plugin::decode ──▶ Value
//!                     └ Plugins: key ─▶ plug-in               (refused: Tagged, carried intact)
//!
//!   Value ── plugin_key ──▶ Plugin::encode ──▶ [Part, …] ──▶ the same text
//! ```
//!
//! [`Plugins::standard`] has every key of Wrapyfi's own table (`docs/reference/wire/plugins.md`). A crate of
//! the user adds one by implementing [`Plugin`]:
//!
//! ```
//! # mod wrapyfi_core { pub use wrapyfi_data::{Limits, codec, plugin, types}; }
//! use wrapyfi_core::Limits;
//! use wrapyfi_core::codec::json;
//! use wrapyfi_core::plugin::{Body, Part, Plugin, PluginError, Plugins, Unpacking};
//! use wrapyfi_core::types::{ForeignObject, PluginObject, Value};
//!
//! #[derive(Debug, Clone, PartialEq)]
//! struct Pose { x: f64, y: f64 }
//! impl PluginObject for Pose {
//!     fn key(&self) -> &str { "Pose2D" }
//! }
//!
//! struct Pose2D;
//! impl Plugin for Pose2D {
//!     fn key(&self) -> &str { "Pose2D" }
//!     fn decode(&self, body: &Body<'_>, _: &Unpacking<'_>) -> Result<Value, PluginError> {
//!         let number = |part| body.value(part)?.as_f64().ok_or_else(|| body.expected(part, "a number"));
//!         Ok(ForeignObject::new(Pose { x: number(0)?, y: number(1)? }).into())
//!     }
//!     fn encode(&self, value: &Value) -> Result<Vec<Part>, PluginError> {
//!         let pose = value.as_object::<Pose>().ok_or_else(|| PluginError::not_mine("Pose", value))?;
//!         Ok(vec![Part::Value(pose.x.into()), Part::Value(pose.y.into())])
//!     }
//! }
//!
//! let plugins = Plugins::standard().with(Pose2D);
//! let text = r#"{"__wrapyfi__": ["Pose2D", 1.0, 2.5]}"#;
//! let value = json::decode_with(&text.into(), &Limits::default(), &plugins)?;
//! assert_eq!(value.as_object::<Pose>().unwrap().y, 2.5);
//! assert_eq!(json::encode_with(&value, &plugins)?, text.as_bytes());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#[cfg(feature = "tables")]
mod budget;
mod dask;
mod npy_tensor;
mod paddle;
#[cfg(feature = "tables")]
mod pandas;
mod pickled;
#[cfg(feature = "pictures")]
mod pillow;
mod pint;
#[cfg(feature = "tables")]
mod pyarrow;
mod standard;
#[cfg(feature = "torch")]
mod torch;
mod trax;
mod xarray;
#[cfg(feature = "zarr")]
mod zarr;

pub use crate::plugin_api::{
    Body, DeviceError, DeviceMaps, DeviceOption, Part, Plugin, PluginError, Plugins, Unpacking,
};
#[doc(hidden)]
pub use crate::plugin_api::{DeviceMap, Framework};
#[cfg(feature = "zarr")]
pub use zarr::ZarrGroup;
