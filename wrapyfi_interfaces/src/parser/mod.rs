//! Reads interface definitions: the text of a `.msg` file into a [`MessageDefinition`].
//!
//! ```text
//!   Image.msg ──parse_message──▶ MessageDefinition ──▶ TypeDescription ──▶ RIHS01 hash
//!                                       └────────────▶ Rust struct (build script)
//! ```
//!
//! The grammar is that of <https://docs.ros.org/en/jazzy/Concepts/Basic/About-Interfaces.html>:
//! one field or constant a line, `#` starts a comment. Services and actions are sections of the
//! same lines between `---`; they will be entry points beside [`parse_message`].

mod definition;
mod error;
mod line;
mod value;

pub use definition::{
    Constant, Container, Element, Field, FieldType, MessageDefinition, Primitive, TypeName,
};
pub use error::{ParseError, ParseFault};
pub use value::{DefaultValue, Literal};

use line::Line;

/// Parses the text of a `.msg` file.
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
    let mut definition = MessageDefinition {
        name: name.clone(),
        doc: Vec::new(),
        fields: Vec::new(),
        constants: Vec::new(),
    };
    let mut pending = Vec::new(); // comment lines whose owner is not known yet
    let mut opening = true; // nothing but comments so far
    for (index, text) in text.lines().enumerate() {
        let fault = |fault| ParseError {
            interface: name.to_string(),
            line: index + 1,
            text: text.trim().to_owned(),
            fault,
        };
        match line::parse(name, text).map_err(fault)? {
            Line::Blank => {
                // The comment that opens the file and ends at a blank line is the message's.
                if opening {
                    definition.doc.append(&mut pending);
                }
                pending.clear();
            }
            Line::Comment(comment) => pending.push(comment),
            Line::Field(mut field) => {
                opening = false;
                field.doc = std::mem::take(&mut pending).into_iter().chain(field.doc).collect();
                if definition.fields.iter().any(|other| other.name == field.name) {
                    return Err(fault(ParseFault::Duplicate { name: field.name }));
                }
                definition.fields.push(field);
            }
            Line::Constant(mut constant) => {
                opening = false;
                constant.doc =
                    std::mem::take(&mut pending).into_iter().chain(constant.doc).collect();
                if definition.constants.iter().any(|other| other.name == constant.name) {
                    return Err(fault(ParseFault::Duplicate { name: constant.name }));
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
