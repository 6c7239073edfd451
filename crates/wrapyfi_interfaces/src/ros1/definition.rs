//! Definitions as ROS 1 nodes show them to each other: text, checksum, types.
//!
//! ```text
//!   sensor_msgs/Joy    Header header            own text, as the file has it
//!                      float32[] axes
//!                      int32[] buttons
//!                      (empty line)
//!                      ======================   80 of them
//!                      MSG: std_msgs/Header     each type it refers to, depth first, once
//!                      uint32 seq …
//! ```
//!
//! That is what `gendeps --cat` prints, and what publishers send as `message_definition`.

use std::collections::{BTreeMap, BTreeSet};

use super::error::DefinitionError;
use super::names::ros1_name;
use super::standard::hand_made;
use crate::parser::{Dialect, Element, InterfaceKind, MessageDefinition, TypeName};
use crate::store::{ResolvedType, TypeStore, ros1_builtin};

/// A message type of ROS 1.
#[derive(Debug, Clone, PartialEq)]
pub struct Definition {
    /// Fields and constants, with all types that it refers to.
    pub resolved: ResolvedType,
    /// `message_definition` of connection headers.
    pub text: String,
    /// `md5sum` of connection headers: 32 hexadecimal digits.
    pub md5sum: String,
}

/// A service type of ROS 1.
#[derive(Debug, Clone, PartialEq)]
pub struct ServiceDefinition {
    /// Name of the service; [`ServiceDefinition::ros1_name`] is how ROS 1 writes it.
    pub name: TypeName,
    /// Message that a client sends.
    pub request: ResolvedType,
    /// Message that a server answers.
    pub response: ResolvedType,
    /// The definition with all it refers to.
    pub text: String,
    /// `md5sum` of connection headers: 32 hexadecimal digits.
    pub md5sum: String,
}

/// Reads `package/Type`.
pub(super) fn parse_name(kind: InterfaceKind, text: &str) -> Result<TypeName, DefinitionError> {
    let (package, name) = text.split_once('/').unwrap_or_default();
    TypeName::with_kind(Dialect::Ros1, package, kind, name)
        .map_err(|fault| DefinitionError::Name { text: text.to_owned(), fault })
}

impl Definition {
    /// Reads what a publisher shows in its connection header: `type` and `message_definition`.
    ///
    /// ```
    /// use wrapyfi_interfaces::ros1::Definition;
    /// let text = "string data\n";
    /// let string = Definition::from_header("std_msgs/String", text).unwrap();
    /// assert_eq!(string.md5sum, "992ce8a1687cec8c8bd883ec73ca41d1");
    /// ```
    ///
    /// # Errors
    /// When the name is none, or the text is too large, cannot be parsed, lacks a type, or has one
    /// that contains itself.
    pub fn from_header(type_name: &str, text: &str) -> Result<Self, DefinitionError> {
        let name = parse_name(InterfaceKind::Message, type_name)?;
        let resolved = ResolvedType::from_text(Dialect::Ros1, &name, text)?;
        let md5sum = resolved.md5sum()?;
        Ok(Self { resolved, text: text.to_owned(), md5sum })
    }

    /// Finds a message in a store of ROS 1 definitions. The text is that of the files, in the order of
    /// `gendeps --cat`.
    ///
    /// # Errors
    /// When it is not found or cannot be read, and for services.
    pub fn from_store(store: &mut TypeStore, name: &TypeName) -> Result<Self, DefinitionError> {
        if name.kind() != InterfaceKind::Message {
            return Err(DefinitionError::Kind { name: name.clone(), expected: "message" });
        }
        let resolved = store.resolve(name)?;
        let texts = texts(store, &resolved)?;
        Self::new(resolved, &texts)
    }

    /// Definition of a ROS 1 type; texts that `texts` lacks are written anew, without comments.
    pub(super) fn new(
        resolved: ResolvedType,
        texts: &BTreeMap<String, String>,
    ) -> Result<Self, DefinitionError> {
        let md5sum = resolved.md5sum()?;
        let text = full_text(resolved.name(), &resolved, texts);
        Ok(Self { resolved, text, md5sum })
    }

    /// Name of the type; [`Definition::ros1_name`] is how ROS 1 writes it.
    pub fn name(&self) -> &TypeName {
        self.resolved.name()
    }

    /// `sensor_msgs/Image`: `type` of connection headers.
    pub fn ros1_name(&self) -> String {
        ros1_name(self.name())
    }
}

