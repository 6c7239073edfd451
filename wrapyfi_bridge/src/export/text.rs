//! Definition files of ROS 2, and what of ROS 1 had to change for ROS 2 to take it.
//!
//! ```text
//!   parts (ROS 2) ──┬─▶ # comment of ROS 1
//!   parts (ROS 1) ──┘   float64 frame_width        and: frame_width was frameWidth
//! ```
//!
//! `rosidl` reads `#` and quotes in a text otherwise than ROS 1 does: a constant that it would read wrongly becomes a comment.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

use wrapyfi_interfaces::parser::{
    Constant, Element, Field, InterfaceKind, Literal, MessageDefinition, Primitive, TypeName,
};

/// Parts of a definition file: one of a message, two of a service, three of an action.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Interface {
    pub(super) name: TypeName,
    pub(super) parts: Vec<MessageDefinition>,
}

/// Definitions of ROS 1 by the names that they have on ROS 2.
pub(super) type Origins = BTreeMap<TypeName, MessageDefinition>;

/// A definition file.
#[derive(Debug, PartialEq)]
pub(super) struct DefinitionFile {
    /// Path below the folder of the package: `msg/Pose.msg`.
    pub(super) path: String,
    pub(super) text: String,
    /// Differences from ROS 1, each a line.
    pub(super) changes: Vec<String>,
}

impl Interface {
    /// Words that a part has behind the name of its interface, in the order of the file.
    pub(super) fn suffixes(kind: InterfaceKind) -> &'static [&'static str] {
        match kind {
            InterfaceKind::Message => &[""],
            InterfaceKind::Service => &["_Request", "_Response"],
            InterfaceKind::Action => &["_Goal", "_Result", "_Feedback"],
        }
    }

    /// Writes the file.
    pub(super) fn file(&self, origins: &Origins) -> DefinitionFile {
        let Self { name, parts } = self;
        let mut changes = Vec::new();
        let mut text = String::new();
        for (place, part) in parts.iter().enumerate() {
            if place > 0 {
                text.push_str("---\n");
            }
            let origin = origins.get(&part.name);
            if let Some(origin) = origin {
                changes.extend(renamed_type(&origin.name, &part.name));
            }
            text.push_str(&part_text(part, origin, &mut changes));
        }
        let kind = name.kind().as_str();
        DefinitionFile { path: format!("{kind}/{}.{kind}", name.name()), text, changes }
    }
}

/// The line about a type that has another name on ROS 2.
fn renamed_type(ros1: &TypeName, ros2: &TypeName) -> Option<String> {
    let is_same = ros1.package() == ros2.package() && ros1.name() == ros2.name();
    // Parts of an interface change with it: one line is enough.
    let is_first =
        ["_Response", "_Result", "_Feedback"].iter().all(|it| !ros2.name().ends_with(it))
            || ros2.kind() == InterfaceKind::Message;
    let (one, two) = (ros1.interface(), ros2.interface());
    (!is_same && is_first).then(|| format!("{two} was {}/{} in ROS 1", one.package(), one.name()))
}

fn part_text(
    part: &MessageDefinition,
    origin: Option<&MessageDefinition>,
    changes: &mut Vec<String>,
) -> String {
    let mut text = String::new();
    let doc = origin.map_or(&part.doc, |origin| &origin.doc);
    comment(&mut text, doc);
    // A comment that stands at the top up to a blank line is about the message.
    let has_doc = !doc.is_empty();
    let own = part.name.interface();
    let mut entries = String::new();
    let mut taken: BTreeSet<String> = part.fields.iter().map(|field| field.name.clone()).collect();
    for constant in &part.constants {
        let line = constant_line(constant, &own, &mut taken, changes);
        comment(&mut entries, &constant.doc);
        let _infallible = writeln!(entries, "{line}");
    }
    for field in &part.fields {
        let from = origin.and_then(|origin| origin_of(field, origin));
        if let Some(from) = from.filter(|from| from.name != field.name) {
            changes.push(format!("{own}: field {} was {} in ROS 1", field.name, from.name));
        }
        comment(&mut entries, from.map_or(&field.doc, |from| &from.doc));
        let _infallible = writeln!(entries, "{}", field_line(field, own.package()));
    }
    for lost in origin.into_iter().flat_map(|origin| lost(part, origin)) {
        changes.push(format!(
            "{own}: field {lost} of ROS 1 is left out, because ROS 2 would call it as another one"
        ));
    }
    if has_doc || entries.starts_with('#') {
        text.push('\n');
    }
    text + &entries
}

