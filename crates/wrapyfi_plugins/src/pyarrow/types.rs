//! PyArrow's types by the functions that make them.
//!
//! ```text
//!   type_for_alias('int64') · timestamp('ns', 'UTC') · list_(field) · struct([field, …]) ◀─▶ DataType
//! ```

use std::collections::HashMap;
use std::sync::Arc;

use arrow_schema::{DataType, Field, Metadata, Schema};

use super::super::PluginError;
use super::super::budget::Budget;
use crate::pickle::{Node, PickleError, Writer};
use wrapyfi_data::types::arrow::{number_name, number_type, unit, unit_name};

/// Deepest nesting of a type.
const MAX_DEPTH: usize = 64;

/// Types without parameters, by PyArrow's alias; those that it calls as NumPy does are among the numbers.
const PLAIN: [(&str, DataType); 10] = [
    ("null", DataType::Null),
    ("halffloat", DataType::Float16),
    ("float", DataType::Float32),
    ("double", DataType::Float64),
    ("string", DataType::Utf8),
    ("large_string", DataType::LargeUtf8),
    ("binary", DataType::Binary),
    ("large_binary", DataType::LargeBinary),
    ("date32[day]", DataType::Date32),
    ("date64[ms]", DataType::Date64),
];

/// Further spellings of the same.
const ALIASES: [(&str, &str); 5] = [
    ("bool_", "bool"),
    ("boolean", "bool"),
    ("str", "string"),
    ("utf8", "string"),
    ("large_utf8", "large_string"),
];

type Result<T> = std::result::Result<T, PickleError>;

/// Reads a type.
pub(super) fn data_type(node: &Node<'_>, budget: &Budget) -> Result<DataType> {
    read_type(node, budget, 0)
}

fn read_type(node: &Node<'_>, budget: &Budget, depth: usize) -> Result<DataType> {
    budget.take(node, size_of::<Field>())?;
    if depth > MAX_DEPTH {
        return Err(node.unexpected(format!("a type nested at most {MAX_DEPTH} deep")));
    }
    let call = node.any_call()?;
    let time = |index| {
        let name = call.arg(index)?;
        unit(name.str()?).ok_or_else(|| name.unexpected("a unit: s, ms, us or ns"))
    };
    let size = |index| {
        let size = call.arg(index)?;
        i32::try_from(size.int()?).map_err(|_wide| size.unexpected("a size of 32 bits"))
    };
    let inner = |index| -> Result<_> {
        let part = call.arg(index)?;
        let is_field = part.any_call().is_ok_and(|call| call.global().is("pyarrow.lib.field"));
        let field = if is_field {
            read_field(&part, budget, depth + 1)?
        } else {
            Field::new("item", read_type(&part, budget, depth + 1)?, true)
        };
        Ok(Arc::new(field))
    };
    Ok(match call.global().name {
        "type_for_alias" => {
            let name = call.arg(0)?;
            alias(name.str()?).ok_or_else(|| name.unexpected("a type that is known here"))?
        }
        "timestamp" => {
            let zone = call.args().find(1).and_then(Node::option);
            let zone = zone.map(|zone| zone.str().map(Arc::from)).transpose()?;
            DataType::Timestamp(time(0)?, zone)
        }
        "duration" => DataType::Duration(time(0)?),
        "time32" => DataType::Time32(time(0)?),
        "time64" => DataType::Time64(time(0)?),
        "binary" => DataType::FixedSizeBinary(size(0)?),
        "decimal128" => {
            let (precision, scale) = (call.arg(0)?, call.arg(1)?);
            let wrong = |part: &Node<'_>| part.unexpected("a precision and scale of 8 bits");
            DataType::Decimal128(
                u8::try_from(precision.int()?).map_err(|_wide| wrong(&precision))?,
                i8::try_from(scale.int()?).map_err(|_wide| wrong(&scale))?,
            )
        }
        "list_" if call.args().len() > 1 && call.arg(1)?.int()? >= 0 => {
            DataType::FixedSizeList(inner(0)?, size(1)?)
        }
        "list_" => DataType::List(inner(0)?),
        "large_list" => DataType::LargeList(inner(0)?),
        "map_" => {
            let end = |index, name: &str| -> Result<_> {
                let field: Arc<Field> = inner(index)?;
                Ok(Field::clone(&field).with_name(name))
            };
            let fields = vec![end(0, "key")?.with_nullable(false), end(1, "value")?];
            DataType::Map(
                Arc::new(Field::new("entries", DataType::Struct(fields.into()), false)),
                false,
            )
        }
        "struct" => {
            let fields = call.arg(0)?.sequence()?;
            let fields = fields.iter().map(|field| read_field(&field, budget, depth + 1));
            DataType::Struct(fields.collect::<Result<Vec<_>>>()?.into())
        }
        "dictionary" => DataType::Dictionary(
            Box::new(read_type(&call.arg(0)?, budget, depth + 1)?),
            Box::new(read_type(&call.arg(1)?, budget, depth + 1)?),
        ),
        _ => return Err(node.unexpected("a type of PyArrow that is known here")),
    })
}

