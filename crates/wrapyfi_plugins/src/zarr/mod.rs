//! `ZarrData`: an array or a group of zarr 2, as a zip of its folder.
//!
//! ```text
//!   ["ZarrData", base64 of a zip, "Array", name]          ".zarray", ".zattrs", "0.0", "0.1", …
//!   ["ZarrData", base64 of a zip, "Group", null]          ".zgroup", "speed/.zarray", "speed/0", …
//!
//!   chunk ─ compressor ─▶ elements ─ its place ─▶ Tensor ;  chunks that are missing: fill_value
//! ```
//!
//! An array of numbers becomes a [`Tensor`] whose origin remembers `name`, and `attrs` as JSON text.
//! A group becomes a [`ZarrGroup`]. Both are written with one chunk each, without a compressor.
//!
//! Python's side loses data: Wrapyfi writes the names of a group's arrays in place of the arrays,
//! and its reader deletes the folder before anything of it is read, so that it finds the fill value
//! in every array and nothing in every group.

mod array;
mod blosc;
mod chunk;
mod group;
mod store;

pub use group::ZarrGroup;

use self::store::Store;
use crate::archive::{Archive, Writer};
use crate::malformed;
use wrapyfi_data::plugin::{Body, Part, Plugin, PluginError, Unpacking};
use wrapyfi_data::types::{ForeignObject, Origin, Value};

/// zarr's `Array` and `Group`.
pub(super) struct Zarr;

const KEY: &str = "ZarrData";
const ARRAY: &str = "Array";
const GROUP: &str = "Group";

impl Plugin for Zarr {
    fn key(&self) -> &str {
        KEY
    }

    fn decode(&self, body: &Body<'_>, context: &Unpacking<'_>) -> Result<Value, PluginError> {
        let kind = body.text(1)?;
        let name = body.optional_text(2)?;
        let archive = Archive::open(&body.base64(0)?).map_err(malformed)?;
        let store = Store { archive, context };
        match &*kind {
            ARRAY => {
                let Value::Tensor(tensor) = store.array("")? else {
                    return Err(PluginError::unsupported(
                        "a zarr array whose elements are no numbers",
                        "send it as a NumPy array",
                    ));
                };
                let mut origin = Origin::new(KEY);
                for (key, value) in [("name", name), ("attrs", store.attributes("")?)] {
                    if let Some(value) = value {
                        origin = origin.with(key, value);
                    }
                }
                Ok(tensor.with_origin(origin).into())
            }
            GROUP => Ok(ForeignObject::new(store.group("", 0)?).into()),
            other => Err(PluginError::unsupported(
                format!("a zarr {other:?}"),
                "send an Array or a Group",
            )),
        }
    }

    fn encode(&self, value: &Value) -> Result<Vec<Part>, PluginError> {
        let mut files = Files(Writer::with_capacity(0));
        let (kind, name) = if let Some(group) = value.as_object::<ZarrGroup>() {
            group.write("", &mut files)?;
            (GROUP, None)
        } else {
            let tensor = value
                .as_tensor()
                .ok_or_else(|| PluginError::not_mine("tensor or zarr group", value))?;
            files.array("", array::write(tensor))?;
            let origin = tensor.origin();
            if let Some(attributes) = origin.and_then(|origin| origin.get("attrs")) {
                files.add(".zattrs", attributes.as_bytes())?;
            }
            (ARRAY, origin.and_then(|origin| origin.get("name")))
        };
        let name = name.map_or(Part::Value(Value::Null), |name| Part::Text(name.to_owned()));
        Ok(vec![Part::base64(files.finish()?), Part::Text(kind.into()), name])
    }
}

/// The zip in the making.
struct Files(Writer);

impl Files {
    fn add(&mut self, name: &str, content: &[u8]) -> Result<(), PluginError> {
        self.0.add(name, content).ok_or_else(too_large)
    }

    /// `.zarray` and chunk of an array in the folder `path`, empty or ending in `/`.
    fn array(
        &mut self,
        path: &str,
        (metadata, chunk): (String, Option<array::File>),
    ) -> Result<(), PluginError> {
        self.add(&format!("{path}.zarray"), metadata.as_bytes())?;
        if let Some((name, data)) = chunk {
            self.add(&format!("{path}{name}"), &data)?;
        }
        Ok(())
    }

    fn finish(self) -> Result<Vec<u8>, PluginError> {
        self.0.finish().ok_or_else(too_large)
    }
}

fn too_large() -> PluginError {
    PluginError::unsupported("a zarr folder of more than 2 GiB", "send it in pieces")
}