fn comment(text: &mut String, lines: &[String]) {
    for line in lines {
        let _infallible = writeln!(text, "# {line}");
    }
}

fn field_line(field: &Field, package: &str) -> String {
    let element = match &field.field_type.element {
        Element::Nested(nested) if nested.package() == package => nested.name().to_owned(),
        element => element.to_string(),
    };
    let default = field.default.as_ref().map(|value| format!(" {}", value.to_python()));
    let container = field.field_type.container;
    format!("{element}{container} {}{}", field.name, default.unwrap_or_default())
}

/// The line of a constant; of one that `rosidl` cannot read a comment.
fn constant_line(
    constant: &Constant,
    own: &TypeName,
    taken: &mut BTreeSet<String>,
    changes: &mut Vec<String>,
) -> String {
    let Constant { name, element, value, written, .. } = constant;
    let allowed = upper_case(name);
    let left_out = |why: &str| {
        (
            format!("# {element} {name}={written}"),
            format!("{own}: constant {name} of ROS 1 is a comment now: {why}"),
        )
    };
    let (line, change) = match literal(element, value, written) {
        Err(why) => left_out(why),
        Ok(_) if !taken.insert(allowed.clone()) => {
            left_out("ROS 2 would call it as another constant or field")
        }
        Ok(value) => {
            let change = format!("{own}: constant {allowed} was {name} in ROS 1");
            let line = format!("{element} {allowed}={value}");
            if allowed == *name {
                return line;
            }
            (line, change)
        }
    };
    changes.push(change);
    line
}

/// A value as `rosidl` reads it, or the reason why it cannot.
fn literal(element: &Element, value: &Literal, written: &str) -> Result<String, &'static str> {
    match value {
        Literal::Bool(value) => Ok(value.to_string()),
        // The byte of ROS 1 is signed, that of ROS 2 is not.
        Literal::Integer(value @ ..=-1) if *element == Element::Primitive(Primitive::Byte) => {
            Ok((value + 256).to_string())
        }
        Literal::Integer(value) => Ok(value.to_string()),
        Literal::Float(_) => Ok(written.to_owned()),
        Literal::Text(text) if text.contains('#') => Err("# begins a comment on ROS 2"),
        Literal::Text(text) if text.ends_with('\\') => Err("\\ would take the quote behind it"),
        Literal::Text(text) => match ['"', '\''].into_iter().find(|quote| !text.contains(*quote)) {
            Some(quote) => Ok(format!("{quote}{text}{quote}")),
            None => Err("ROS 2 has no text with both kinds of quotes"),
        },
    }
}

/// `maxSpeed_` to `MAX_SPEED`: capital letters, digits and single underscores.
fn upper_case(name: &str) -> String {
    if name.chars().all(|c| !c.is_ascii_lowercase()) && !name.contains("__") && !name.ends_with('_')
    {
        return name.to_owned();
    }
    let mut text = String::with_capacity(name.len());
    let mut lower_before = false;
    for c in name.chars() {
        let begins_word = c == '_' || c.is_ascii_uppercase() && lower_before;
        if begins_word && !text.is_empty() && !text.ends_with('_') {
            text.push('_');
        }
        if c != '_' {
            text.push(c.to_ascii_uppercase());
        }
        lower_before = c.is_ascii_lowercase() || c.is_ascii_digit();
    }
    text.trim_end_matches('_').to_owned()
}

/// The field of ROS 1 that a field of ROS 2 was made of.
fn origin_of<'o>(field: &Field, origin: &'o MessageDefinition) -> Option<&'o Field> {
    let by = |is_meant: &dyn Fn(&str) -> bool| origin.fields.iter().find(|it| is_meant(&it.name));
    by(&|name| name == field.name).or_else(|| by(&|name| squeezed(name) == squeezed(&field.name)))
}

/// Fields of ROS 1 whose name on ROS 2 another one has.
fn lost<'o>(part: &MessageDefinition, origin: &'o MessageDefinition) -> Vec<&'o str> {
    let kept: BTreeSet<&str> = part
        .fields
        .iter()
        .filter_map(|field| Some(origin_of(field, origin)?.name.as_str()))
        .collect();
    let names = origin.fields.iter().map(|field| field.name.as_str());
    names.filter(|name| !kept.contains(name)).collect()
}

