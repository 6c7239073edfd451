//! A type of one ROS from that of the other, where no definition is known.
//!
//! | ROS 1 | ROS 2 |
//! | --- | --- |
//! | `time`, `duration` | `builtin_interfaces/Time`, `Duration` |
//! | `Header` with `seq` | `std_msgs/Header` |
//! | field `frameId`, `K` | `frame_id`, `k` |
//! | `string`, `T[]` | also of `wstring`, `string<=N`, `T[<=N]`, fields with default values |

use std::collections::{BTreeMap, BTreeSet};

use super::names::{allowed_in_ros2, snake_case};
use super::rules::Rules;
use crate::parser::{
    Constant, Container, Dialect, Element, Field, InterfaceKind, Literal, MessageDefinition,
    Primitive, TypeName, parse_message,
};
use crate::store::{Looked, ResolveError, ResolvedType, ros1_builtin};

/// Makes the ROS 2 type `name` from a ROS 1 type. Types inside it are asked of `find` first.
pub(super) fn to_ros2(
    ros1: &ResolvedType,
    name: &TypeName,
    rules: &Rules,
    mut find: impl FnMut(&TypeName) -> Option<MessageDefinition>,
) -> Result<ResolvedType, ResolveError> {
    // Of which ROS 1 type a ROS 2 type is to be made.
    let mut origins = BTreeMap::from([(name.clone(), ros1.name().clone())]);
    ResolvedType::collect(Dialect::Ros2, name, |wanted, user| {
        if wanted != name
            && let Some(found) = find(wanted)
        {
            return Ok(found);
        }
        let definition = origins.get(wanted).and_then(|origin| ros1.definitions().get(origin));
        let definition = definition.ok_or_else(|| not_found(wanted, user))?;
        let mut rename = |nested: &TypeName| {
            let names = if ros1_builtin(nested).is_some() {
                vec![nested.clone()]
            } else {
                rules.ros2_names(nested)
            };
            let known = names.iter().find(|name| find(name).is_some());
            let chosen = known.or(names.first()).cloned().unwrap_or_else(|| nested.clone());
            origins.insert(chosen.clone(), nested.clone());
            chosen
        };
        Ok(message_to_ros2(definition, wanted, &mut rename))
    })
}

fn not_found(name: &TypeName, user: Option<&TypeName>) -> ResolveError {
    let looked = Looked(vec!["it among the types of the other ROS".to_owned()]);
    ResolveError::NotFound { name: name.clone(), user: user.cloned(), looked }
}

fn message_to_ros2(
    ros1: &MessageDefinition,
    name: &TypeName,
    rename: &mut dyn FnMut(&TypeName) -> TypeName,
) -> MessageDefinition {
    let header = TypeName::well_known("std_msgs", "Header");
    // Of two names that become one, the one that ROS 2 allows has it.
    let mut taken: BTreeSet<String> = ros1
        .fields
        .iter()
        .map(|field| field.name.clone())
        .filter(|name| allowed_field(name) == *name)
        .collect();
    let fields = ros1.fields.iter().filter_map(|field| {
        if ros1.name == header && field.name == "seq" {
            return None;
        }
        let element = match &field.field_type.element {
            Element::Nested(nested) => Element::Nested(rename(nested)),
            element => element.clone(),
        };
        let name = allowed_field(&field.name);
        (name == field.name || taken.insert(name.clone()))
            .then(|| Field::new(&name, element, field.field_type.container))
    });
    let fields = fields.collect();
    let constants = ros1.constants.clone();
    MessageDefinition { constants, ..MessageDefinition::new(name.clone(), fields) }
}

/// The same name where ROS 2 allows it, else words in small letters.
fn allowed_field(name: &str) -> String {
    let probe = TypeName::well_known("a", "A");
    match parse_message(&probe, &format!("bool {name}")) {
        Ok(_) => name.to_owned(),
        Err(_) => snake_case(name),
    }
}

