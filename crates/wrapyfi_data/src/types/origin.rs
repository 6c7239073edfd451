//! The library object that a value was, so that it can become that object again.

use std::collections::BTreeMap;

/// The library object that a value was, or shall become, on Wrapyfi's side: the plug-in key and the
/// attributes that the plug-in keeps beside the numbers.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::types; }
/// use wrapyfi_core::types::{Dtype, Origin, Tensor};
/// let weights = Tensor::from_elements(&[2], vec![1.0_f32, 2.0])?
///     .with_origin(Origin::new("PytorchTensor").with("requires_grad", "true"));
/// assert_eq!(weights.framework(), Some("PytorchTensor"));
/// # Ok::<(), wrapyfi_data::types::ShapeError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct Origin {
    /// Key of the plug-in, for instance `PytorchTensor` (Wrapyfi's class name of the plug-in).
    pub key: String,
    /// Attributes that the plug-in keeps, for instance `requires_grad`; documented with each
    /// plug-in.
    pub attributes: BTreeMap<String, String>,
}

impl Origin {
    /// An object of the plug-in `key` without attributes.
    pub fn new(key: impl Into<String>) -> Self {
        Self { key: key.into(), attributes: BTreeMap::new() }
    }

    /// Adds an attribute.
    #[must_use]
    pub fn with(mut self, name: impl Into<String>, value: impl Into<String>) -> Self {
        self.attributes.insert(name.into(), value.into());
        self
    }

    /// Value of an attribute.
    pub fn get(&self, name: &str) -> Option<&str> {
        self.attributes.get(name).map(String::as_str)
    }
}
