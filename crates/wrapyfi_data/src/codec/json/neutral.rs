//! Plug-in objects inside the ROS graph: readable JSON with the arrays beside it.
//!
//! ```text
//!   on Wrapyfi's wire                              in wrapyfi_msgs/msg/NativeObject
//!   ["PytorchTensor", "UEsDBAAA…", "cuda:0"]  ◀─▶  ["tensor", 0, {"key": "PytorchTensor"}]   tensors[0]
//!   ["PintData", "eyJtYWdu…", "Quantity"]     ◀─▶  ["quantity", {"magnitude": 1.5, "units": "meter"}]
//! ```
//!
//! A node that reads these needs no pickle, no zip and no base64: `docs/reference/wire/ros2.md` lists the
//! tags. Each is one value, made of the types that every dialect has.

mod picture;
#[cfg(feature = "tables")]
mod table;

use std::sync::Arc;

use crate::types::{Labelled, LabelledContent, Map, Origin, Quantity, Value, Variable};

/// Tags of the graph's dialect.
pub(super) fn is_tag(tag: &str) -> bool {
    matches!(tag, "tensor" | "table" | "picture" | "quantity" | "labelled")
}

/// Reads the value that `body` under `tag` stands for.
pub(super) fn read(tag: &str, body: &Value) -> Result<Value, String> {
    match tag {
        "quantity" => quantity(body).map(Value::from),
        "labelled" => labelled(body).map(Value::from),
        "picture" => picture::read(body).map(Value::from),
        #[cfg(feature = "tables")]
        "table" => table::read(body).map(Value::from),
        other => Err(format!("tag {other:?} is not read here")),
    }
}

/// Tag and body of a value that has them; `None` for one that is written as in every dialect.
pub(super) fn write(value: &Value) -> Result<Option<(&'static str, Value)>, String> {
    Ok(match value {
        Value::Quantity(quantity) => Some(("quantity", quantity_body(quantity))),
        Value::Labelled(labelled) => Some(("labelled", labelled_body(labelled))),
        Value::Picture(picture) => Some(("picture", picture::write(picture)?)),
        #[cfg(feature = "tables")]
        Value::Table(table) => table::write(table).map(|body| ("table", body)),
        _ => None,
    })
}

/// An origin as it stands beside a tensor's index and in the body of other tags.
pub(super) fn origin_body(origin: &Origin) -> Value {
    let attributes = origin.attributes.iter().map(|(name, value)| (&**name, value.clone()));
    let key = std::iter::once(("key", origin.key.clone()));
    Value::Map(Map::from_iter(key.chain(attributes)))
}

/// Reads what [`origin_body`] writes.
pub(super) fn read_origin(body: &Value) -> Result<Arc<Origin>, String> {
    let map = body.as_map().ok_or_else(|| format!("the origin is a {}, no dict", body.kind()))?;
    let mut origin = Origin::new(text(map, "key")?);
    for (name, value) in map.iter() {
        let (Some(name), Some(value)) = (name.as_str(), value.as_str()) else {
            return Err("the origin holds something that is no text".into());
        };
        if name != "key" {
            origin = origin.with(name, value);
        }
    }
    Ok(Arc::new(origin))
}

fn text(map: &Map, key: &str) -> Result<String, String> {
    match map.get(key) {
        Some(Value::Str(text)) => Ok(text.clone()),
        Some(other) => Err(format!("{key} is a {}, no text", other.kind())),
        None => Err(format!("{key} is missing")),
    }
}

/// Writes a number with its unit as the dict that pint's plug-in sends, too.
pub fn quantity_body(quantity: &Quantity) -> Value {
    let units = Value::from(quantity.units.as_str());
    Map::from_iter([("magnitude", quantity.magnitude.clone()), ("units", units)]).into()
}

