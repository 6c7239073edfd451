//! The plug-ins in use, by key.

use std::collections::BTreeMap;
use std::fmt;
use std::sync::{Arc, LazyLock};

use super::dask::Dask;
use super::npy_tensor::NpyTensor;
use super::paddle::Paddle;
use super::pandas::{Pandas, PandasLegacy};
use super::pillow::Pillow;
use super::pint::Pint;
use super::pyarrow::PyArrow;
use super::torch::Torch;
use super::trax::Trax;
use super::xarray::XArray;
use super::zarr::Zarr;
use super::{DeviceMaps, Plugin};
use crate::types::Tensor;

/// The plug-ins that decode and encode native objects, and where the tensors among these go. Cheap
/// to clone.
#[derive(Clone)]
pub struct Plugins {
    by_key: Arc<BTreeMap<String, Arc<dyn Plugin>>>,
    devices: Option<Arc<DeviceMaps>>,
}

static STANDARD: LazyLock<Plugins> = LazyLock::new(|| {
    let mut builtins: Vec<Arc<dyn Plugin>> = vec![
        Arc::new(Dask),
        Arc::new(Paddle),
        Arc::new(Pandas),
        Arc::new(PandasLegacy),
        Arc::new(Pillow),
        Arc::new(Pint),
        Arc::new(PyArrow),
        Arc::new(Torch),
        Arc::new(Trax),
        Arc::new(XArray),
        Arc::new(Zarr),
    ];
    builtins.extend(NpyTensor::ALL.map(|plugin| Arc::new(plugin) as _));
    let by_key = builtins.into_iter().map(|it| (it.key().to_owned(), it)).collect();
    Plugins { by_key: Arc::new(by_key), devices: None }
});

impl Plugins {
    /// Every key of Wrapyfi's own table.
    #[must_use]
    pub fn standard() -> Self {
        STANDARD.clone()
    }

    /// None: every plug-in object is carried as it is.
    #[must_use]
    pub fn none() -> Self {
        Self { by_key: Arc::default(), devices: None }
    }

    /// The same and `plugin`, which replaces the one of its key.
    #[must_use]
    pub fn with(mut self, plugin: impl Plugin + 'static) -> Self {
        let key = plugin.key().to_owned();
        Arc::make_mut(&mut self.by_key).insert(key, Arc::new(plugin));
        self
    }

    /// The same, with decoded tensors labelled as `devices` says. Without maps every tensor keeps
    /// the label it came with.
    #[must_use]
    pub fn with_devices(mut self, devices: DeviceMaps) -> Self {
        self.devices = (!devices.is_empty()).then(|| Arc::new(devices));
        self
    }

    /// Where decoded tensors go, if anything is said about it.
    #[must_use]
    pub fn devices(&self) -> Option<&DeviceMaps> {
        self.devices.as_deref()
    }

    /// `tensor` with the label of the device it belongs on here.
    pub(crate) fn place(&self, tensor: Tensor) -> Tensor {
        let target =
            self.devices().and_then(|maps| maps.target(tensor.framework()?, &tensor.device));
        match target.map(str::to_owned) {
            Some(target) => tensor.with_device(target),
            None => tensor,
        }
    }

    /// The plug-in of `key`.
    #[must_use]
    pub fn get(&self, key: &str) -> Option<&dyn Plugin> {
        self.by_key.get(key).map(|plugin| &**plugin)
    }

    /// The keys, in alphabetical order.
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