fn alias(name: &str) -> Option<DataType> {
    let name = ALIASES.iter().find(|(alias, _)| *alias == name).map_or(name, |(_, name)| name);
    let plain = PLAIN.iter().find(|(known, _)| *known == name).map(|(_, plain)| plain.clone());
    if let Some(plain) = plain.or_else(|| number_type(name)) {
        return Some(plain);
    }
    let (kind, rest) = name.split_once('[')?;
    let unit = unit(rest.strip_suffix(']')?)?;
    match kind {
        "timestamp" => Some(DataType::Timestamp(unit, None)),
        "duration" => Some(DataType::Duration(unit)),
        _ => None,
    }
}

fn plain_name(data_type: &DataType) -> Option<&'static str> {
    let named = PLAIN.iter().find(|(_, plain)| plain == data_type).map(|(name, _)| *name);
    named.or_else(|| number_name(data_type))
}

/// Reads a field: name, type, nullable, metadata.
fn read_field(node: &Node<'_>, budget: &Budget, depth: usize) -> Result<Field> {
    budget.take(node, size_of::<Field>())?;
    let call = node.call("pyarrow.lib.field")?;
    let nullable = match call.args().find(2) {
        Some(nullable) => nullable.bool()?,
        None => true,
    };
    let name = call.arg(0)?.str()?.to_owned();
    budget.take(node, name.len())?;
    let field = Field::new(name, read_type(&call.arg(1)?, budget, depth + 1)?, nullable);
    Ok(match call.args().find(3).and_then(Node::option) {
        Some(metadata) => field.with_metadata(read_metadata(&metadata, budget)?),
        None => field,
    })
}

/// Reads a schema: fields and metadata.
pub(super) fn schema(node: &Node<'_>, budget: &Budget) -> Result<Schema> {
    let call = node.call("pyarrow.lib.schema")?;
    let fields = call.arg(0)?.sequence()?;
    let fields =
        fields.iter().map(|field| read_field(&field, budget, 0)).collect::<Result<Vec<_>>>()?;
    let metadata = match call.args().find(1).and_then(Node::option) {
        Some(metadata) => read_metadata(&metadata, budget)?,
        None => HashMap::new(),
    };
    Ok(Schema::new_with_metadata(fields, metadata))
}

fn read_metadata(node: &Node<'_>, budget: &Budget) -> Result<HashMap<String, String>> {
    let text = |node: Node<'_>| -> Result<String> {
        let bytes = node.bytes()?;
        budget.take(&node, bytes.len().saturating_add(64))?;
        String::from_utf8(bytes.to_vec()).map_err(|_no_text| node.unexpected("bytes of UTF-8"))
    };
    node.dict()?.iter().map(|(key, value)| Ok((text(key)?, text(value)?))).collect()
}

/// PyArrow's name of a type: `float`, `list<item: int64>`, `timestamp[ns, tz=UTC]`.
pub(crate) fn type_name(data_type: &DataType) -> String {
    if let Some(name) = plain_name(data_type) {
        return name.to_owned();
    }
    let field = |field: &Field| {
        let null = if field.is_nullable() { "" } else { " not null" };
        format!("{}: {}{null}", field.name(), type_name(field.data_type()))
    };
    match data_type {
        DataType::Timestamp(unit, None) => format!("timestamp[{}]", unit_name(*unit)),
        DataType::Timestamp(unit, Some(zone)) => {
            format!("timestamp[{}, tz={zone}]", unit_name(*unit))
        }
        DataType::Duration(unit) => format!("duration[{}]", unit_name(*unit)),
        DataType::FixedSizeBinary(size) => format!("fixed_size_binary[{size}]"),
        DataType::Decimal128(precision, scale) => format!("decimal128({precision}, {scale})"),
        DataType::List(item) => format!("list<{}>", field(item)),
        DataType::LargeList(item) => format!("large_list<{}>", field(item)),
        DataType::FixedSizeList(item, size) => format!("fixed_size_list<{}>[{size}]", field(item)),
        DataType::Struct(fields) => {
            let fields: Vec<String> = fields.iter().map(|it| field(it)).collect();
            format!("struct<{}>", fields.join(", "))
        }
        DataType::Map(entries, _) => match entries.data_type() {
            DataType::Struct(fields) => {
                let types: Vec<String> =
                    fields.iter().map(|it| type_name(it.data_type())).collect();
                format!("map<{}>", types.join(", "))
            }
            other => other.to_string(),
        },
        DataType::Dictionary(codes, values) => format!(
            "dictionary<values={}, indices={}, ordered=0>",
            type_name(values),
            type_name(codes)
        ),
        other => other.to_string(),
    }
}

