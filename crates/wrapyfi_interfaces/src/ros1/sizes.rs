//! Least sizes of types: what a count in a message is compared with.

use std::collections::BTreeMap;

use super::matching::Definitions;
use crate::parser::{Container, Element, TypeName};

/// Least sizes of the types of one ROS, without padding.
#[derive(Debug)]
pub(super) struct Sizes<'d> {
    definitions: &'d Definitions,
    cdr: bool,
    known: BTreeMap<&'d TypeName, usize>,
}

impl<'d> Sizes<'d> {
    /// `cdr`: as ROS 2 writes them.
    pub(super) fn new(definitions: &'d Definitions, cdr: bool) -> Self {
        Self { definitions, cdr, known: BTreeMap::new() }
    }

    /// Least number of bytes of one element.
    pub(super) fn least(&mut self, element: &'d Element) -> usize {
        let name = match element {
            Element::Primitive(primitive) => return primitive.size(),
            // The length. CDR counts the terminator, but readers take a length of 0.
            Element::String { .. } | Element::WString { .. } => return 4,
            Element::Nested(name) => name,
        };
        if let Some(size) = self.known.get(name) {
            return *size;
        }
        let message = self.definitions.get(name);
        let fields = message.map(|message| message.fields.as_slice()).unwrap_or_default();
        // CDR has a byte in a message without fields.
        let mut size = usize::from(self.cdr && fields.is_empty());
        for field in fields {
            let element = &field.field_type.element;
            size = size.saturating_add(match field.field_type.container {
                Container::Single => self.least(element),
                Container::Array(count) => self.least(element).saturating_mul(count as usize),
                Container::Sequence { .. } => 4,
            });
        }
        self.known.insert(name, size);
        size
    }
}
