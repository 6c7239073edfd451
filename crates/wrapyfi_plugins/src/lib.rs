//! Plug-ins of Wrapyfi's own keys: objects of pandas, torch, Pillow and other libraries of Python, as data.
//!
//! Plug-ins read and write with the codecs of `wrapyfi_data`, which know them by [`Plugin`] alone. [`standard`] has
//! every key of Wrapyfi's own table (`docs/reference/wire/plugins.md`). A crate of
//! the user adds one by implementing [`Plugin`]:
//!
//! ```
//! # mod wrapyfi_core {
//! #     pub use wrapyfi_data::{Limits, codec, types};
//! #     pub mod plugin { pub use {wrapyfi_data::plugin::*, wrapyfi_plugins::*}; }
//! # }
//! use wrapyfi_core::Limits;
//! use wrapyfi_core::codec::json;
//! use wrapyfi_core::plugin::{Body, Part, Plugin, PluginError, Unpacking, standard};
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
//! let plugins = standard().with(Pose2D);
//! let text = r#"{"__wrapyfi__": ["Pose2D", 1.0, 2.5]}"#;
//! let value = json::decode(&text.into(), &Limits::default(), &plugins)?;
//! assert_eq!(value.as_object::<Pose>().unwrap().y, 2.5);
//! assert_eq!(json::encode(&value, &plugins)?, text.as_bytes());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#[cfg(any(feature = "torch", feature = "zarr"))]
mod archive;
#[cfg(feature = "tables")]
mod budget;
mod dask;
mod npy_tensor;
mod paddle;
#[cfg(feature = "tables")]
mod pandas;
pub mod pickle;
mod pickled;
#[cfg(feature = "pictures")]
mod pillow;
mod pint;
#[cfg(feature = "tables")]
mod pyarrow;
#[cfg(feature = "torch")]
mod torch;
mod trax;
mod xarray;
#[cfg(feature = "zarr")]
mod zarr;

use std::sync::{Arc, LazyLock};

use wrapyfi_data::plugin::{Body, Framework, Part, Plugin, PluginError, Plugins, Unpacking};

#[cfg(feature = "zarr")]
pub use zarr::ZarrGroup;

static STANDARD: LazyLock<Plugins> = LazyLock::new(|| {
    let mut builtins: Vec<Arc<dyn Plugin>> = vec![
        Arc::new(dask::Dask),
        Arc::new(paddle::Paddle),
        #[cfg(feature = "tables")]
        Arc::new(pandas::Pandas),
        #[cfg(feature = "tables")]
        Arc::new(pandas::PandasLegacy),
        #[cfg(feature = "pictures")]
        Arc::new(pillow::Pillow),
        Arc::new(pint::Pint),
        #[cfg(feature = "tables")]
        Arc::new(pyarrow::PyArrow),
        #[cfg(feature = "torch")]
        Arc::new(torch::Torch),
        Arc::new(trax::Trax),
        Arc::new(xarray::XArray),
        #[cfg(feature = "zarr")]
        Arc::new(zarr::Zarr),
    ];
    builtins.extend(npy_tensor::NpyTensor::ALL.map(|plugin| Arc::new(plugin) as _));
    builtins.into_iter().collect()
});

/// Plug-ins of all Wrapyfi's keys that this build has: pandas, PyArrow and dask's frames with
/// feature `tables`, Pillow with `pictures`, PyTorch with `torch`, zarr with `zarr`. Objects of other keys are
/// carried as they are.
///
/// ```
/// let standard = wrapyfi_plugins::standard();
/// assert!(standard.keys().any(|key| key == "JAXTensor"));
/// assert!(standard.get("MyPose").is_none());
/// ```
pub fn standard() -> Plugins {
    STANDARD.clone()
}

/// Makes the error of a first part, most often the only one, that does not follow the format.
fn malformed(reason: impl std::fmt::Display) -> PluginError {
    PluginError::malformed(0, reason.to_string())
}
