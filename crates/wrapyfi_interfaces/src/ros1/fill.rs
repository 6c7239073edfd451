//! Fields that only one side has: passed over in the source, given their default in the target.

use super::error::PairError;
use super::matching::Definitions;
use super::op::{Count, Each, Op, PathId, push};
use crate::parser::{
    Container, DefaultValue, Element, Field, Literal, MessageDefinition, Primitive, TypeName,
};

/// Elements of a fixed array that are written one by one; more make a loop.
const MOST_UNROLLED: usize = 8;

/// A string without characters in CDR: its terminator counts.
const EMPTY_TEXT: [u8; 5] = [1, 0, 0, 0, 0];

/// Writes defaults: zeros in ROS 1, and in ROS 2 what the definition states. Passes over what the target lacks.
#[derive(Debug)]
pub(super) struct OneSided<'d> {
    pub(super) definitions: &'d Definitions,
    pub(super) cdr: bool,
    /// Fields that may still come.
    pub(super) left: usize,
    pub(super) at: PathId,
}

impl<'d> OneSided<'d> {
    fn message(&mut self, name: &TypeName) -> Result<&'d MessageDefinition, PairError> {
        let message = self.definitions.get(name);
        let message = message.ok_or_else(|| PairError::Undefined(name.clone()))?;
        let left = self.left.checked_sub(message.fields.len() + 1);
        self.left = left.ok_or_else(|| PairError::TooComplex {
            name: name.clone(),
            what: "fields",
            limit: super::compile::MAX_FIELDS,
        })?;
        Ok(message)
    }

    pub(super) fn fill(&mut self, field: &Field, ops: &mut Vec<Op>) -> Result<(), PairError> {
        let (element, at) = (&field.field_type.element, self.at);
        let literals = match &field.default {
            Some(DefaultValue::One(literal)) => std::slice::from_ref(literal),
            Some(DefaultValue::Many(literals)) => literals.as_slice(),
            None => &[],
        };
        match field.field_type.container {
            Container::Single => match literals.first() {
                Some(literal) => literal_op(element, literal, at, ops),
                None => self.fill_element(element, ops)?,
            },
            Container::Array(_) if !literals.is_empty() => {
                literals.iter().for_each(|literal| literal_op(element, literal, at, ops));
            }
            Container::Array(count) => self.fill_array(element, count as usize, ops)?,
            Container::Sequence { .. } => {
                let count = u32::try_from(literals.len()).unwrap_or_default();
                push(ops, Op::Put { align: 4, bytes: count.to_le_bytes().to_vec(), at });
                literals.iter().for_each(|literal| literal_op(element, literal, at, ops));
            }
        }
        Ok(())
    }

    fn fill_array(
        &mut self,
        element: &Element,
        count: usize,
        ops: &mut Vec<Op>,
    ) -> Result<(), PairError> {
        let at = self.at;
        if let Element::Primitive(primitive) = element {
            let size = primitive.size().saturating_mul(count);
            push(ops, Op::Zeros { align: primitive.size(), size, at });
            return Ok(());
        }
        let mut body = Vec::new();
        self.fill_element(element, &mut body)?;
        match body.as_slice() {
            [] => {}
            [Op::Zeros { align, size, .. }] if size.is_multiple_of(*align) => {
                push(ops, Op::Zeros { align: *align, size: size.saturating_mul(count), at });
            }
            _ if count <= MOST_UNROLLED && body.len() <= MOST_UNROLLED => {
                (0..count).for_each(|_| body.iter().for_each(|op| push(ops, op.clone())));
            }
            _ => ops.push(Op::Each(Each {
                count: Count::Fixed(count),
                body,
                from_min: 0,
                to_min: 1,
                at,
            })),
        }
        Ok(())
    }

    fn fill_element(&mut self, element: &Element, ops: &mut Vec<Op>) -> Result<(), PairError> {
        let at = self.at;
        match element {
            Element::Primitive(primitive) => {
                push(ops, Op::Zeros { align: primitive.size(), size: primitive.size(), at });
            }
            Element::String { .. } if self.cdr => {
                push(ops, Op::Put { align: 4, bytes: EMPTY_TEXT.to_vec(), at });
            }
            Element::String { .. } | Element::WString { .. } => {
                push(ops, Op::Zeros { align: 4, size: 4, at });
            }
            Element::Nested(name) => {
                let message = self.message(name)?;
                if self.cdr && message.fields.is_empty() {
                    push(ops, Op::Zeros { align: 1, size: 1, at });
                }
                for field in &message.fields {
                    self.fill(field, ops)?;
                }
            }
        }
        Ok(())
    }

    /// Passes over a field of the source.
    pub(super) fn skip(&mut self, field: &Field, ops: &mut Vec<Op>) -> Result<(), PairError> {
        let (mut body, at) = (Vec::new(), self.at);
        self.skip_element(&field.field_type.element, &mut body)?;
        match (field.field_type.container, body.as_slice()) {
            (Container::Single, _) => body.into_iter().for_each(|op| push(ops, op)),
            (Container::Array(count), [Op::SkipBlock { align, size, .. }])
                if size.is_multiple_of(*align) =>
            {
                let size = size.saturating_mul(count as usize);
                push(ops, Op::SkipBlock { align: *align, size, at });
            }
            (Container::Array(_), []) => {}
            (Container::Array(count), _) => {
                let count = Count::Fixed(count as usize);
                ops.push(Op::Each(Each { count, body, from_min: 0, to_min: 0, at }));
            }
            (Container::Sequence { .. }, [Op::SkipBlock { align, size, .. }])
                if size.is_multiple_of(*align) =>
            {
                push(ops, Op::SkipBlocks { align: *align, size: *size, at });
            }
            // Messages that are nothing: only their number is there.
            (Container::Sequence { .. }, []) => {
                push(ops, Op::SkipBlock { align: 4, size: 4, at });
            }
            (Container::Sequence { .. }, _) => {
                let each = Each { count: Count::Skipped, body, from_min: 1, to_min: 0, at };
                ops.push(Op::Each(each));
            }
        }
        Ok(())
    }

    fn skip_element(&mut self, element: &Element, ops: &mut Vec<Op>) -> Result<(), PairError> {
        let at = self.at;
        match element {
            Element::Primitive(primitive) => {
                push(ops, Op::SkipBlock { align: primitive.size(), size: primitive.size(), at });
            }
            Element::String { .. } => push(ops, Op::SkipText { wide: false, at }),
            Element::WString { .. } => push(ops, Op::SkipText { wide: true, at }),
            Element::Nested(name) => {
                let message = self.message(name)?;
                if self.cdr && message.fields.is_empty() {
                    push(ops, Op::SkipBlock { align: 1, size: 1, at });
                }
                for field in &message.fields {
                    self.skip(field, ops)?;
                }
            }
        }
        Ok(())
    }
}

