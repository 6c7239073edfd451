//! Values of constants and defaults.

use super::definition::{Container, Element, FieldType, Primitive};
use super::{Dialect, ParseFault};

/// One value as a definition writes it.
#[derive(Debug, Clone, PartialEq)]
pub enum Literal {
    /// `true`, `false`, `1` or `0` of a `bool`.
    Bool(bool),
    /// Value of an integer type, inside its range.
    Integer(i128),
    /// Value of a float type.
    Float(f64),
    /// Text, unquoted.
    Text(String),
}

/// Default value of a field.
#[derive(Debug, Clone, PartialEq)]
pub enum DefaultValue {
    /// Default of a single element.
    One(Literal),
    /// Default of an array or a sequence.
    Many(Vec<Literal>),
}

/// Reads `text` as a value of `element`, which the definition calls `type_name`.
pub(super) fn literal(
    dialect: Dialect,
    element: &Element,
    type_name: &str,
    text: &str,
) -> Result<Literal, ParseFault> {
    let read = match element {
        // The byte of ROS 1 is signed, but there are definitions that count on to 255.
        Element::Primitive(Primitive::Byte) if dialect == Dialect::Ros1 => integer(text)
            .filter(|value| (i8::MIN.into()..=u8::MAX.into()).contains(value))
            .map(Literal::Integer),
        Element::Primitive(primitive) => number(*primitive, text),
        // A bound counts characters here, as rosidl does.
        Element::String { bound } | Element::WString { bound } => unquote(text)
            .filter(|text| bound.is_none_or(|bound| text.chars().count() as u64 <= bound.into()))
            .map(Literal::Text),
        Element::Nested(_) => return Err(ParseFault::NestedDefault),
    };
    read.ok_or_else(|| ParseFault::Value { text: text.to_owned(), type_name: type_name.to_owned() })
}

/// Reads `text` as default value of a field, which only ROS 2 has.
pub(super) fn default(
    field_type: &FieldType,
    type_name: &str,
    text: &str,
) -> Result<DefaultValue, ParseFault> {
    if matches!(field_type.element, Element::Nested(_)) {
        return Err(ParseFault::NestedDefault);
    }
    if field_type.container == Container::Single {
        return literal(Dialect::Ros2, &field_type.element, type_name, text).map(DefaultValue::One);
    }
    let fault = || ParseFault::Value { text: text.to_owned(), type_name: type_name.to_owned() };
    let inside = text.strip_prefix('[').and_then(|t| t.strip_suffix(']')).ok_or_else(fault)?;
    let values = split_elements(inside)
        .into_iter()
        .map(|element| literal(Dialect::Ros2, &field_type.element, type_name, element))
        .collect::<Result<Vec<_>, _>>()?;
    match field_type.container.other_count(values.len()) {
        Some(expected) => Err(ParseFault::DefaultCount { actual: values.len(), expected }),
        None => Ok(DefaultValue::Many(values)),
    }
}

/// Tells of one character after the other whether it stands outside of quotes, which there are only in a text that may
/// have them.
pub(super) fn outside_quotes(quotable: bool) -> impl FnMut(char) -> bool {
    let (mut open, mut escaped) = (None, false);
    move |c| {
        match open {
            _ if escaped => escaped = false,
            Some(_) if c == '\\' => escaped = true,
            Some(quote) if c == quote => open = None,
            None if quotable && (c == '"' || c == '\'') => open = Some(c),
            Some(_) => {}
            None => return true,
        }
        false
    }
}

/// Elements between commas that are not inside quotes.
fn split_elements(text: &str) -> Vec<&str> {
    let mut outside = outside_quotes(true);
    let parts = text.split(|c| outside(c) && c == ',');
    let parts: Vec<&str> = parts.map(str::trim).collect();
    if parts == [""] { Vec::new() } else { parts }
}

fn number(primitive: Primitive, text: &str) -> Option<Literal> {
    let (low, high): (i128, i128) = match primitive {
        Primitive::Bool => {
            return match text.to_ascii_lowercase().as_str() {
                "true" | "1" => Some(Literal::Bool(true)),
                "false" | "0" => Some(Literal::Bool(false)),
                _ => None,
            };
        }
        Primitive::Float32 | Primitive::Float64 => {
            return text.parse().ok().map(Literal::Float);
        }
        Primitive::Byte | Primitive::Char | Primitive::Uint8 => (0, u8::MAX.into()),
        Primitive::Int8 => (i8::MIN.into(), i8::MAX.into()),
        Primitive::Int16 => (i16::MIN.into(), i16::MAX.into()),
        Primitive::Uint16 => (0, u16::MAX.into()),
        Primitive::Int32 => (i32::MIN.into(), i32::MAX.into()),
        Primitive::Uint32 => (0, u32::MAX.into()),
        Primitive::Int64 => (i64::MIN.into(), i64::MAX.into()),
        Primitive::Uint64 => (0, u64::MAX.into()),
    };
    let value = integer(text)?;
    (low..=high).contains(&value).then_some(Literal::Integer(value))
}

/// Decimal, `0x`, `0o` and `0b` integers with an optional sign.
fn integer(text: &str) -> Option<i128> {
    let (sign, digits) = match text.strip_prefix('-') {
        Some(digits) => (-1, digits),
        None => (1, text.strip_prefix('+').unwrap_or(text)),
    };
    let lower = digits.to_ascii_lowercase();
    let (radix, digits) = match lower.split_at_checked(2) {
        Some(("0x", digits)) => (16, digits),
        Some(("0o", digits)) => (8, digits),
        Some(("0b", digits)) => (2, digits),
        _ => (10, lower.as_str()),
    };
    if digits.starts_with(['+', '-']) {
        return None;
    }
    i128::from_str_radix(digits, radix).ok()?.checked_mul(sign)
}

/// Takes quotes off and resolves `\` before a quote or another `\`. Unquoted text is itself.
fn unquote(text: &str) -> Option<String> {
    let Some(quote) = text.chars().next().filter(|c| *c == '"' || *c == '\'') else {
        return Some(text.to_owned());
    };
    let mut chars = text.chars().skip(1);
    let mut value = String::new();
    loop {
        match chars.next()? {
            '\\' => match chars.next()? {
                c if c == '\\' || c == quote => value.push(c),
                c => value.extend(['\\', c]),
            },
            c if c == quote => break,
            c => value.push(c),
        }
    }
    chars.next().is_none().then_some(value)
}
