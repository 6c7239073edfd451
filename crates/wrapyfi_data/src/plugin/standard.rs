//! The plug-ins of Wrapyfi's own keys. Only this file names them: the set knows them as [`Plugin`]s.

use std::sync::{Arc, LazyLock};

use super::Plugin;
use super::Plugins;
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
    Plugins::of(builtins)
});

impl Plugins {
    /// Plug-ins of all Wrapyfi's keys that this build has: pandas, PyArrow and dask's frames with
    /// feature `tables`, Pillow with `pictures`, PyTorch with `torch`, zarr with `zarr`. Objects of other keys are
    /// carried as they are.
    pub fn standard() -> Self {
        STANDARD.clone()
    }
}

impl Default for Plugins {
    fn default() -> Self {
        Self::standard()
    }
}