/// Writes a type.
pub(super) fn write_type(
    to: &mut Writer,
    data_type: &DataType,
) -> std::result::Result<(), PluginError> {
    const LIB: &str = "pyarrow.lib";
    if let Some(name) = plain_name(data_type) {
        to.global(LIB, "type_for_alias").str(name).tuple(1).reduce();
        return Ok(());
    }
    match data_type {
        DataType::Timestamp(unit, zone) => {
            to.global(LIB, "timestamp").str(unit_name(*unit));
            match zone {
                Some(zone) => to.str(zone),
                None => to.none(),
            };
            to.tuple(2).reduce();
        }
        DataType::Duration(unit) => {
            to.global(LIB, "duration").str(unit_name(*unit)).tuple(1).reduce();
        }
        DataType::FixedSizeBinary(size) => {
            to.global(LIB, "binary").int((*size).into()).tuple(1).reduce();
        }
        DataType::Decimal128(precision, scale) => {
            to.global(LIB, "decimal128").int((*precision).into()).int((*scale).into());
            to.tuple(2).reduce();
        }
        DataType::List(item) | DataType::LargeList(item) => {
            let large = matches!(data_type, DataType::LargeList(_));
            to.global(LIB, if large { "large_list" } else { "list_" });
            write_field(to, item)?;
            to.tuple(1).reduce();
        }
        DataType::FixedSizeList(item, size) => {
            to.global(LIB, "list_");
            write_field(to, item)?;
            to.int((*size).into()).tuple(2).reduce();
        }
        DataType::Struct(fields) => {
            to.global(LIB, "struct").list(fields, |to, field| write_field(to, field))?;
            to.tuple(1).reduce();
        }
        DataType::Map(entries, _) => {
            to.global(LIB, "map_").mark();
            let DataType::Struct(fields) = entries.data_type() else {
                return Err(unsupported(data_type));
            };
            fields.iter().try_for_each(|field| write_field(to, field))?;
            to.tuple_since_mark().reduce();
        }
        DataType::Dictionary(index, value) => {
            to.global(LIB, "dictionary");
            write_type(to, index)?;
            write_type(to, value)?;
            to.bool(false).tuple(3).reduce();
        }
        _ => return Err(unsupported(data_type)),
    }
    Ok(())
}

fn unsupported(data_type: &DataType) -> PluginError {
    PluginError::unsupported(
        format!("a column of type {data_type}"),
        "cast it to a type of numbers, text, time, lists or structs",
    )
}

/// Writes a field.
fn write_field(to: &mut Writer, field: &Field) -> std::result::Result<(), PluginError> {
    to.global("pyarrow.lib", "field").mark().str(field.name());
    write_type(to, field.data_type())?;
    to.bool(field.is_nullable());
    write_metadata(to, field.metadata());
    to.tuple_since_mark().reduce();
    Ok(())
}

/// Writes a schema.
pub(super) fn write_schema(
    to: &mut Writer,
    schema: &Schema,
) -> std::result::Result<(), PluginError> {
    to.global("pyarrow.lib", "schema");
    to.list(schema.fields(), |to, field| write_field(to, field))?;
    write_metadata(to, schema.metadata());
    to.tuple(2).reduce();
    Ok(())
}

fn write_metadata(to: &mut Writer, metadata: &Metadata) {
    if metadata.is_empty() {
        to.none();
        return;
    }
    let mut sorted: Vec<_> = metadata.iter().collect();
    sorted.sort();
    to.mark();
    for (key, value) in sorted {
        to.bytes(key.as_bytes()).bytes(value.as_bytes());
    }
    to.dict_since_mark();
}
