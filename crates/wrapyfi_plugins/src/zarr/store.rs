//! The folder of an array or a group, which a zip holds.

use crate::archive::Archive;
use crate::malformed;
use wrapyfi_data::codec::json;
use wrapyfi_data::plugin::{PluginError, Plugins, Unpacking};
use wrapyfi_data::types::Value;

/// The folder that the zip holds.
pub(super) struct Store<'a> {
    pub(super) archive: Archive,
    pub(super) context: &'a Unpacking<'a>,
}

impl Store<'_> {
    /// The content of a file, inflated where it must be.
    pub(super) fn read(&self, name: &str) -> Result<Option<bytes::Bytes>, PluginError> {
        let Some(member) = self.archive.member(name) else { return Ok(None) };
        self.archive.content(member, &format!("zip member {name:?}"), self.context).map(Some)
    }

    /// Error for a folder `path` without the file that zarr format 2 needs there.
    pub(super) fn missing_file(&self, path: &str, file: &str) -> PluginError {
        let v3 = self.archive.member(&format!("{path}zarr.json")).is_some();
        let why = if v3 { "; zarr.json is zarr format 3, 2 is read" } else { "" };
        malformed(format!("the zip lacks {path}{file}{why}"))
    }

    /// `.zattrs` of the folder `path` as JSON text; `None` where there is none or it says nothing.
    pub(super) fn attributes(&self, path: &str) -> Result<Option<String>, PluginError> {
        let name = format!("{path}.zattrs");
        let Some(file) = self.read(&name)? else { return Ok(None) };
        let limits = self.context.limits_within(file.len());
        let attributes = json::decode(&file, &limits, &Plugins::none())
            .map_err(|error| malformed(format!("{name}: {error}")))?;
        match (attributes, std::str::from_utf8(&file)) {
            (Value::Map(attributes), _) if attributes.is_empty() => Ok(None),
            (Value::Map(_), Ok(text)) => Ok(Some(text.to_owned())),
            (other, _) => Err(malformed(format!("{name} is a {}, no dict", other.kind()))),
        }
    }
}
