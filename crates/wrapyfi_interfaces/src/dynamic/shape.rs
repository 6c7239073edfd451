//! The compiled form of a message type.
//!
//! ```text
//!   Header            ops: Field(stamp), Field(frame_id)
//!     stamp: Time            ops: Run(sec, nanosec)        one bounds check for both
//!     frame_id: string
//! ```

use std::collections::HashMap;
use std::sync::Arc;

use hmac_sha256::Hash;

use super::scalar::with_scalar;
use super::{DynamicMessage, DynamicValue, Primitives, ValueError};
use crate::parser::{Container, Primitive};

/// A message type, ready for values. Shapes of nested messages are shared, never recursive.
#[derive(Debug)]
pub(super) struct Shape {
    pub(super) name: String,
    /// Digest of names and types, nested ones included: comparing fields with fields would take
    /// for ever where few shapes refer to each other in very many ways.
    pub(super) identity: [u8; 32],
    pub(super) fields: Vec<FieldShape>,
    pub(super) positions: HashMap<String, usize>,
    /// Steps that read or write all fields in order.
    pub(super) ops: Vec<Op>,
    /// Least number of bytes in CDR, without padding.
    pub(super) min_size: usize,
    /// Values in a message whose sequences are empty: what fixed arrays of messages multiply.
    pub(super) values: usize,
    /// Bytes that the fields of a freshly made message take.
    pub(super) default_size: usize,
}

/// A field.
#[derive(Debug)]
pub(super) struct FieldShape {
    pub(super) name: String,
    pub(super) element: ElementShape,
    pub(super) container: Container,
    /// Default value, where the definition states one.
    pub(super) default: Option<DynamicValue>,
}

/// Kind of one element of a field.
#[derive(Debug)]
pub(super) enum ElementShape {
    Primitive(Primitive),
    Text { wide: bool, bound: Option<u32> },
    Message(Arc<Shape>),
}

/// One step of reading and writing.
#[derive(Debug)]
pub(super) enum Op {
    /// Single primitives in a row.
    Run(Run),
    /// Any other field, by its position.
    Field(usize),
}

/// Single primitives in a row. Their padding depends only on where the first of them lies between
/// two multiples of eight, so it is known beforehand for each of the eight cases.
#[derive(Debug)]
pub(super) struct Run {
    /// Position of the first field.
    pub(super) first: usize,
    pub(super) members: Vec<Member>,
    /// Bytes from the start to the end of the last member.
    pub(super) sizes: [usize; 8],
}

/// A member of a run.
#[derive(Debug)]
pub(super) struct Member {
    pub(super) primitive: Primitive,
    /// First byte of each, from the start of the run.
    pub(super) offsets: [usize; 8],
}

impl Run {
    pub(super) fn new(first: usize) -> Self {
        Self { first, members: Vec::new(), sizes: [0; 8] }
    }

    pub(super) fn push(&mut self, primitive: Primitive) {
        let mut offsets = self.sizes;
        for (phase, (offset, size)) in offsets.iter_mut().zip(&mut self.sizes).enumerate() {
            *offset = (phase + *size).next_multiple_of(primitive.size()) - phase;
            *size = *offset + primitive.size();
        }
        self.members.push(Member { primitive, offsets });
    }
}

impl Shape {
    /// The field of that name.
    pub(super) fn field(&self, name: &str) -> Option<(usize, &FieldShape)> {
        let position = *self.positions.get(name)?;
        self.fields.get(position).map(|field| (position, field))
    }

    /// Digest of the name and the fields, for [`Shape::identity`].
    pub(super) fn digest(&self) -> [u8; 32] {
        let mut digest = Hash::new();
        digest.update(&self.name);
        for field in &self.fields {
            // Names have no line breaks in them, so no two texts run together.
            digest.update(format!("\n{} {}\n", field.name, field.type_name()));
            if let ElementShape::Message(nested) = &field.element {
                digest.update(nested.identity);
            }
        }
        digest.finalize()
    }

    /// The error for a field that is not there.
    pub(super) fn unknown(&self, name: &str) -> ValueError {
        /// Similarity from which on two words look alike.
        const ALIKE: f64 = 0.7;
        let alike = |field: &FieldShape| strsim::jaro_winkler(&field.name, name);
        let suggestion = self
            .fields
            .iter()
            .map(|field| (alike(field), &field.name))
            .filter(|(alike, _)| *alike > ALIKE)
            .max_by(|(one, _), (other, _)| one.total_cmp(other))
            .map(|(_, name)| name.clone());
        ValueError::UnknownField { path: name.to_owned(), message: self.name.clone(), suggestion }
    }

    /// A freshly made message.
    pub(super) fn default_message(self: &Arc<Self>) -> DynamicMessage {
        let values = self.fields.iter().map(FieldShape::default_value).collect();
        DynamicMessage { shape: Arc::clone(self), values }
    }
}

