//! Messages of dynamic_reconfigure as ROS 1 carries them, and the parameters that they describe.
//!
//! ```text
//!   Config              bools │ ints │ strs │ doubles │ groups      each: name, value
//!   ConfigDescription   groups │ max │ min │ dflt                   each group: its parameters
//!   Reconfigure         Config ─▶ Config
//! ```
//!
//! Nothing is allocated by a count that a message claims: each entry has bytes of its own.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

use bytes::BufMut as _;

use super::literal::{Choice, choices};
use crate::action_messages::Reader;
use crate::services::ServiceType;
use crate::xmlrpc::shortened;
use wrapyfi_data::types::{ParameterType, ParameterValue};
use wrapyfi_endpoint::codec::ros1::Ros1Type;
use wrapyfi_node::parameters::{ParameterDescriptor, ParameterRange};

/// Type of the descriptions of a server.
pub(crate) const DESCRIPTION: &str = "dynamic_reconfigure/ConfigDescription";

/// Deepest nesting of groups that is told.
const MAX_GROUPS: usize = 16;

/// Types of the two topics of a server.
pub(super) fn topic_types() -> [Ros1Type; 2] {
    [
        (DESCRIPTION, "757ce9d44ba8ddd801bb30bc456f946f"),
        ("dynamic_reconfigure/Config", "958f16a05573709014982821e6822580"),
    ]
    .map(|(name, md5)| Ros1Type {
        name: name.to_owned(),
        md5: md5.to_owned(),
        definition: String::new(),
    })
}

/// Type of the service of a server.
pub(super) fn service_type() -> ServiceType {
    let part = |part: &str| format!("dynamic_reconfigure/Reconfigure{part}");
    let md5 = "bb125d226a21982a4a98760418dc2672".to_owned();
    ServiceType { name: part(""), md5, request: part("Request"), response: part("Response") }
}

/// Values of parameters by name.
pub(super) type Config = BTreeMap<String, ParameterValue>;

/// A parameter as its server describes it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Described {
    pub(super) descriptor: ParameterDescriptor,
    /// Values of an enum; empty where it is none.
    pub(super) choices: Vec<ParameterValue>,
}

/// Reads values. `None` where the message is none.
pub(super) fn read_config(message: &[u8]) -> Option<Config> {
    config(&mut Reader(message))
}

fn text(reader: &mut Reader<'_>) -> Option<String> {
    Some(String::from_utf8_lossy(reader.text()?).into_owned())
}

fn config(reader: &mut Reader<'_>) -> Option<Config> {
    let mut config = Config::new();
    for _ in 0..reader.u32()? {
        config.insert(text(reader)?, ParameterValue::Bool(reader.u8()? != 0));
    }
    for _ in 0..reader.u32()? {
        let (name, value) = (text(reader)?, i32::from_le_bytes(reader.bytes()?));
        config.insert(name, ParameterValue::Integer(value.into()));
    }
    for _ in 0..reader.u32()? {
        config.insert(text(reader)?, ParameterValue::String(text(reader)?));
    }
    for _ in 0..reader.u32()? {
        let (name, value) = (text(reader)?, f64::from_le_bytes(reader.bytes()?));
        config.insert(name, ParameterValue::Double(value));
    }
    for _ in 0..reader.u32()? {
        let (_name, _state, _id, _parent) =
            (reader.text()?, reader.u8()?, reader.u32()?, reader.u32()?);
    }
    Some(config)
}

/// Writes values; those that dynamic_reconfigure has no type for are left out.
pub(super) fn write_config(config: &Config) -> Vec<u8> {
    fn put_text(bytes: &mut Vec<u8>, text: &str) {
        bytes.put_u32_le(u32::try_from(text.len()).unwrap_or(u32::MAX));
        bytes.put_slice(text.as_bytes());
    }
    let mut parts: [(u32, Vec<u8>); 4] = Default::default();
    let [bools, ints, texts, doubles] = &mut parts;
    for (name, value) in config {
        let (part, bytes) = match value {
            ParameterValue::Bool(value) => (&mut *bools, vec![u8::from(*value)]),
            ParameterValue::Integer(value) => match i32::try_from(*value) {
                Ok(value) => (&mut *ints, value.to_le_bytes().to_vec()),
                Err(_over) => continue,
            },
            ParameterValue::String(value) => {
                let mut bytes = Vec::new();
                put_text(&mut bytes, value);
                (&mut *texts, bytes)
            }
            ParameterValue::Double(value) => (&mut *doubles, value.to_le_bytes().to_vec()),
            _ => continue,
        };
        part.0 = part.0.saturating_add(1);
        put_text(&mut part.1, name);
        part.1.extend(bytes);
    }
    let mut bytes = Vec::new();
    for (count, part) in parts {
        bytes.put_u32_le(count);
        bytes.extend(part);
    }
    // Groups stay as they are.
    bytes.put_u32_le(0);
    bytes
}

/// A parameter as it stands in a description.
struct Told {
    name: String,
    kind: String,
    level: u32,
    description: String,
    edit_method: String,
}

struct Group {
    name: String,
    parent: u32,
    parameters: Vec<Told>,
}

