//! Messages to CDR and back.

use std::sync::Arc;

use bytes::Bytes;

use super::scalar::with_scalar;
use super::shape::{ElementShape, FieldShape, Op, Run, Shape, same};
use super::{DynamicMessage, DynamicValue, Primitives, TypePlan, ValueError};
use crate::cdr::{CdrError, CdrParts, CdrReader, CdrWriter};
use crate::parser::{Container, Primitive};
use crate::with_elements;

impl TypePlan {
    /// Reads a serialised message of at most `max_bytes`, in either byte order. Its `uint8[]`
    /// fields share the memory of `cdr`. As in ROS 2, bounds are not checked.
    ///
    /// # Errors
    /// When it is too large, is not plain CDR, or a field is not there or not valid.
    pub fn decode(&self, cdr: &Bytes, max_bytes: usize) -> Result<DynamicMessage, CdrError> {
        read_message(&mut CdrReader::within(cdr, max_bytes)?, &self.shape)
    }

    /// As [`TypePlan::decode`], for what must be of this type and no other: nothing but the padding of
    /// DDS may follow the last field.
    ///
    /// # Errors
    /// As [`TypePlan::decode`], and [`CdrError::Trailing`].
    pub fn decode_exact(&self, cdr: &Bytes, max_bytes: usize) -> Result<DynamicMessage, CdrError> {
        /// DDS fills whole words of four bytes.
        const MOST_PADDING: usize = 3;
        let mut reader = CdrReader::within(cdr, max_bytes)?;
        let message = read_message(&mut reader, &self.shape)?;
        match reader.remaining() {
            0..=MOST_PADDING => Ok(message),
            left => Err(CdrError::Trailing(left)),
        }
    }

    /// Serialises a message, little-endian.
    ///
    /// # Errors
    /// When it is of another type.
    pub fn encode(&self, message: &DynamicMessage) -> Result<CdrParts, ValueError> {
        if same(&self.shape, &message.shape) {
            return Ok(message.encode());
        }
        let found = if message.shape.name == self.shape.name {
            "another definition of the same name".to_owned()
        } else {
            message.shape.name.clone()
        };
        Err(ValueError::Kind { path: String::new(), expected: self.shape.name.clone(), found })
    }
}

impl DynamicMessage {
    /// The serialised message, little-endian, with its encapsulation header. Large `uint8[]`
    /// fields are shared.
    pub fn encode(&self) -> CdrParts {
        let mut writer = CdrWriter::new();
        write_message(&mut writer, self);
        writer.finish()
    }
}

fn read_message(
    reader: &mut CdrReader<'_>,
    shape: &Arc<Shape>,
) -> Result<DynamicMessage, CdrError> {
    let mut values = Vec::with_capacity(shape.fields.len());
    for op in &shape.ops {
        match op {
            Op::Run(run) => read_run(reader, shape, run, &mut values)?,
            Op::Field(position) => {
                let Some(field) = shape.fields.get(*position) else { continue };
                values
                    .push(read_field(reader, field).map_err(|error| error.in_field(&field.name))?);
            }
        }
    }
    if shape.fields.is_empty() {
        reader.read_primitive::<u8>()?;
    }
    Ok(DynamicMessage { shape: Arc::clone(shape), values })
}

/// Reads single primitives in a row after one look at what is left.
fn read_run(
    reader: &mut CdrReader<'_>,
    shape: &Shape,
    run: &Run,
    values: &mut Vec<DynamicValue>,
) -> Result<(), CdrError> {
    let (phase, order) = (reader.phase(), reader.order());
    let of_phase = |table: &[usize; 8]| table.get(phase).copied().unwrap_or_default();
    let size = of_phase(&run.sizes);
    let available = reader.remaining();
    let bytes = reader.take(size).unwrap_or_default();
    for (index, member) in run.members.iter().enumerate() {
        let offset = of_phase(&member.offsets);
        let size = member.primitive.size();
        let value = bytes.get(offset..offset + size).and_then(|bytes| {
            with_scalar!(member.primitive, T => {
                <T as crate::cdr::CdrPrimitive>::extract(bytes, order).next().map(DynamicValue::from)
            })
        });
        match value {
            Some(value) => values.push(value),
            // The run as a whole does not fit: name the first member that does not.
            None if offset + size <= available => {}
            None => {
                let path = shape.fields.get(run.first + index).map(|field| field.name.clone());
                return Err(CdrError::Truncated {
                    path: path.unwrap_or_default(),
                    needed: size,
                    available: available.saturating_sub(offset),
                });
            }
        }
    }
    Ok(())
}