/// A name without what ROS 2's rules change of it.
fn squeezed(name: &str) -> String {
    name.chars().filter(|c| *c != '_').map(|c| c.to_ascii_lowercase()).collect()
}

#[cfg(test)]
mod tests {
    use wrapyfi_interfaces::parser::{Dialect, parse_interface};

    use super::*;

    fn parts(dialect: Dialect, name: &str, text: &str) -> Interface {
        let name = TypeName::parse(dialect, name).unwrap();
        let all = parse_interface(dialect, &name, text).unwrap();
        let suffixes = Interface::suffixes(name.kind());
        let parts = suffixes.iter().map(|suffix| {
            let wanted = format!("{}{suffix}", name.name());
            all.iter().find(|part| part.name.name() == wanted).unwrap().clone()
        });
        Interface { parts: parts.collect(), name }
    }

    #[test]
    fn names_and_constants_of_ros_1_become_those_of_ros_2_and_comments_stay() {
        let text = "# What a scanner sees.\n\n\
            uint8 maxRays=3 # at most\n\
            byte BACK=-1\n\
            string WORD=up and # down\n\
            string NAME=a \"b\"\n\
            # width in metres\n\
            float64 frameWidth # outer\n\
            float64 framewidth\n\
            Part[] parts\n";
        let ros1 = parts(Dialect::Ros1, "demo/scan_result", text);
        let origin = &ros1.parts[0];
        let two = "float64 frame_width\nfloat64 framewidth\nPart[] parts\n";
        let mut ros2 = parts(Dialect::Ros2, "demo/msg/ScanResult", two);
        ros2.parts[0].constants = origin.constants.clone();
        let origins = Origins::from([(ros2.name.clone(), origin.clone())]);
        let file = ros2.file(&origins);
        assert_eq!(file.path, "msg/ScanResult.msg");
        let written = "# What a scanner sees.\n\n\
            # at most\nuint8 MAX_RAYS=3\n\
            byte BACK=255\n\
            # string WORD=up and # down\n\
            string NAME='a \"b\"'\n\
            # width in metres\n# outer\nfloat64 frame_width\n\
            float64 framewidth\nPart[] parts\n";
        assert_eq!(file.text, written);
        assert_eq!(
            file.changes,
            [
                "demo/msg/ScanResult was demo/scan_result in ROS 1",
                "demo/msg/ScanResult: constant MAX_RAYS was maxRays in ROS 1",
                "demo/msg/ScanResult: constant WORD of ROS 1 is a comment now: # begins a comment on ROS 2",
                "demo/msg/ScanResult: field frame_width was frameWidth in ROS 1",
            ]
        );
        let again = parse_interface(Dialect::Ros2, &ros2.name, &file.text).unwrap();
        assert_eq!(again[0].fields.len(), 3);
    }

    #[test]
    fn services_and_actions_have_their_parts_in_order() {
        for (name, text) in [
            ("demo/srv/Go", "demo2/A a\n---\n"),
            ("demo/srv/Stop", "---\nbool done\n"),
            ("demo/action/Do", "int8 a\n---\nbuiltin_interfaces/Time b\n---\nB c\n"),
        ] {
            let file = parts(Dialect::Ros2, name, text).file(&Origins::new());
            assert_eq!((file.text.as_str(), file.changes.len()), (text, 0), "{name}");
        }
    }

    #[test]
    fn a_field_whose_name_is_taken_on_ros_2_is_said_to_be_left_out() {
        let ros1 = parts(Dialect::Ros1, "demo/A", "int8 frame_id\nint8 frameId\n");
        let ros2 = parts(Dialect::Ros2, "demo/msg/A", "int8 frame_id\n");
        let origins = Origins::from([(ros2.name.clone(), ros1.parts[0].clone())]);
        let changes = ros2.file(&origins).changes;
        assert!(
            matches!(&changes[..], [one] if one.contains("field frameId of ROS 1 is left out"))
        );
    }

    #[test]
    fn constants_get_capital_letters() {
        for (name, wanted) in [
            ("maxSpeed", "MAX_SPEED"),
            ("A_", "A"),
            ("a__b", "A_B"),
            ("MAX_2", "MAX_2"),
            ("kB", "K_B"),
        ] {
            assert_eq!(upper_case(name), wanted);
        }
    }
}
