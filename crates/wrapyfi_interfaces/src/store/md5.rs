//! Checksums of ROS 1: the MD5 by which publisher and subscriber know that they mean the same.
//!
//! ```text
//!   2176decaecbce78abc3b96ef049fabed header     nested types by their own checksum
//!   uint32 height                               built-in types as written, constants before them
//!   …                                           no comments
//! ```

use std::collections::BTreeMap;

use super::text::ros1_builtin;
use crate::parser::{
    Container, Element, Field, FieldType, InterfaceKind, MessageDefinition, TypeName,
};

/// Error of a type that has no ROS 1 checksum.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Md5Error {
    /// A field is of a type that ROS 1 lacks.
    #[error(
        "{message} has the field `{field_type} {field}`, which ROS 1 cannot express; use a type \
         without bounds, default values and wide strings"
    )]
    OnlyRos2 {
        /// The message.
        message: TypeName,
        /// Type of the field.
        field_type: String,
        /// Name of the field.
        field: String,
    },
    /// A type that is referred to is not among the definitions.
    #[error("{0} has no ROS 1 checksum: it is not defined, or is an action; use a message")]
    Undefined(TypeName),
}

/// Checksum of `name`, a message or a service.
pub(super) fn md5sum(
    name: &TypeName,
    definitions: &BTreeMap<TypeName, MessageDefinition>,
) -> Result<String, Md5Error> {
    let mut sums = Sums { definitions, known: BTreeMap::new() };
    if name.kind() == InterfaceKind::Service && name.file_stem() == name.name() {
        // The two texts follow each other without a line break.
        let request = sums.text(&name.derived("_Request"))?;
        let response = sums.text(&name.derived("_Response"))?;
        return Ok(digest(&format!("{request}{response}")));
    }
    sums.sum(name)
}

fn digest(text: &str) -> String {
    format!("{:x}", md5::compute(text))
}

struct Sums<'d> {
    definitions: &'d BTreeMap<TypeName, MessageDefinition>,
    known: BTreeMap<TypeName, String>,
}

impl Sums<'_> {
    /// Depth is bounded, since the definitions were described before.
    fn sum(&mut self, name: &TypeName) -> Result<String, Md5Error> {
        if let Some(sum) = self.known.get(name) {
            return Ok(sum.clone());
        }
        let sum = digest(&self.text(name)?);
        self.known.insert(name.clone(), sum.clone());
        Ok(sum)
    }

    fn text(&mut self, name: &TypeName) -> Result<String, Md5Error> {
        let definition = self
            .definitions
            .get(name)
            .filter(|_| name.kind() != InterfaceKind::Action)
            .ok_or_else(|| Md5Error::Undefined(name.clone()))?;
        let mut lines: Vec<String> = definition
            .constants
            .iter()
            .map(|constant| format!("{} {}={}", constant.element, constant.name, constant.written))
            .collect();
        for Field { name: field, field_type, default, .. } in &definition.fields {
            let only_ros2 = || Md5Error::OnlyRos2 {
                message: name.clone(),
                field_type: field_type.to_string(),
                field: field.clone(),
            };
            let FieldType { element, container } = field_type;
            if default.is_some() || matches!(container, Container::Sequence { bound: Some(_) }) {
                return Err(only_ros2());
            }
            lines.push(match element {
                Element::Primitive(_) | Element::String { bound: None } => {
                    format!("{field_type} {field}")
                }
                Element::Nested(nested) => match ros1_builtin(nested) {
                    Some(builtin) => format!("{builtin}{container} {field}"),
                    // An array of messages counts as one message.
                    None => format!("{} {field}", self.sum(nested)?),
                },
                Element::String { bound: Some(_) } | Element::WString { .. } => {
                    return Err(only_ros2());
                }
            });
        }
        Ok(lines.join("\n").trim().to_owned())
    }
}
