//! Definitions of ROS 2 types as a recording holds them: the type, then all it refers to.
//!
//! ```text
//!   std_msgs/Header header        the type itself
//!   uint8[] data
//!   ====================…         80 of them
//!   MSG: std_msgs/Header          every other type, by its name
//!   …
//! ```

use std::fmt::Write as _;

use wrapyfi_interfaces::parser::{
    Constant, DefaultValue, Element, Field, Literal, MessageDefinition, Primitive,
};
use wrapyfi_interfaces::store::ResolvedType;

/// Length of the line between two definitions.
const SEPARATOR: usize = 80;

/// The definition text of a ROS 2 message with all it refers to: what `ros2 bag` writes as `ros2msg`, without comments.
///
/// ```
/// use wrapyfi_interfaces::store::{ResolvedType, TypeStore};
/// use wrapyfi_interfaces::parser::Dialect;
/// let point = TypeStore::generated().resolve_name("std_msgs/msg/Header").unwrap();
/// let text = wrapyfi_bag::definition_text(&point);
/// assert!(text.starts_with("builtin_interfaces/Time stamp\nstring frame_id\n"), "{text}");
/// let again = ResolvedType::from_text(Dialect::Ros2, point.name(), &text).unwrap();
/// assert_eq!(again.type_hash(), point.type_hash());
/// ```
pub fn definition_text(resolved: &ResolvedType) -> String {
    let mut text = String::new();
    let others = resolved.definitions().values().filter(|one| one.name != *resolved.name());
    for (number, definition) in resolved.definition().into_iter().chain(others).enumerate() {
        if number > 0 {
            let (line, name) = ("=".repeat(SEPARATOR), &definition.name);
            // Writing into a string cannot fail.
            _ = write!(text, "\n{line}\nMSG: {}/{}\n", name.package(), name.name());
        }
        one(definition, &mut text);
    }
    text
}

fn one(definition: &MessageDefinition, text: &mut String) {
    for Constant { name, element, value, .. } in &definition.constants {
        _ = writeln!(text, "{} {name}={}", written(element), literal(value));
    }
    for Field { name, field_type, default, .. } in &definition.fields {
        _ = write!(text, "{}{} {name}", written(&field_type.element), field_type.container);
        match default {
            None => {}
            Some(DefaultValue::One(value)) => _ = write!(text, " {}", literal(value)),
            Some(DefaultValue::Many(values)) => {
                let values: Vec<_> = values.iter().map(literal).collect();
                _ = write!(text, " [{}]", values.join(", "));
            }
        }
        text.push('\n');
    }
}

/// Name of a type. `char` is `uint8` in ROS 2, in its hash too, which not every reader of the word knows.
fn written(element: &Element) -> String {
    match element {
        Element::Primitive(Primitive::Char) => Primitive::Uint8.name().to_owned(),
        element => element.to_string(),
    }
}

/// A value as `.msg` files of ROS 2 have it.
fn literal(value: &Literal) -> String {
    match value {
        Literal::Bool(value) => value.to_string(),
        Literal::Integer(value) => value.to_string(),
        Literal::Float(value) => format!("{value:?}"),
        Literal::Text(value) => format!("\"{}\"", value.replace('\\', "\\\\").replace('"', "\\\"")),
    }
}

#[cfg(test)]
mod tests {
    use wrapyfi_interfaces::parser::{Dialect, TypeName};

    use super::*;

    #[test]
    fn constants_and_defaults_are_read_as_they_were() {
        let name = TypeName::parse(Dialect::Ros2, "demo/msg/All").unwrap();
        let text = "int32 LOW=-3\nchar letter\nfloat64 PI=3.5\nstring WHO=\"it's \\\"me\\\"\"\nbool ON=true\n\
                    uint8[<=4] some [1, 2]\nstring<=9 named \"a\\\\b\"\nfloat32 ratio 0.5\nB[2] inner\n\
                    ================\nMSG: demo/B\nwstring wide\n";
        let resolved = ResolvedType::from_text(Dialect::Ros2, &name, text).unwrap();
        let written = definition_text(&resolved);
        let again = ResolvedType::from_text(Dialect::Ros2, &name, &written).unwrap();
        assert_eq!(again.type_hash(), resolved.type_hash());
        let values = |one: &ResolvedType| {
            let definition = one.definition().unwrap();
            let constants: Vec<_> =
                definition.constants.iter().map(|it| it.value.clone()).collect();
            let defaults: Vec<_> = definition.fields.iter().map(|it| it.default.clone()).collect();
            (constants, defaults)
        };
        assert_eq!(values(&again), values(&resolved), "{written}");
    }
}
