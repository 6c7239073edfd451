//! The plug-ins in use, by key.

use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;

use super::{DeviceMaps, Plugin};
use crate::types::Tensor;

/// The plug-ins that decode and encode native objects, and the devices of decoded tensors. Cheap to
/// clone.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::{Limits, codec, plugin, types}; }
/// use wrapyfi_core::Limits;
/// use wrapyfi_core::codec::json;
/// use wrapyfi_core::plugin::Plugins;
/// use wrapyfi_core::types::Value;
/// // Without plug-ins every object is carried as it came.
/// let quantity = r#"{"__wrapyfi__": ["PintData", 3, "gram"]}"#.into();
/// let value = json::decode(&quantity, &Limits::default(), &Plugins::none())?;
/// assert!(matches!(value, Value::Tagged(tagged) if tagged.json == quantity));
/// # Ok::<(), wrapyfi_data::DecodeError>(())
/// ```
#[derive(Clone)]
pub struct Plugins {
    by_key: Arc<BTreeMap<String, Arc<dyn Plugin>>>,
    devices: Option<Arc<DeviceMaps>>,
}

impl Plugins {
    /// A set without plug-ins: every plug-in object is carried as it is.
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
    pub fn get(&self, key: &str) -> Option<&dyn Plugin> {
        self.by_key.get(key).map(|plugin| &**plugin)
    }

    /// Keys of the plug-ins, in alphabetical order.
    pub fn keys(&self) -> impl Iterator<Item = &str> {
        self.by_key.keys().map(String::as_str)
    }
}

impl FromIterator<Arc<dyn Plugin>> for Plugins {
    /// Collects plug-ins; of two with one key the last counts.
    fn from_iter<I: IntoIterator<Item = Arc<dyn Plugin>>>(plugins: I) -> Self {
        let by_key = plugins.into_iter().map(|it| (it.key().to_owned(), it)).collect();
        Self { by_key: Arc::new(by_key), devices: None }
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
