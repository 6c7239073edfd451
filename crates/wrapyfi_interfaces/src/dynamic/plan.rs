//! Definitions to plans.

use std::collections::{BTreeMap, HashMap};
use std::fmt;
use std::sync::Arc;

use super::default::default_value;
use super::shape::{ElementShape, FieldShape, Op, Run, Shape, same};
use super::{DynamicMessage, PlanError};
use crate::description::HIDDEN_FIELD;
use crate::parser::{Container, Element, MessageDefinition, Primitive, TypeName};

/// Largest message whose sequences are empty, in bytes.
pub const MAX_FIXED_SIZE: usize = 64 << 20;

/// Largest number of values in a message whose sequences are empty; a fixed array of primitives
/// is one of them.
pub const MAX_FIXED_VALUES: usize = 1 << 20;

/// Most values that a type may have for one byte. Real types have one or two.
const VALUES_PER_BYTE: usize = 8;

/// Steps that read, write and make messages of one type. Cheap to clone and to share.
///
/// ```
/// use wrapyfi_interfaces::parser::{Dialect, TypeName};
/// use wrapyfi_interfaces::store::ResolvedType;
/// let name = TypeName::parse(Dialect::Ros2, "demo_msgs/msg/Reading").unwrap();
/// let text = "string sensor \"left\"\nfloat64[] celsius\n";
/// let plan = ResolvedType::from_text(Dialect::Ros2, &name, text).unwrap().plan().unwrap();
///
/// let mut reading = plan.default_message();
/// reading.set("celsius", vec![20.5, 21.0]).unwrap();
/// let cdr = plan.encode(&reading).unwrap().to_bytes();
/// let again = plan.decode(&cdr, 1024).unwrap();
/// assert_eq!(again, reading);
/// assert_eq!(serde_json::to_string(&again).unwrap(), r#"{"sensor":"left","celsius":[20.5,21.0]}"#);
/// ```
#[derive(Clone)]
pub struct TypePlan {
    pub(super) shape: Arc<Shape>,
}

/// Plans are equal when names and types are, all the way down.
impl PartialEq for TypePlan {
    fn eq(&self, other: &Self) -> bool {
        same(&self.shape, &other.shape)
    }
}

impl fmt::Debug for TypePlan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("TypePlan").field(&self.shape.name).finish()
    }
}

impl TypePlan {
    /// Compiles a type from definitions that [`describe`](crate::description::describe) took: all that
    /// it refers to is there, none contains itself, and none is too deep.
    ///
    /// # Errors
    /// When it nests many messages around few bytes, or has fixed arrays beyond [`MAX_FIXED_SIZE`] or
    /// [`MAX_FIXED_VALUES`].
    pub(crate) fn compile(
        name: &TypeName,
        definitions: &BTreeMap<TypeName, MessageDefinition>,
    ) -> Result<Self, PlanError> {
        let mut compiler = Compiler { definitions, done: BTreeMap::new() };
        Ok(Self { shape: compiler.shape(name)? })
    }

    /// ROS name of the type, for instance `sensor_msgs/msg/JointState`.
    pub fn type_name(&self) -> &str {
        &self.shape.name
    }

    /// Least number of bytes of a serialised message, without padding and header.
    pub fn min_size(&self) -> usize {
        self.shape.min_size
    }

    /// A freshly made message: zeros, empty strings and sequences, and what the definition states.
    pub fn default_message(&self) -> DynamicMessage {
        self.shape.default_message()
    }
}

struct Compiler<'d> {
    definitions: &'d BTreeMap<TypeName, MessageDefinition>,
    done: BTreeMap<&'d TypeName, Arc<Shape>>,
}

