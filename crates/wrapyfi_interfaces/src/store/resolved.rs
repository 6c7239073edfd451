//! A type with all that it refers to.

use std::collections::BTreeMap;

use super::text::parse_full;
use super::{Looked, Md5Error, ResolveError, bundled, md5};
use crate::description::{DescribeError, MAX_TYPES, TypeDescription, describe};
use crate::dynamic::{PlanError, TypePlan};
use crate::hash::type_hash;
use crate::parser::{Dialect, Element, MessageDefinition, TypeName};

/// A type whose every nested type is known, without cycles and not too deep.
#[derive(Debug, Clone, PartialEq)]
pub struct ResolvedType {
    name: TypeName,
    dialect: Dialect,
    definitions: BTreeMap<TypeName, MessageDefinition>,
    description: TypeDescription,
}

impl ResolvedType {
    /// Reads a full definition text: the type itself, then `MSG: package/Type` sections behind
    /// lines of `=`, as in ROS 1 connection headers and MCAP files.
    ///
    /// ```
    /// use wrapyfi_interfaces::parser::{Dialect, TypeName};
    /// use wrapyfi_interfaces::store::ResolvedType;
    /// let name = TypeName::parse(Dialect::Ros1, "demo/Stamped").unwrap();
    /// let text = "Point at\n================\nMSG: demo/Point\nfloat64 x\nfloat64 y\n";
    /// let stamped = ResolvedType::from_text(Dialect::Ros1, &name, text).unwrap();
    /// assert_eq!(stamped.description().referenced_type_descriptions.len(), 1);
    /// ```
    ///
    /// # Errors
    /// When the text is too large, cannot be parsed, or lacks a type.
    pub fn from_text(dialect: Dialect, name: &TypeName, text: &str) -> Result<Self, ResolveError> {
        let known = parse_full(dialect, name, text)?;
        let looked = format!("it among the {} types of the definition text", known.len());
        Self::among(dialect, name, &known, &Looked(vec![looked]))
    }

    /// A type of definitions that are given, beside those that every program has.
    pub(crate) fn among(
        dialect: Dialect,
        name: &TypeName,
        known: &BTreeMap<TypeName, MessageDefinition>,
        looked: &Looked,
    ) -> Result<Self, ResolveError> {
        Self::collect(dialect, name, |wanted, user| {
            let found = known.get(wanted).cloned().or_else(|| bundled::definition(wanted));
            found.ok_or_else(|| ResolveError::NotFound {
                name: wanted.clone(),
                user: user.cloned(),
                looked: looked.clone(),
            })
        })
    }

    /// Asks `find` for `name` and all that it refers to, for each once.
    pub(crate) fn collect(
        dialect: Dialect,
        name: &TypeName,
        mut find: impl FnMut(&TypeName, Option<&TypeName>) -> Result<MessageDefinition, ResolveError>,
    ) -> Result<Self, ResolveError> {
        let mut definitions = BTreeMap::new();
        let mut waiting = vec![(name.clone(), None)];
        while let Some((wanted, user)) = waiting.pop() {
            if definitions.contains_key(&wanted) {
                continue;
            }
            if definitions.len() > MAX_TYPES {
                return Err(DescribeError::too_many(name).into());
            }
            let definition = find(&wanted, user.as_ref())?;
            for field in &definition.fields {
                if let Element::Nested(nested) = &field.field_type.element {
                    waiting.push((nested.clone(), Some(wanted.clone())));
                }
            }
            definitions.insert(wanted, definition);
        }
        let root = definitions.get(name).ok_or_else(|| ResolveError::NotFound {
            name: name.clone(),
            user: None,
            looked: Looked::default(),
        })?;
        let description = describe(root, &definitions)?;
        Ok(Self { name: name.clone(), dialect, definitions, description })
    }

    /// A part of a service or an action by the suffix of its name, such as `_Request`, with all that
    /// it refers to; `None` where there is no such part.
    pub fn part(&self, suffix: &str) -> Option<Self> {
        let part = self.name.derived(suffix);
        Self::among(self.dialect, &part, &self.definitions, &Looked::default()).ok()
    }

    /// Name of the type.
    pub fn name(&self) -> &TypeName {
        &self.name
    }

    /// The definition of the type.
    pub fn definition(&self) -> Option<&MessageDefinition> {
        self.definitions.get(&self.name)
    }

    /// All definitions, the type's own among them.
    pub fn definitions(&self) -> &BTreeMap<TypeName, MessageDefinition> {
        &self.definitions
    }

    /// The type description, from which a [`TypePlan`](crate::dynamic::TypePlan) is compiled.
    pub fn description(&self) -> &TypeDescription {
        &self.description
    }

    /// The REP-2016 hash, `RIHS01_…`.
    pub fn type_hash(&self) -> String {
        type_hash(&self.description)
    }

    /// Plan that reads and writes messages of the type.
    ///
    /// # Errors
    /// When its fixed arrays are too large.
    pub fn plan(&self) -> Result<TypePlan, PlanError> {
        TypePlan::compile(&self.name, &self.definitions)
    }

    /// The ROS 1 checksum of the definition as it stands. That of a ROS 2 definition is the one of
    /// ROS 1 where both write the same, which is not so for `std_msgs/Header` and all that has one.
    ///
    /// # Errors
    /// For actions, and for types that ROS 1 cannot express.
    pub fn md5sum(&self) -> Result<String, Md5Error> {
        md5::md5sum(&self.name, &self.definitions)
    }
}
