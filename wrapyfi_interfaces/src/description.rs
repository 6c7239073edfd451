//! Type descriptions: a definition flattened with everything it refers to.
//!
//! These are the structures of `type_description_interfaces/msg/TypeDescription` (REP-2016),
//! from which the type hash is computed.

use std::collections::BTreeMap;

use crate::parser::{Container, Element, FieldType, MessageDefinition, Primitive, TypeName};

/// A type and all types it refers to, directly or not.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TypeDescription {
    /// The type itself.
    pub type_description: IndividualTypeDescription,
    /// The types it refers to, sorted by name.
    pub referenced_type_descriptions: Vec<IndividualTypeDescription>,
}

/// One type without those it refers to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct IndividualTypeDescription {
    /// ROS name, for instance `sensor_msgs/msg/Image`.
    pub type_name: String,
    /// Fields in order; never empty.
    pub fields: Vec<FieldDescription>,
}

/// A field.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FieldDescription {
    /// Name.
    pub name: String,
    /// `FieldType.type_id`: 1 to 22 for an element, plus 48 for an array, 96 for a bounded and
    /// 144 for an unbounded sequence.
    pub type_id: u8,
    /// Elements of an array, largest number of elements of a bounded sequence, else 0.
    pub capacity: u64,
    /// Bound of a string, else 0.
    pub string_capacity: u64,
    /// Name of a nested type, else empty.
    pub nested_type_name: String,
}

/// Why a type could not be described.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum DescribeError {
    /// A type that is referred to is not defined.
    #[error("{missing} is not defined, but {user} has a field {field:?} of that type")]
    Undefined {
        /// The type that is missing.
        missing: TypeName,
        /// Type that refers to it.
        user: TypeName,
        /// Field that does.
        field: String,
    },
    /// A type contains itself.
    #[error("{name} contains itself through {user}; a message cannot be recursive")]
    Recursive {
        /// The type.
        name: TypeName,
        /// Type that refers to it.
        user: TypeName,
    },
}

/// Describes `definition`, looking up the types it refers to in `definitions`.
///
/// # Errors
/// When a type is missing or contains itself.
pub fn describe(
    definition: &MessageDefinition,
    definitions: &BTreeMap<TypeName, MessageDefinition>,
) -> Result<TypeDescription, DescribeError> {
    let mut referenced = BTreeMap::new();
    let mut waiting = vec![definition];
    while let Some(user) = waiting.pop() {
        for field in &user.fields {
            let Element::Nested(name) = &field.field_type.element else { continue };
            if *name == definition.name {
                return Err(DescribeError::Recursive {
                    name: name.clone(),
                    user: user.name.clone(),
                });
            }
            if referenced.contains_key(name) {
                continue;
            }
            let nested = definitions.get(name).ok_or_else(|| DescribeError::Undefined {
                missing: name.clone(),
                user: user.name.clone(),
                field: field.name.clone(),
            })?;
            referenced.insert(name.clone(), describe_one(nested));
            waiting.push(nested);
        }
    }
    Ok(TypeDescription {
        type_description: describe_one(definition),
        referenced_type_descriptions: referenced.into_values().collect(),
    })
}

fn describe_one(definition: &MessageDefinition) -> IndividualTypeDescription {
    let mut fields: Vec<_> = definition
        .fields
        .iter()
        .map(|field| describe_field(&field.name, &field.field_type))
        .collect();
    if fields.is_empty() {
        // IDL knows no empty struct: rosidl puts one hidden byte into it.
        fields.push(FieldDescription {
            name: "structure_needs_at_least_one_member".to_owned(),
            type_id: primitive_id(Primitive::Uint8),
            capacity: 0,
            string_capacity: 0,
            nested_type_name: String::new(),
        });
    }
    IndividualTypeDescription { type_name: definition.name.to_string(), fields }
}

fn describe_field(name: &str, field_type: &FieldType) -> FieldDescription {
    let (element_id, string_capacity, nested_type_name) = match &field_type.element {
        Element::Primitive(primitive) => (primitive_id(*primitive), 0, String::new()),
        Element::String { bound: None } => (17, 0, String::new()),
        Element::WString { bound: None } => (18, 0, String::new()),
        Element::String { bound: Some(bound) } => (21, u64::from(*bound), String::new()),
        Element::WString { bound: Some(bound) } => (22, u64::from(*bound), String::new()),
        Element::Nested(nested) => (1, 0, nested.to_string()),
    };
    let (container_id, capacity) = match field_type.container {
        Container::Single => (0, 0),
        Container::Array(size) => (48, u64::from(size)),
        Container::Sequence { bound: Some(bound) } => (96, u64::from(bound)),
        Container::Sequence { bound: None } => (144, 0),
    };
    FieldDescription {
        name: name.to_owned(),
        type_id: element_id + container_id,
        capacity,
        string_capacity,
        nested_type_name,
    }
}

fn primitive_id(primitive: Primitive) -> u8 {
    match primitive {
        Primitive::Int8 => 2,
        Primitive::Uint8 | Primitive::Char => 3,
        Primitive::Int16 => 4,
        Primitive::Uint16 => 5,
        Primitive::Int32 => 6,
        Primitive::Uint32 => 7,
        Primitive::Int64 => 8,
        Primitive::Uint64 => 9,
        Primitive::Float32 => 10,
        Primitive::Float64 => 11,
        Primitive::Bool => 15,
        Primitive::Byte => 16,
    }
}
