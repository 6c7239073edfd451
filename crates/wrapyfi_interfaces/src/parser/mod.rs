//! Reads interface definitions: the text of a `.msg`, `.srv` or `.action` file into
//! [`MessageDefinition`]s.
//!
//! ```text
//!   Image.msg        ──parse_message──▶ MessageDefinition ─┐
//!   SetBool.srv      ──parse_service──▶ four of them ──────┼▶ TypeDescription ─▶ RIHS01 hash
//!   Fibonacci.action ──parse_action───▶ thirteen ──────────┘  Rust struct (build script)
//! ```
//!
//! The grammar is that of <https://docs.ros.org/en/jazzy/Concepts/Basic/About-Interfaces.html>:
//! one field or constant a line, `#` starts a comment; services and actions are sections of the
//! same lines between `---`. [`Dialect`] lists where ROS 1 differs.

mod definition;
mod dialect;
mod error;
mod interface;
mod line;
mod name;
mod python;
mod value;

pub use definition::{
    Constant, Container, Element, Field, FieldType, MessageDefinition, Primitive,
};
pub use dialect::Dialect;
pub use error::{ParseError, ParseFault};
pub(crate) use interface::{action_messages, service_messages};
pub use interface::{parse_action, parse_service};
pub use name::{InterfaceKind, TypeName};
pub use value::{DefaultValue, Literal};

use std::collections::BTreeSet;

use line::DefinitionLine;

/// Parses the text of a `.msg` file of ROS 2.
///
/// ```
/// use wrapyfi_interfaces::parser::{TypeName, parse_message};
/// let name = TypeName::new("demo_msgs", "Reading").unwrap();
/// let message = parse_message(&name, "float64 celsius  # at the sensor\n").unwrap();
/// assert_eq!(message.fields[0].name, "celsius");
/// ```
///
/// # Errors
/// The first line that is neither field nor constant nor comment, with its number.
pub fn parse_message(name: &TypeName, text: &str) -> Result<MessageDefinition, ParseError> {
    parse_section(Dialect::Ros2, name, text, 0)
}

/// Messages that the definition file of `name` gives; of a part of a service or action, all of its file.
///
/// # Errors
/// As [`parse_message`], [`parse_service`] and [`parse_action`].
pub fn parse_interface(
    dialect: Dialect,
    name: &TypeName,
    text: &str,
) -> Result<Vec<MessageDefinition>, ParseError> {
    let interface = name.interface();
    match name.kind() {
        InterfaceKind::Message => {
            parse_section(dialect, &interface, text, 0).map(|message| vec![message])
        }
        InterfaceKind::Service => parse_service(dialect, &interface, text),
        InterfaceKind::Action => parse_action(dialect, &interface, text),
    }
}

/// Parses lines that stand behind `skipped` others in their file.
fn parse_section(
    dialect: Dialect,
    name: &TypeName,
    text: &str,
    skipped: usize,
) -> Result<MessageDefinition, ParseError> {
    let mut definition = MessageDefinition::new(name.clone(), Vec::new());
    let mut pending = Vec::new(); // comment lines whose owner is not known yet
    let mut names = BTreeSet::new();
    let mut opening = true; // nothing but comments so far
    for (index, text) in text.lines().enumerate() {
        let fault = |fault| ParseError {
            interface: name.to_string(),
            line: skipped + index + 1,
            text: text.trim().to_owned(),
            fault,
        };
        match line::parse(dialect, name, text).map_err(fault)? {
            DefinitionLine::Blank => {
                // The comment that opens the file and ends at a blank line is the message's.
                if opening {
                    definition.doc.append(&mut pending);
                }
                pending.clear();
            }
            DefinitionLine::Comment(comment) => pending.push(comment),
            DefinitionLine::Field(mut field) => {
                opening = false;
                field.doc = std::mem::take(&mut pending).into_iter().chain(field.doc).collect();
                if !names.insert(field.name.clone()) {
                    return Err(fault(ParseFault::Duplicate(field.name)));
                }
                definition.fields.push(field);
            }
            DefinitionLine::Constant(mut constant) => {
                opening = false;
                constant.doc =
                    std::mem::take(&mut pending).into_iter().chain(constant.doc).collect();
                if !names.insert(constant.name.clone()) {
                    return Err(fault(ParseFault::Duplicate(constant.name)));
                }
                definition.constants.push(constant);
            }
        }
    }
    if opening {
        definition.doc.append(&mut pending);
    }
    Ok(definition)
}

#[cfg(test)]
mod tests;