/// Reads a description: its parameters, and in words what in it cannot be used. `None` where the message is none.
pub(super) fn read_description(message: &[u8]) -> Option<(Vec<Described>, Vec<String>)> {
    let reader = &mut Reader(message);
    let mut groups = BTreeMap::new();
    let mut order = Vec::new();
    for _ in 0..reader.u32()? {
        let (name, _kind) = (text(reader)?, reader.text()?);
        let mut parameters = Vec::new();
        for _ in 0..reader.u32()? {
            let (name, kind, level) = (text(reader)?, text(reader)?, reader.u32()?);
            let (description, edit_method) = (text(reader)?, text(reader)?);
            parameters.push(Told { name, kind, level, description, edit_method });
        }
        let (parent, id) = (reader.u32()?, reader.u32()?);
        if groups.insert(id, Group { name, parent, parameters }).is_none() {
            order.push(id);
        }
    }
    let [max, min, default] = [config(reader)?, config(reader)?, config(reader)?];
    let (mut described, mut faults, mut names) = (Vec::new(), Vec::new(), BTreeSet::new());
    for id in order {
        let path = path(&groups, id);
        for told in groups.get(&id).into_iter().flat_map(|group| &group.parameters) {
            if !names.insert(&told.name) {
                faults.push(format!("parameter {:?} is described twice", shortened(&told.name)));
                continue;
            }
            let limits = [min.get(&told.name), max.get(&told.name), default.get(&told.name)];
            match describe(told, &path, limits) {
                Ok((one, fault)) => {
                    described.push(one);
                    faults.extend(fault);
                }
                Err(fault) => faults.push(fault),
            }
        }
    }
    Some((described, faults))
}

/// Names of a group and of those around it, but for the outermost, which has all; empty for that one.
fn path(groups: &BTreeMap<u32, Group>, id: u32) -> String {
    let mut names = Vec::new();
    let mut at = id;
    while at != 0
        && names.len() < MAX_GROUPS
        && let Some(group) = groups.get(&at)
    {
        names.push(group.name.as_str());
        at = group.parent;
    }
    names.reverse();
    names.join("/")
}

/// A parameter as ROS 2 describes it, and in words what is left out of that.
fn describe(
    told: &Told,
    path: &str,
    [min, max, default]: [Option<&ParameterValue>; 3],
) -> Result<(Described, Option<String>), String> {
    let name = shortened(&told.name);
    let kind = match told.kind.as_str() {
        "bool" => ParameterType::Bool,
        "int" => ParameterType::Integer,
        "double" => ParameterType::Double,
        "str" => ParameterType::String,
        other => {
            let other = shortened(other);
            return Err(format!(
                "parameter {name:?} has type {other:?}, which is none of bool, int, double, str"
            ));
        }
    };
    let mut fault = None;
    let range = match (min, max) {
        _ if !matches!(kind, ParameterType::Integer | ParameterType::Double) => None,
        (Some(ParameterValue::Integer(from)), Some(ParameterValue::Integer(to)))
            if kind == ParameterType::Integer && from <= to =>
        {
            Some(ParameterRange::Integer { from: *from, to: *to, step: 0 })
        }
        (Some(ParameterValue::Double(from)), Some(ParameterValue::Double(to)))
            if kind == ParameterType::Double && from <= to =>
        {
            let is_endless = [from, to].into_iter().all(|end| end.abs() >= f64::MAX);
            (!is_endless).then_some(ParameterRange::Double { from: *from, to: *to, step: 0.0 })
        }
        (min, max) => {
            let shown = |end: Option<&ParameterValue>| {
                end.map_or("none".to_owned(), |it| shortened(&it.to_string()))
            };
            let (min, max) = (shown(min), shown(max));
            fault = Some(format!(
                "parameter {name:?} has no range: its minimum is {min}, its maximum {max}"
            ));
            None
        }
    };
    // All that 32 bits hold: a server has no other integers.
    let range = range.or_else(|| {
        let (from, to) = (i32::MIN.into(), i32::MAX.into());
        (kind == ParameterType::Integer).then_some(ParameterRange::Integer { from, to, step: 0 })
    });
    let mut allowed = Vec::new();
    if !told.edit_method.is_empty() {
        match choices(&told.edit_method) {
            Ok(all) if all.iter().all(|one| one.value.parameter_type() == kind) => allowed = all,
            Ok(_) => {
                fault = Some(format!(
                    "the enum of parameter {name:?} has values of other types than {}",
                    told.kind
                ));
            }
            Err(why) => {
                fault = Some(format!("the enum of parameter {name:?} is not readable: {why}"));
            }
        }
    }
    let descriptor = ParameterDescriptor {
        range,
        additional_constraints: constraints(&allowed),
        ..ParameterDescriptor::new(&told.name)
            .with_type(kind)
            .with_description(description(told, path, default))
    };
    let choices = allowed.into_iter().map(|one| one.value).collect();
    Ok((Described { descriptor, choices }, fault))
}

/// The purpose, and what ROS 2 has no field for.
fn description(told: &Told, path: &str, default: Option<&ParameterValue>) -> String {
    let group = (!path.is_empty()).then(|| format!("group {path}"));
    let default = default.map(|value| format!("default {value}"));
    let level = (told.level != 0).then(|| format!("level {}", told.level));
    let more: Vec<String> = [group, default, level].into_iter().flatten().collect();
    let more = if more.is_empty() { String::new() } else { format!("({})", more.join(", ")) };
    format!("{} {more}", told.description).trim().to_owned()
}

/// The values of an enum in words.
fn constraints(choices: &[Choice]) -> String {
    let mut text = String::new();
    for Choice { name, value, description } in choices {
        text.push_str(if text.is_empty() { "one of " } else { ", " });
        _ = write!(text, "{value} ({name}");
        let more =
            if description.is_empty() { ")".to_owned() } else { format!(": {description})") };
        text.push_str(&more);
    }
    text
}

#[cfg(test)]
#[path = "reconfigure_tests.rs"]
mod tests;