impl ServiceDefinition {
    /// Finds a service in a store of ROS 1 definitions.
    ///
    /// # Errors
    /// When it is not found or cannot be read, and for messages.
    pub fn from_store(store: &mut TypeStore, name: &TypeName) -> Result<Self, DefinitionError> {
        let resolved = store.resolve(name)?;
        let texts = texts(store, &resolved)?;
        Self::new(&resolved, &texts)
    }

    /// Definition of a ROS 1 service, as [`Definition::new`].
    pub(super) fn new(
        resolved: &ResolvedType,
        texts: &BTreeMap<String, String>,
    ) -> Result<Self, DefinitionError> {
        let name = resolved.name().clone();
        let text = full_text(&name, resolved, texts);
        let no_service = || DefinitionError::Kind { name: name.clone(), expected: "service" };
        let is_service = name.kind() == InterfaceKind::Service && name.file_stem() == name.name();
        let part = |suffix| resolved.part(suffix).filter(|_| is_service).ok_or_else(no_service);
        let (request, response) = (part("_Request")?, part("_Response")?);
        let md5sum = match hand_made(&name) {
            Some(service) => service.md5sum.to_owned(),
            None => resolved.md5sum()?,
        };
        Ok(Self { name, request, response, text, md5sum })
    }

    /// `std_srvs/SetBool`: `type` of connection headers.
    pub fn ros1_name(&self) -> String {
        ros1_name(&self.name)
    }

    /// `std_srvs/SetBoolRequest`: `request_type` of connection headers.
    pub fn request_type(&self) -> String {
        match hand_made(&self.name) {
            Some(service) => service.request_type.to_owned(),
            None => format!("{}Request", self.ros1_name()),
        }
    }

    /// `std_srvs/SetBoolResponse`: `response_type` of connection headers.
    pub fn response_type(&self) -> String {
        match hand_made(&self.name) {
            Some(service) => service.response_type.to_owned(),
            None => format!("{}Response", self.ros1_name()),
        }
    }
}

/// Texts of the files by name of the type.
fn texts(
    store: &TypeStore,
    resolved: &ResolvedType,
) -> Result<BTreeMap<String, String>, DefinitionError> {
    let sources = store.sources(resolved)?.into_iter();
    let files = sources.filter(|source| source.encoding != "implicit");
    Ok(files.map(|source| (source.type_name, source.raw_file_contents)).collect())
}

/// The text with all it refers to, in the order of `gendeps --cat`.
fn full_text(name: &TypeName, resolved: &ResolvedType, texts: &BTreeMap<String, String>) -> String {
    let definitions = resolved.definitions();
    let is_service = name.kind() == InterfaceKind::Service;
    let parts: Vec<&MessageDefinition> = if is_service {
        let part = |suffix| definitions.get(&name.derived(suffix));
        [part("_Request"), part("_Response")].into_iter().flatten().collect()
    } else {
        definitions.get(name).into_iter().collect()
    };
    let written = || {
        let parts = parts.iter().map(|part| definition_text(part));
        parts.collect::<Vec<_>>().join("---\n")
    };
    let mut text = texts.get(&name.to_string()).cloned().unwrap_or_else(written);
    let mut seen = BTreeSet::new();
    // Last in, first out: the first field's type and all below it come first.
    let mut waiting: Vec<&TypeName> = parts.iter().rev().flat_map(|part| nested(part)).collect();
    while let Some(name) = waiting.pop() {
        let Some(definition) = definitions.get(name).filter(|_| seen.insert(name)) else {
            continue;
        };
        let own = texts.get(&name.to_string()).cloned();
        let own = own.unwrap_or_else(|| definition_text(definition));
        text.push_str(&format!("\n{}\nMSG: {}\n{own}", "=".repeat(80), ros1_name(name)));
        waiting.extend(nested(definition));
    }
    text
}

/// One definition as text, without comments: constants first, as checksums want them.
fn definition_text(definition: &MessageDefinition) -> String {
    let constants = definition
        .constants
        .iter()
        .map(|constant| format!("{} {}={}\n", constant.element, constant.name, constant.written));
    let fields = definition.fields.iter().map(|field| {
        let element = match &field.field_type.element {
            Element::Nested(name) => {
                ros1_builtin(name).map_or_else(|| ros1_name(name), str::to_owned)
            }
            element => element.to_string(),
        };
        format!("{element}{} {}\n", field.field_type.container, field.name)
    });
    constants.chain(fields).collect()
}

/// Types of the fields that ROS 1 does not have built in, the last field's first.
pub(super) fn nested(definition: &MessageDefinition) -> impl Iterator<Item = &TypeName> {
    definition.fields.iter().rev().filter_map(|field| match &field.field_type.element {
        Element::Nested(name) if ros1_builtin(name).is_none() => Some(name),
        _ => None,
    })
}