fn read_field(reader: &mut CdrReader<'_>, field: &FieldShape) -> Result<DynamicValue, CdrError> {
    let count = match field.container {
        Container::Single => return read_one(reader, &field.element),
        // Room is checked before memory is reserved, here and in `read_count`.
        Container::Array(size) => {
            reader.room_for(size as usize, field.element.min_size())?;
            size as usize
        }
        Container::Sequence { .. } => reader.read_count(field.element.min_size())?,
    };
    Ok(match &field.element {
        ElementShape::Primitive(primitive) => {
            DynamicValue::Primitives(read_primitives(reader, *primitive, count)?)
        }
        ElementShape::Text { wide, .. } => {
            DynamicValue::Texts(each(count, || read_text(reader, *wide))?)
        }
        ElementShape::Message(shape) => {
            DynamicValue::Messages(each(count, || read_message(reader, shape))?)
        }
    })
}

fn read_one(reader: &mut CdrReader<'_>, element: &ElementShape) -> Result<DynamicValue, CdrError> {
    match element {
        ElementShape::Primitive(primitive) => {
            with_scalar!(*primitive, T => reader.read_primitive::<T>().map(DynamicValue::from))
        }
        ElementShape::Text { wide, .. } => read_text(reader, *wide).map(DynamicValue::Text),
        ElementShape::Message(shape) => read_message(reader, shape).map(DynamicValue::Message),
    }
}

fn read_text(reader: &mut CdrReader<'_>, wide: bool) -> Result<String, CdrError> {
    if wide { reader.read_wstring() } else { reader.read_string() }
}

fn read_primitives(
    reader: &mut CdrReader<'_>,
    primitive: Primitive,
    count: usize,
) -> Result<Primitives, CdrError> {
    if count == 0 {
        // Without elements there is no padding either.
        return Ok(with_scalar!(primitive, T => Primitives::from(Vec::<T>::new())));
    }
    match primitive {
        Primitive::Byte | Primitive::Char | Primitive::Uint8 => {
            reader.read_byte_array(count).map(Primitives::Bytes)
        }
        other => with_scalar!(other, T => reader.read_primitives::<T>(count).map(Primitives::from)),
    }
}

fn each<T>(
    count: usize,
    mut read: impl FnMut() -> Result<T, CdrError>,
) -> Result<Vec<T>, CdrError> {
    let mut values = Vec::with_capacity(count);
    for index in 0..count {
        values.push(read().map_err(|error| error.in_element(index))?);
    }
    Ok(values)
}

fn write_message(writer: &mut CdrWriter, message: &DynamicMessage) {
    for (field, value) in message.shape.fields.iter().zip(&message.values) {
        write_field(writer, field, value);
    }
    if message.shape.fields.is_empty() {
        writer.write_primitive(0_u8);
    }
}

/// Values are of their fields' types: nothing else gets into a message.
fn write_field(writer: &mut CdrWriter, field: &FieldShape, value: &DynamicValue) {
    let counted = matches!(field.container, Container::Sequence { .. });
    let wide = matches!(field.element, ElementShape::Text { wide: true, .. });
    match value {
        DynamicValue::Bool(value) => writer.write_primitive(*value),
        DynamicValue::I8(value) => writer.write_primitive(*value),
        DynamicValue::U8(value) => writer.write_primitive(*value),
        DynamicValue::I16(value) => writer.write_primitive(*value),
        DynamicValue::U16(value) => writer.write_primitive(*value),
        DynamicValue::I32(value) => writer.write_primitive(*value),
        DynamicValue::U32(value) => writer.write_primitive(*value),
        DynamicValue::I64(value) => writer.write_primitive(*value),
        DynamicValue::U64(value) => writer.write_primitive(*value),
        DynamicValue::F32(value) => writer.write_primitive(*value),
        DynamicValue::F64(value) => writer.write_primitive(*value),
        DynamicValue::Text(text) => write_text(writer, wide, text),
        DynamicValue::Message(message) => write_message(writer, message),
        DynamicValue::Primitives(Primitives::Bytes(bytes)) if counted => writer.write_bytes(bytes),
        DynamicValue::Primitives(Primitives::Bytes(bytes)) => writer.write_byte_array(bytes),
        DynamicValue::Primitives(values) if counted => {
            with_elements!(values, values => writer.write_primitive_sequence(values));
        }
        DynamicValue::Primitives(values) => {
            with_elements!(values, values => writer.write_primitive_array(values));
        }
        DynamicValue::Texts(texts) => {
            let texts = if counted { writer.write_count(texts) } else { texts };
            for text in texts {
                write_text(writer, wide, text);
            }
        }
        DynamicValue::Messages(messages) => {
            let messages = if counted { writer.write_count(messages) } else { messages };
            for message in messages {
                write_message(writer, message);
            }
        }
    }
}

fn write_text(writer: &mut CdrWriter, wide: bool, text: &str) {
    if wide {
        writer.write_wstring(text);
    } else {
        writer.write_string(text);
    }
}