impl<'d> Compiler<'d> {
    fn shape(&mut self, name: &TypeName) -> Result<Arc<Shape>, PlanError> {
        let undefined = || PlanError(format!("{name} is not defined; add it"));
        let (name, definition) = self.definitions.get_key_value(name).ok_or_else(undefined)?;
        if let Some(done) = self.done.get(name) {
            return Ok(Arc::clone(done));
        }
        let mut shape = Shape {
            name: name.to_string(),
            identity: [0; 32],
            fields: Vec::with_capacity(definition.fields.len()),
            positions: HashMap::new(),
            ops: Vec::new(),
            min_size: 0,
            values: 1,
            default_size: 0,
        };
        let hidden = matches!(definition.fields.as_slice(), [only] if only.name == HIDDEN_FIELD);
        for field in definition.fields.iter().filter(|_| !hidden) {
            let element = match &field.field_type.element {
                // As type descriptions have it.
                Element::Primitive(Primitive::Char) => ElementShape::Primitive(Primitive::Uint8),
                Element::Primitive(primitive) => ElementShape::Primitive(*primitive),
                Element::String { bound } => ElementShape::Text { wide: false, bound: *bound },
                Element::WString { bound } => ElementShape::Text { wide: true, bound: *bound },
                Element::Nested(nested) => ElementShape::Message(self.shape(nested)?),
            };
            let container = field.field_type.container;
            let default = field.default.as_ref().and_then(|it| default_value(&element, it));
            add(&mut shape, FieldShape { name: field.name.clone(), element, container, default })?;
        }
        // The hidden byte of a message without fields.
        shape.min_size = shape.min_size.max(1);
        shape.default_size = shape.default_size.max(1);
        let limit = shape.min_size.saturating_add(1).saturating_mul(VALUES_PER_BYTE);
        if shape.values > limit {
            // A small serialised message would take up much memory.
            return Err(PlanError(format!(
                "{} nests {} values around {} bytes, over the limit of {limit}; use fewer messages",
                shape.name, shape.values, shape.min_size
            )));
        }
        shape.identity = shape.digest();
        let shape = Arc::new(shape);
        self.done.insert(name, Arc::clone(&shape));
        Ok(shape)
    }
}

/// Adds a field to a shape, its steps and its sizes.
fn add(shape: &mut Shape, field: FieldShape) -> Result<(), PlanError> {
    let position = shape.fields.len();
    shape.positions.insert(field.name.clone(), position);
    match (single_primitive(&field), shape.ops.last_mut()) {
        (Some(primitive), Some(Op::Run(run))) => run.push(primitive),
        (Some(primitive), _) => {
            let mut run = Run::new(position);
            run.push(primitive);
            shape.ops.push(Op::Run(run));
        }
        (None, _) => shape.ops.push(Op::Field(position)),
    }
    let count = match field.container {
        Container::Single => 1,
        Container::Array(size) => size as usize,
        Container::Sequence { .. } => 0,
    };
    let length = if let Container::Sequence { .. } = field.container { 4 } else { 0 };
    let (values, default_size) = match &field.element {
        ElementShape::Primitive(primitive) => (1, primitive.size().saturating_mul(count)),
        ElementShape::Text { .. } => (count, count.saturating_mul(4)),
        ElementShape::Message(nested) => {
            (nested.values.saturating_mul(count), nested.default_size.saturating_mul(count))
        }
    };
    let stated = field.default.as_ref().map_or(0, super::json_in::stated_size);
    let min_size = field.element.min_size().saturating_mul(count).saturating_add(length);
    shape.values = shape.values.saturating_add(values);
    shape.min_size = shape.min_size.saturating_add(min_size);
    shape.default_size =
        shape.default_size.saturating_add(default_size).saturating_add(length + stated);
    let too_large = |actual: usize, unit: &str, limit: usize| {
        PlanError(format!(
            "{} has at least {actual} {unit}, over the limit of {limit}; use sequences for its \
             largest arrays",
            shape.name
        ))
    };
    if shape.default_size > MAX_FIXED_SIZE {
        return Err(too_large(shape.default_size, "bytes", MAX_FIXED_SIZE));
    }
    if shape.values > MAX_FIXED_VALUES {
        return Err(too_large(shape.values, "values", MAX_FIXED_VALUES));
    }
    shape.fields.push(field);
    Ok(())
}

fn single_primitive(field: &FieldShape) -> Option<Primitive> {
    match (&field.element, field.container) {
        (ElementShape::Primitive(primitive), Container::Single) => Some(*primitive),
        _ => None,
    }
}