/// Reads what [`quantity_body`] writes.
///
/// # Errors
/// When the dict lacks a magnitude that is a number, or its units; the text says what.
pub fn quantity(body: &Value) -> Result<Quantity, String> {
    let magnitude = body.get("magnitude").ok_or("no magnitude")?;
    match magnitude {
        Value::Int(_) | Value::BigInt(_) | Value::Float(_) => {}
        other => return Err(format!("magnitude is a {}, no number", other.kind())),
    }
    let units = body.get("units").and_then(Value::as_str);
    let units = units.ok_or("no units, or units that are no text")?.to_owned();
    Ok(Quantity { magnitude: magnitude.clone(), units })
}

fn variable_body(variable: &Variable) -> Value {
    Map::from_iter([
        ("dims", Value::from_iter(variable.dims.iter().cloned())),
        ("attrs", variable.attrs.clone().into()),
        ("data", variable.data.clone()),
    ])
    .into()
}

fn named_bodies(named: &[(String, Variable)]) -> Value {
    Map::from_iter(named.iter().map(|(name, member)| (&**name, variable_body(member)))).into()
}

fn labelled_body(labelled: &Labelled) -> Value {
    let mut body = Map::new();
    match &labelled.content {
        LabelledContent::Array(array) => {
            body.insert("name", labelled.name.clone());
            body.insert("array", variable_body(array));
        }
        LabelledContent::Dataset { dims, variables, attrs } => {
            body.insert("dims", extents_body(dims));
            body.insert("variables", named_bodies(variables));
            body.insert("attrs", attrs.clone());
        }
    }
    body.insert("coords", named_bodies(&labelled.coords));
    body.into()
}

fn variable(body: &Value) -> Result<Variable, String> {
    let map = body.as_map().ok_or_else(|| format!("a variable is a {}, no dict", body.kind()))?;
    let dims = map.get("dims").and_then(Value::as_items).ok_or("dims is no list")?;
    let dims = dims.iter().map(|dim| dim.as_str().map(str::to_owned));
    let attrs = map.get("attrs").and_then(Value::as_map).ok_or("attrs is no dict")?;
    Ok(Variable {
        dims: dims.collect::<Option<_>>().ok_or("dims holds something that is no text")?,
        data: map.get("data").ok_or("data is missing")?.clone(),
        attrs: attrs.clone(),
    })
}

fn named(body: Option<&Value>, what: &str) -> Result<Vec<(String, Variable)>, String> {
    let map = body.and_then(Value::as_map).ok_or_else(|| format!("{what} is no dict"))?;
    let members = map.iter().map(|(name, member)| {
        let name = name.as_str().ok_or_else(|| format!("{what} has a name that is no text"))?;
        let member = variable(member).map_err(|reason| format!("{what} {name:?}: {reason}"))?;
        Ok((name.to_owned(), member))
    });
    members.collect()
}

/// Reads extents, which are numbers from 0 on, by the names of their dimensions.
pub fn extents(dims: &Map) -> Option<Vec<(String, usize)>> {
    let extent = |(name, extent): (&Value, &Value)| {
        Some((name.as_str()?.to_owned(), usize::try_from(extent.as_i64()?).ok()?))
    };
    dims.iter().map(extent).collect()
}

/// Writes extents by the names of their dimensions.
pub fn extents_body(dims: &[(String, usize)]) -> Map {
    Map::from_iter(dims.iter().map(|(name, extent)| (&**name, *extent as u64)))
}

fn labelled(body: &Value) -> Result<Labelled, String> {
    let map = body.as_map().ok_or_else(|| format!("a {}, no dict", body.kind()))?;
    let coords = named(map.get("coords"), "coords")?;
    if let Some(array) = map.get("array") {
        let name = match map.get("name") {
            None | Some(Value::Null) => None,
            Some(_) => Some(text(map, "name")?),
        };
        return Ok(Labelled { name, content: LabelledContent::Array(variable(array)?), coords });
    }
    let dims = map.get("dims").and_then(Value::as_map).ok_or("dims is no dict")?;
    let content = LabelledContent::Dataset {
        dims: extents(dims).ok_or("dims holds something else than extents")?,
        variables: named(map.get("variables"), "variables")?,
        attrs: map.get("attrs").and_then(Value::as_map).ok_or("attrs is no dict")?.clone(),
    };
    Ok(Labelled { name: None, content, coords })
}