impl ElementShape {
    /// Least number of bytes in CDR, without padding.
    pub(super) fn min_size(&self) -> usize {
        match self {
            Self::Primitive(primitive) => primitive.size(),
            Self::Text { .. } => 4,
            Self::Message(shape) => shape.min_size,
        }
    }

    /// Name in definitions.
    pub(super) fn name(&self) -> &str {
        match self {
            Self::Primitive(primitive) => primitive.name(),
            Self::Text { wide: false, .. } => "string",
            Self::Text { wide: true, .. } => "wstring",
            Self::Message(shape) => &shape.name,
        }
    }
}

impl FieldShape {
    /// Value in a freshly made message.
    pub(super) fn default_value(&self) -> DynamicValue {
        if let Some(value) = &self.default {
            return value.clone();
        }
        let count = match self.container {
            Container::Single => None,
            Container::Array(size) => Some(size as usize),
            Container::Sequence { .. } => Some(0),
        };
        match (&self.element, count) {
            (ElementShape::Primitive(primitive), None) => {
                with_scalar!(*primitive, T => T::default().into())
            }
            (ElementShape::Primitive(primitive), Some(count)) => {
                with_scalar!(*primitive, T => Primitives::from(vec![T::default(); count])).into()
            }
            (ElementShape::Text { .. }, None) => DynamicValue::Text(String::new()),
            (ElementShape::Text { .. }, Some(count)) => {
                DynamicValue::Texts(vec![String::new(); count])
            }
            (ElementShape::Message(shape), None) => DynamicValue::Message(shape.default_message()),
            // `vec!` makes its first element even where it needs none. Each sequence doing so,
            // types that refer to each other in very many ways would never be done.
            (ElementShape::Message(_), Some(0)) => DynamicValue::Messages(Vec::new()),
            (ElementShape::Message(shape), Some(count)) => {
                DynamicValue::Messages(vec![shape.default_message(); count])
            }
        }
    }

    /// Type as a definition writes it, for error texts.
    pub(super) fn type_name(&self) -> String {
        let bound = match self.element {
            ElementShape::Text { bound: Some(bound), .. } => format!("<={bound}"),
            _ => String::new(),
        };
        format!("{}{bound}{}", self.element.name(), self.container)
    }

    /// Checks that so many elements fit.
    pub(super) fn check_count(&self, actual: usize) -> Result<(), ValueError> {
        let Some(expected) = self.container.other_count(actual) else { return Ok(()) };
        Err(ValueError::Count { path: String::new(), actual, unit: "elements", expected })
    }

    /// Checks that a text is within the bound, which counts as ROS does: characters, as its setters
    /// do; code units for a wide string.
    pub(super) fn check_text(&self, text: &str) -> Result<(), ValueError> {
        let ElementShape::Text { wide, bound: Some(bound) } = self.element else { return Ok(()) };
        let actual = if wide { text.encode_utf16().count() } else { text.chars().count() };
        if actual <= bound as usize {
            return Ok(());
        }
        let expected = format!("at most {bound}");
        Err(ValueError::Count { path: String::new(), actual, unit: "characters", expected })
    }

    /// Checks that `value` is of the field's type.
    pub(super) fn check(&self, value: &DynamicValue) -> Result<(), ValueError> {
        let single = self.container == Container::Single;
        let fits = match (&self.element, value) {
            (ElementShape::Primitive(primitive), DynamicValue::Primitives(values)) => {
                self.check_count(values.len())?;
                !single && values.element_name() == element_name(*primitive)
            }
            (ElementShape::Primitive(primitive), value) => {
                single && value.kind_name() == element_name(*primitive)
            }
            (ElementShape::Text { .. }, DynamicValue::Text(text)) => {
                self.check_text(text)?;
                single
            }
            (ElementShape::Text { .. }, DynamicValue::Texts(texts)) => {
                self.check_count(texts.len())?;
                for (index, text) in texts.iter().enumerate() {
                    self.check_text(text).map_err(|error| error.in_element(index))?;
                }
                !single
            }
            (ElementShape::Message(shape), DynamicValue::Message(message)) => {
                single && same(shape, &message.shape)
            }
            (ElementShape::Message(shape), DynamicValue::Messages(messages)) => {
                self.check_count(messages.len())?;
                !single && messages.iter().all(|message| same(shape, &message.shape))
            }
            _ => false,
        };
        if fits {
            return Ok(());
        }
        Err(ValueError::Kind {
            path: String::new(),
            expected: self.type_name(),
            found: value.kind_name(),
        })
    }
}

/// True when two shapes are one, or equal.
pub(super) fn same(one: &Arc<Shape>, other: &Arc<Shape>) -> bool {
    Arc::ptr_eq(one, other) || one.identity == other.identity
}

/// As [`Primitives::element_name`].
fn element_name(primitive: Primitive) -> &'static str {
    match primitive {
        Primitive::Byte | Primitive::Char => "uint8",
        other => other.name(),
    }
}
