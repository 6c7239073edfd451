//! One line of a definition: comment, field or constant.

use super::definition::{Constant, Container, Element, Field, FieldType, Primitive};
use super::name::is_name;
use super::{Dialect, InterfaceKind, Literal, ParseFault, TypeName, value};

/// Content of a line.
pub(super) enum DefinitionLine {
    Blank,
    Comment(String),
    Field(Field),
    Constant(Constant),
}

/// Reads a line of the definition of `owner`, whose package unqualified type names belong to.
pub(super) fn parse(
    dialect: Dialect,
    owner: &TypeName,
    text: &str,
) -> Result<DefinitionLine, ParseFault> {
    let text = text.trim();
    if text.is_empty() {
        return Ok(DefinitionLine::Blank);
    }
    if let Some(comment) = text.strip_prefix('#') {
        return Ok(DefinitionLine::Comment(comment.trim().to_owned()));
    }
    let (type_name, rest) = split_at_whitespace(text);
    let name_end =
        rest.find(|c: char| c.is_whitespace() || c == '=' || c == '#').unwrap_or(rest.len());
    let (name, rest) = rest.split_at(name_end);
    if name.is_empty() {
        return Err(ParseFault::MissingName);
    }
    let rest = rest.trim_start();
    match rest.strip_prefix('=') {
        Some(rest) => constant(dialect, type_name, name, rest.trim_start()),
        None => field(dialect, owner, type_name, name, rest),
    }
}

fn split_at_whitespace(text: &str) -> (&str, &str) {
    text.split_once(char::is_whitespace)
        .map_or((text, ""), |(head, tail)| (head, tail.trim_start()))
}

fn constant(
    dialect: Dialect,
    type_name: &str,
    name: &str,
    rest: &str,
) -> Result<DefinitionLine, ParseFault> {
    let element = match (Primitive::from_name(type_name), type_name) {
        (Some(primitive), _) => Element::Primitive(primitive),
        (None, "string") => Element::String { bound: None },
        (None, "wstring") if dialect == Dialect::Ros2 => Element::WString { bound: None },
        _ => return Err(ParseFault::ConstantType(type_name.to_owned())),
    };
    if !is_name(dialect, name, char::is_uppercase) {
        return Err(ParseFault::ConstantName(name.to_owned()));
    }
    let (value, written, comment) = match (dialect, &element) {
        // Nothing ends the text in ROS 1, not even `#`.
        (Dialect::Ros1, Element::String { .. }) => (Literal::Text(rest.to_owned()), rest, None),
        _ => {
            let (written, comment) = split_comment(rest);
            (value::literal(dialect, &element, type_name, written)?, written, comment)
        }
    };
    Ok(DefinitionLine::Constant(Constant {
        name: name.to_owned(),
        element,
        value,
        written: written.to_owned(),
        doc: comment.into_iter().collect(),
    }))
}

fn field(
    dialect: Dialect,
    owner: &TypeName,
    type_name: &str,
    name: &str,
    rest: &str,
) -> Result<DefinitionLine, ParseFault> {
    let field_type = field_type(dialect, owner, type_name)?;
    if !is_name(dialect, name, char::is_lowercase) {
        return Err(ParseFault::FieldName(name.to_owned()));
    }
    let (written, comment) = split_comment(rest);
    let default = match (written, dialect) {
        ("", _) => None,
        (_, Dialect::Ros1) => return Err(ParseFault::OnlyRos2("a default value")),
        (written, Dialect::Ros2) => Some(value::default(&field_type, type_name, written)?),
    };
    let doc = comment.into_iter().collect();
    Ok(DefinitionLine::Field(Field { name: name.to_owned(), field_type, default, doc }))
}

/// Splits a value from the comment behind it. A `#` between quotes belongs to the value; an
/// apostrophe inside an unquoted string does not open quotes.
fn split_comment(text: &str) -> (&str, Option<String>) {
    let mut outside = value::outside_quotes(text.starts_with(['"', '\'', '[']));
    let Some(at) = text.find(|c| outside(c) && c == '#') else {
        return (text.trim_end(), None);
    };
    let (value, comment) = text.split_at(at);
    (value.trim_end(), Some(comment.trim_start_matches('#').trim().to_owned()))
}

/// Reads a type such as `string<=5[<=3]`.
fn field_type(dialect: Dialect, owner: &TypeName, text: &str) -> Result<FieldType, ParseFault> {
    if dialect == Dialect::Ros1 && text.contains("<=") {
        return Err(ParseFault::OnlyRos2("a bound"));
    }
    let (element, container) = match text.strip_suffix(']').and_then(|t| t.rsplit_once('[')) {
        None => (text, Container::Single),
        Some((element, "")) => (element, Container::Sequence { bound: None }),
        Some((element, inside)) => match inside.strip_prefix("<=") {
            Some(bound) => (element, Container::Sequence { bound: Some(size(bound)?) }),
            None => (element, Container::Array(size(inside)?)),
        },
    };
    Ok(FieldType { element: self::element(dialect, owner, element)?, container })
}

fn element(dialect: Dialect, owner: &TypeName, text: &str) -> Result<Element, ParseFault> {
    if let Some(primitive) = Primitive::from_name(text) {
        return Ok(Element::Primitive(primitive));
    }
    let (base, bound) = match text.split_once("<=") {
        Some((base, bound)) => (base, Some(size(bound)?)),
        None => (text, None),
    };
    match (base, bound, dialect) {
        ("string", bound, _) => return Ok(Element::String { bound }),
        ("wstring", bound, Dialect::Ros2) => return Ok(Element::WString { bound }),
        ("wstring", _, Dialect::Ros1) => return Err(ParseFault::OnlyRos2("wstring")),
        (_, Some(_), _) => return Err(ParseFault::TypeName(text.to_owned())),
        (_, None, _) => {}
    }
    let message = |package: &str, name: &str| {
        TypeName::with_kind(dialect, package, InterfaceKind::Message, name).map(Element::Nested)
    };
    let parts: Vec<&str> = text.split('/').collect();
    match (dialect, parts.as_slice()) {
        (Dialect::Ros1, ["time"]) => message("builtin_interfaces", "Time"),
        (Dialect::Ros1, ["duration"]) => message("builtin_interfaces", "Duration"),
        (Dialect::Ros1, ["Header"]) => message("std_msgs", "Header"),
        (_, [name]) => message(owner.package(), name),
        (_, [package, name] | [package, "msg", name]) => message(package, name),
        _ => Err(ParseFault::TypeName(text.to_owned())),
    }
}

fn size(text: &str) -> Result<u32, ParseFault> {
    match text.parse() {
        Ok(size) if size > 0 => Ok(size),
        _ => Err(ParseFault::Size(text.to_owned())),
    }
}
