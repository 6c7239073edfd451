//! The plug-ins in use, by key.

use std::collections::BTreeMap;
use std::fmt;
use std::sync::{Arc, LazyLock};

use super::dask::Dask;
use super::npy_tensor::NpyTensor;
use super::paddle::Paddle;
#[cfg(feature = "tables")]
use super::pandas::{Pandas, PandasLegacy};
#[cfg(feature = "pictures")]
use super::pillow::Pillow;
use super::pint::Pint;
#[cfg(feature = "tables")]
use super::pyarrow::PyArrow;
#[cfg(feature = "torch")]
use super::torch::Torch;
use super::trax::Trax;
use super::xarray::XArray;
#[cfg(feature = "zarr")]
use super::zarr::Zarr;
use super::{DeviceMaps, Plugin};
use crate::types::Tensor;

/// The plug-ins that decode and encode native objects, and the devices of decoded tensors. Cheap to
/// clone.
#[derive(Clone)]
pub struct Plugins {
    by_key: Arc<BTreeMap<String, Arc<dyn Plugin>>>,
    devices: Option<Arc<DeviceMaps>>,
}

static STANDARD: LazyLock<Plugins> = LazyLock::new(|| {
    let mut builtins: Vec<Arc<dyn Plugin>> = vec![
        Arc::new(Dask),
        Arc::new(Paddle),
        #[cfg(feature = "tables")]
        Arc::new(Pandas),
        #[cfg(feature = "tables")]
        Arc::new(PandasLegacy),
        #[cfg(feature = "pictures")]
        Arc::new(Pillow),
        Arc::new(Pint),
        #[cfg(feature = "tables")]
        Arc::new(PyArrow),
        #[cfg(feature = "torch")]
        Arc::new(Torch),
        Arc::new(Trax),
        Arc::new(XArray),
        #[cfg(feature = "zarr")]
        Arc::new(Zarr),
    ];
    builtins.extend(NpyTensor::ALL.map(|plugin| Arc::new(plugin) as _));
    let by_key = builtins.into_iter().map(|it| (it.key().to_owned(), it)).collect();
    Plugins { by_key: Arc::new(by_key), devices: None }
});

impl Plugins {
    /// Plug-ins of all Wrapyfi's keys that this build has: pandas, PyArrow and dask's frames with
    /// feature `tables`, Pillow with `pictures`, PyTorch with `torch`, zarr with `zarr`. Objects of other keys are
    /// carried as they are.
    #[must_use]
    pub fn standard() -> Self {
        STANDARD.clone()
    }

    /// A set without plug-ins: every plug-in object is carried as it is.
    #[must_use]
    pub fn none() -> Self {
        Self { by_key: Arc::default(), devices: None }
    }

    /// Adds `plugin`, which replaces the one of its key.
    #[must_use]
    pub fn with(mut self, plugin: impl Plugin + 'static) -> Self {
        let key = plugin.key().to_owned();
        Arc::make_mut(&mut self.by_key).insert(key, Arc::new(plugin));
        self
    }

    /// Sets the devices with which decoded tensors are labelled. Without maps every tensor keeps
    /// the label with which it came.
    #[must_use]
    pub fn with_devices(mut self, devices: DeviceMaps) -> Self {
        self.devices = (!devices.is_empty()).then(|| Arc::new(devices));
        self
    }

    /// Devices for decoded tensors, if any are set.
    #[must_use]
    pub fn devices(&self) -> Option<&DeviceMaps> {
        self.devices.as_deref()
    }

    /// Labels `tensor` with the device that the maps give it.
    pub(crate) fn place(&self, tensor: Tensor) -> Tensor {
        let target =
            self.devices().and_then(|maps| maps.target(tensor.framework()?, &tensor.device));
        match target.map(str::to_owned) {
            Some(target) => tensor.with_device(target),
            None => tensor,
        }
    }

    /// Plug-in of `key`.
    #[must_use]
    pub fn get(&self, key: &str) -> Option<&dyn Plugin> {
        self.by_key.get(key).map(|plugin| &**plugin)
    }

    /// Keys of the plug-ins, in alphabetical order.
    pub fn keys(&self) -> impl Iterator<Item = &str> {
        self.by_key.keys().map(String::as_str)
    }
}

impl Default for Plugins {
    fn default() -> Self {
        Self::standard()
    }
}

impl fmt::Debug for Plugins {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_set().entries(self.keys()).finish()
    }
}

impl PartialEq for Plugins {
    /// True for clones of each other with the same device maps.
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.by_key, &other.by_key) && self.devices == other.devices
    }
}