/// Makes a ROS 1 type, a message or a service, from a ROS 2 type. Types inside it are asked of `find`
/// first; their texts are in its answers, too. `names` are those that a type of ROS 2 may have in ROS 1.
pub(super) fn to_ros1(
    ros2: &ResolvedType,
    name: &TypeName,
    names: impl Fn(&TypeName) -> Vec<TypeName>,
    mut find: impl FnMut(&TypeName) -> Option<MessageDefinition>,
) -> Result<ResolvedType, ResolveError> {
    let mut origins = BTreeMap::from([(name.clone(), ros2.name().clone())]);
    if name.kind() == InterfaceKind::Service {
        // Parts are named alike; the event is never sent.
        for suffix in ["_Request", "_Response", "_Event"] {
            origins.insert(name.derived(suffix), ros2.name().derived(suffix));
        }
    }
    ResolvedType::collect(Dialect::Ros1, name, |wanted, user| {
        if ros1_builtin(wanted).is_some() {
            return ros2.definitions().get(wanted).cloned().ok_or_else(|| not_found(wanted, user));
        }
        if wanted.kind() == InterfaceKind::Message
            && wanted != name
            && let Some(found) = find(wanted)
        {
            return Ok(found);
        }
        let definition = origins.get(wanted).and_then(|origin| ros2.definitions().get(origin));
        // A type of ROS 1 may refer to others that the one of ROS 2 does not.
        let definition = definition.ok_or_else(|| not_found(wanted, user))?;
        let mut rename = |nested: &TypeName| {
            if ros1_builtin(nested).is_some() {
                return nested.clone();
            }
            if nested.kind() == InterfaceKind::Service {
                let suffix = nested.name().strip_prefix(ros2.name().name()).unwrap_or_default();
                return name.derived(suffix);
            }
            let names = names(nested);
            let known = names.iter().find(|name| find(name).is_some());
            let chosen = known.or(names.first()).cloned().unwrap_or_else(|| nested.clone());
            origins.insert(chosen.clone(), nested.clone());
            chosen
        };
        Ok(message_to_ros1(definition, wanted, &mut rename))
    })
}

fn message_to_ros1(
    ros2: &MessageDefinition,
    name: &TypeName,
    rename: &mut dyn FnMut(&TypeName) -> TypeName,
) -> MessageDefinition {
    let element = |element: &Element, rename: &mut dyn FnMut(&TypeName) -> TypeName| match element {
        Element::Nested(nested) => Element::Nested(rename(nested)),
        Element::String { .. } | Element::WString { .. } => Element::String { bound: None },
        Element::Primitive(_) => element.clone(),
    };
    let fields = ros2.fields.iter().map(|field| {
        let container = match field.field_type.container {
            Container::Sequence { .. } => Container::Sequence { bound: None },
            container => container,
        };
        Field::new(&field.name, element(&field.field_type.element, rename), container)
    });
    let fields = fields.collect();
    let constants = ros2.constants.iter().map(|constant| Constant {
        element: element(&constant.element, rename),
        written: written_for_ros1(constant),
        ..constant.clone()
    });
    let constants = constants.collect();
    MessageDefinition { constants, ..MessageDefinition::new(name.clone(), fields) }
}

/// Value of a constant as ROS 1 reads it, and as its checksum has it: the same text where Python's `int`, `float` and
/// `literal_eval` understand that, by which genpy reads constants.
fn written_for_ros1(constant: &Constant) -> String {
    let Constant { element, value, written, .. } = constant;
    match value {
        // ROS 1 takes all behind `=`, quotes too.
        Literal::Text(text) => text.lines().next().unwrap_or_default().trim().to_owned(),
        Literal::Bool(_) if ["True", "False", "1", "0"].contains(&written.as_str()) => {
            written.clone()
        }
        Literal::Bool(true) => "True".to_owned(),
        Literal::Bool(false) => "False".to_owned(),
        // The byte of ROS 1 is signed.
        Literal::Integer(value @ 128..=255) if *element == Element::Primitive(Primitive::Byte) => {
            (value - 256).to_string()
        }
        Literal::Integer(value) => {
            let digits = written.strip_prefix(['-', '+']).unwrap_or(written);
            match digits.bytes().all(|digit| digit.is_ascii_digit()) {
                true => written.clone(),
                false => value.to_string(),
            }
        }
        Literal::Float(_) => written.clone(),
    }
}

/// The name under which a ROS 1 type goes in ROS 2 where no rule has another.
pub(super) fn name_in_ros2(ros1: &TypeName, rules: &Rules) -> TypeName {
    let name = rules.ros2_names(ros1).into_iter().next();
    name.or_else(|| allowed_in_ros2(ros1)).unwrap_or_else(|| ros1.clone())
}
