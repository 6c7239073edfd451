//! Type descriptions: a definition flattened with everything it refers to.
//!
//! These are the structures of `type_description_interfaces/msg/TypeDescription` (REP-2016),
//! from which the type hash is computed and values are encoded at run time.
//!
//! ```text
//!   PoseStamped ─┬─ Header ── Time          TypeDescription {
//!                └─ Pose ─┬─ Point            type_description: PoseStamped
//!                         └─ Quaternion       referenced: Header, Time, Point, Pose, Quaternion
//!                                           }
//! ```

use std::collections::BTreeMap;

use crate::parser::{
    Container, DefaultValue, Element, Field, FieldType, MessageDefinition, Primitive, TypeName,
};

/// Deepest nesting of messages in messages.
pub const MAX_DEPTH: usize = 64;

/// Largest number of types one type may refer to.
pub const MAX_TYPES: usize = 1024;

/// Name of the byte that stands in a message without fields.
pub const HIDDEN_FIELD: &str = "structure_needs_at_least_one_member";

/// A type and all types it refers to, directly or not.
#[derive(Debug, Clone, PartialEq)]
pub struct TypeDescription {
    /// The type itself.
    pub type_description: IndividualTypeDescription,
    /// The types it refers to, sorted by name.
    pub referenced_type_descriptions: Vec<IndividualTypeDescription>,
}

/// One type without those it refers to.
#[derive(Debug, Clone, PartialEq)]
pub struct IndividualTypeDescription {
    /// ROS name, for instance `sensor_msgs/msg/Image`.
    pub type_name: String,
    /// Fields in order; never empty.
    pub fields: Vec<FieldDescription>,
}

/// A field.
#[derive(Debug, Clone, PartialEq)]
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
    /// Value in a freshly made message, where the definition states one;
    /// [`DefaultValue::to_python`] writes it as type descriptions on the wire do.
    pub default: Option<DefaultValue>,
}

/// Error of describing a type.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct DescribeError(String);

impl DescribeError {
    /// Error of a type that refers to too many others.
    pub(crate) fn too_many(name: &TypeName) -> Self {
        Self(format!(
            "{name} refers to more than {MAX_TYPES} types; split it into several messages"
        ))
    }
}

/// Describes `definition`, looking up the types it refers to in `definitions`.
///
/// # Errors
/// When a type is missing or contains itself, and beyond [`MAX_DEPTH`] and [`MAX_TYPES`].
pub fn describe(
    definition: &MessageDefinition,
    definitions: &BTreeMap<TypeName, MessageDefinition>,
) -> Result<TypeDescription, DescribeError> {
    let mut closure = Closure { definitions, heights: BTreeMap::new(), open: Vec::new() };
    closure.visit(definition)?;
    closure.heights.remove(&definition.name);
    // ROS sorts by the name as text.
    let referenced: BTreeMap<String, &TypeName> =
        closure.heights.keys().map(|name| (name.to_string(), *name)).collect();
    Ok(TypeDescription {
        type_description: describe_one(definition),
        referenced_type_descriptions: referenced
            .into_values()
            .filter_map(|name| definitions.get(name))
            .map(describe_one)
            .collect(),
    })
}

/// All that a type refers to, found depth first.
struct Closure<'d> {
    definitions: &'d BTreeMap<TypeName, MessageDefinition>,
    /// Types seen in full, and how many messages deep each of them is.
    heights: BTreeMap<&'d TypeName, usize>,
    /// Types from the one described down to the one being seen.
    open: Vec<&'d TypeName>,
}

impl<'d> Closure<'d> {
    fn visit(&mut self, user: &'d MessageDefinition) -> Result<usize, DescribeError> {
        self.open.push(&user.name);
        let mut height = 0;
        for Field { name: field, field_type, .. } in &user.fields {
            let Element::Nested(name) = &field_type.element else { continue };
            if self.open.contains(&name) {
                let user = &user.name;
                return Err(DescribeError(format!(
                    "{name} contains itself through {user}; a message cannot be recursive"
                )));
            }
            let nested = match self.heights.get(name) {
                Some(height) => *height,
                None => {
                    let user = &user.name;
                    let undefined = || {
                        DescribeError(format!(
                            "{name} is not defined, but {user} has a field {field:?} of that type"
                        ))
                    };
                    let nested = self.definitions.get(name).ok_or_else(undefined)?;
                    // Before going on, since this function calls itself.
                    self.check_depth(name, 1)?;
                    self.visit(nested)?
                }
            };
            self.check_depth(name, nested)?;
            height = height.max(nested);
        }
        self.open.pop();
        self.heights.insert(&user.name, height + 1);
        if self.heights.len() > MAX_TYPES {
            let name = self.open.first().copied().unwrap_or(&user.name);
            return Err(DescribeError::too_many(name));
        }
        Ok(height + 1)
    }

    /// Checks that a type `height` messages deep fits below the open ones.
    fn check_depth(&self, name: &TypeName, height: usize) -> Result<(), DescribeError> {
        if self.open.len() + height <= MAX_DEPTH {
            return Ok(());
        }
        Err(DescribeError(format!(
            "{name} is nested more than {MAX_DEPTH} messages deep; make the definitions flatter"
        )))
    }
}

fn describe_one(definition: &MessageDefinition) -> IndividualTypeDescription {
    let mut fields: Vec<_> = definition.fields.iter().map(describe_field).collect();
    if fields.is_empty() {
        // IDL knows no empty struct: rosidl puts one hidden byte into it.
        let hidden = Element::Primitive(Primitive::Uint8);
        fields.push(describe_field(&Field::new(HIDDEN_FIELD, hidden, Container::Single)));
    }
    IndividualTypeDescription { type_name: definition.name.to_string(), fields }
}

fn describe_field(field: &Field) -> FieldDescription {
    let Field { name, field_type: FieldType { element, container }, default, .. } = field;
    let (element_id, string_capacity, nested_type_name) = match element {
        Element::Primitive(primitive) => (primitive_id(*primitive), 0, String::new()),
        Element::String { bound: None } => (17, 0, String::new()),
        Element::WString { bound: None } => (18, 0, String::new()),
        Element::String { bound: Some(bound) } => (21, u64::from(*bound), String::new()),
        Element::WString { bound: Some(bound) } => (22, u64::from(*bound), String::new()),
        Element::Nested(nested) => (1, 0, nested.to_string()),
    };
    let (container_id, capacity) = match *container {
        Container::Single => (0, 0),
        Container::Array(size) => (48, u64::from(size)),
        Container::Sequence { bound: Some(bound) } => (96, u64::from(bound)),
        Container::Sequence { bound: None } => (144, 0),
    };
    FieldDescription {
        name: name.clone(),
        type_id: element_id + container_id,
        capacity,
        string_capacity,
        nested_type_name,
        default: default.clone(),
    }
}

/// Distance of the numbers of an element alone, in an array, and in the two kinds of sequences.
pub const CONTAINER_STEP: u8 = 48;

/// The primitive with this number; `char` is `uint8` there.
pub(crate) fn primitive_of_id(id: u8) -> Option<Primitive> {
    Primitive::ALL
        .into_iter()
        .filter(|one| *one != Primitive::Char)
        .find(|one| primitive_id(*one) == id)
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
