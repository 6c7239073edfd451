//! Groups: folders of arrays and of other groups.

use std::collections::BTreeSet;

use super::store::Store;
use super::{Files, KEY, array};
use wrapyfi_data::plugin::PluginError;
use wrapyfi_data::types::{PluginObject, Value};

/// A zarr group with everything in it. It is the only object of this crate that is a
/// [`wrapyfi_data::types::Value::Object`]: nothing else holds arrays by name and is no `dict`.
///
/// ```
/// # mod wrapyfi_core { pub use {wrapyfi_data::types, wrapyfi_plugins as plugin}; }
/// use wrapyfi_core::plugin::ZarrGroup;
/// use wrapyfi_core::types::{ForeignObject, Tensor, Value};
/// let speeds = Tensor::from_elements(&[2], vec![1.5_f32, 2.0])?;
/// let group = ZarrGroup { arrays: vec![("speed".into(), speeds.into())], ..ZarrGroup::default() };
/// let value = Value::from(ForeignObject::new(group.clone()));
/// assert_eq!(value.as_object::<ZarrGroup>(), Some(&group));
/// # Ok::<(), wrapyfi_data::types::ShapeError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ZarrGroup {
    /// Attributes as JSON text of an object; `None` without any.
    pub attributes: Option<String>,
    /// Arrays by name, in the order of names: [`Value::Tensor`], or [`Value::Array`] where the
    /// elements are no numbers.
    pub arrays: Vec<(String, Value)>,
    /// Groups inside, by name.
    pub groups: Vec<(String, ZarrGroup)>,
}

impl PluginObject for ZarrGroup {
    fn key(&self) -> &str {
        KEY
    }
}

impl Store<'_> {
    /// The group in the folder `path`, empty or ending in `/`, inside `depth` others.
    pub(super) fn group(&self, path: &str, depth: usize) -> Result<ZarrGroup, PluginError> {
        let limit = self.context.limits.depth;
        if depth > limit {
            let what = format!("nesting of zarr groups at {path:?}");
            return Err(PluginError::too_large(what, depth, limit));
        }
        if self.archive.member(&format!("{path}.zgroup")).is_none() {
            return Err(self.missing_file(path, ".zgroup"));
        }
        let mut group = ZarrGroup { attributes: self.attributes(path)?, ..ZarrGroup::default() };
        let members: BTreeSet<&str> = self
            .archive
            .iter()
            .filter_map(|(name, _)| Some(name.strip_prefix(path)?.split_once('/')?.0))
            .collect();
        for name in members {
            let inner = format!("{path}{name}/");
            if self.archive.member(&format!("{inner}.zarray")).is_some() {
                group.arrays.push((name.to_owned(), self.array(&inner)?));
            } else {
                group.groups.push((name.to_owned(), self.group(&inner, depth + 1)?));
            }
        }
        Ok(group)
    }
}

impl ZarrGroup {
    /// Writes everything into the folder `path`.
    pub(super) fn write(&self, path: &str, files: &mut Files) -> Result<(), PluginError> {
        files.add(&format!("{path}.zgroup"), b"{\n    \"zarr_format\": 2\n}")?;
        if let Some(attributes) = &self.attributes {
            files.add(&format!("{path}.zattrs"), attributes.as_bytes())?;
        }
        for (name, member) in &self.arrays {
            let inner = member_path(path, name)?;
            match member {
                Value::Tensor(tensor) => files.array(&inner, array::write(tensor))?,
                Value::Array(other) => {
                    let written = array::write_other(other);
                    let written = written.ok_or_else(|| {
                        PluginError::unsupported(
                            format!("the structured array {name:?} of a zarr group"),
                            "send its fields",
                        )
                    })?;
                    files.array(&inner, written)?;
                }
                other => return Err(PluginError::not_mine("tensor in a zarr group", other)),
            }
        }
        for (name, group) in &self.groups {
            group.write(&member_path(path, name)?, files)?;
        }
        Ok(())
    }
}

fn member_path(path: &str, name: &str) -> Result<String, PluginError> {
    if name.is_empty() || name.starts_with('.') || name.contains(['/', '\\', '\0', ':']) {
        return Err(PluginError::unsupported(
            format!("a member {name:?} of a zarr group"),
            "give it a name without / \\ : and without a dot at the beginning",
        ));
    }
    Ok(format!("{path}{name}/"))
}