/// A stated value. Only ROS 2 has them.
fn literal_op(element: &Element, literal: &Literal, at: PathId, ops: &mut Vec<Op>) {
    match (element, literal) {
        (Element::Primitive(primitive), literal) => {
            let bytes = number(*primitive, literal);
            push(ops, Op::Put { align: primitive.size(), bytes, at });
        }
        (Element::WString { .. }, Literal::Text(text)) => {
            let units: Vec<u16> = text.encode_utf16().collect();
            let mut bytes = u32::try_from(units.len()).unwrap_or_default().to_le_bytes().to_vec();
            bytes.extend(units.iter().flat_map(|unit| u32::from(*unit).to_le_bytes()));
            push(ops, Op::Put { align: 4, bytes, at });
        }
        (_, Literal::Text(text)) => {
            let size = u32::try_from(text.len() + 1).unwrap_or_default();
            let mut bytes = size.to_le_bytes().to_vec();
            bytes.extend(text.as_bytes());
            bytes.push(0);
            push(ops, Op::Put { align: 4, bytes, at });
        }
        _ => {} // the parser lets no other value through
    }
}

/// A number as both sides write it.
fn number(primitive: Primitive, literal: &Literal) -> Vec<u8> {
    let size = primitive.size();
    let bytes = match literal {
        Literal::Bool(value) => u64::from(*value).to_le_bytes(),
        Literal::Float(value) if primitive == Primitive::Float32 => {
            // To the nearest, as rosidl does.
            let bits = (*value as f32).to_bits();
            u64::from(bits).to_le_bytes()
        }
        Literal::Float(value) => value.to_le_bytes(),
        // Two's complement: its lower bytes are the number in any size.
        Literal::Integer(value) => {
            let bytes = value.to_le_bytes();
            bytes.first_chunk().copied().unwrap_or_default()
        }
        Literal::Text(_) => [0; 8],
    };
    bytes.get(..size).unwrap_or_default().to_vec()
}
