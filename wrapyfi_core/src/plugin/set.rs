//! The plug-ins in use, by key.

use std::collections::BTreeMap;
use std::fmt;
use std::sync::{Arc, LazyLock};

use super::Plugin;
use super::npy_tensor::NpyTensor;
use super::pillow::Pillow;
use super::pint::Pint;
use super::xarray::XArray;

/// The plug-ins that decode and encode native objects. Cheap to clone.
#[derive(Clone)]
pub struct Plugins(Arc<BTreeMap<String, Arc<dyn Plugin>>>);

static STANDARD: LazyLock<Plugins> = LazyLock::new(|| {
    let mut builtins: Vec<Arc<dyn Plugin>> = vec![
        Arc::new(Pillow), //
        Arc::new(Pint),
        Arc::new(XArray),
    ];
    builtins.extend(NpyTensor::ALL.map(|plugin| Arc::new(plugin) as _));
    Plugins(Arc::new(builtins.into_iter().map(|it| (it.key().to_owned(), it)).collect()))
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
        Self(Arc::default())
    }

    /// The same and `plugin`, which replaces the one of its key.
    #[must_use]
    pub fn with(mut self, plugin: impl Plugin + 'static) -> Self {
        let key = plugin.key().to_owned();
        Arc::make_mut(&mut self.0).insert(key, Arc::new(plugin));
        self
    }

    /// The plug-in of `key`.
    #[must_use]
    pub fn get(&self, key: &str) -> Option<&dyn Plugin> {
        self.0.get(key).map(|plugin| &**plugin)
    }

    /// The keys, in alphabetical order.
    pub fn keys(&self) -> impl Iterator<Item = &str> {
        self.0.keys().map(String::as_str)
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
    /// True for clones of each other.
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}
