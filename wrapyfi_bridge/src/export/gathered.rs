//! One definition for each type of the packages that are written, or who shows two.
//!
//! ```text
//!   /arm   shows demo/Pose { float64 x }  ┐
//!   /hand  shows demo/Pose { float64 x }  ├─▶ demo/msg/Pose: two definitions, /arm and /hand, /head
//!   /head  shows demo/Pose { float32 x }  ┘
//! ```

use std::collections::{BTreeMap, BTreeSet};

use wrapyfi_interfaces::parser::{Element, InterfaceKind, MessageDefinition, TypeName};
use wrapyfi_interfaces::store::ResolvedType;

use super::text::Interface;

/// Packages of what rosidl itself puts into services and actions.
const OF_ROSIDL: [&str; 4] =
    ["action_msgs", "builtin_interfaces", "service_msgs", "unique_identifier_msgs"];

/// A definition, and who shows it.
#[derive(Debug)]
struct Candidate {
    interface: Interface,
    /// Nodes and their topics.
    shown_by: Vec<(String, String)>,
}

/// Definitions by the name of the type, in the order in which they were shown.
#[derive(Debug, Default)]
pub(super) struct Gathered(BTreeMap<TypeName, Vec<Candidate>>);

/// A type of which nodes show different definitions.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "{name} has {count} definitions: {}; build the nodes from one, or choose with `wrapyfi export --from {example}`",
    each.join(" and ")
)]
pub(super) struct Conflict {
    pub(super) name: TypeName,
    count: usize,
    each: Vec<String>,
    example: String,
}

impl Gathered {
    /// Takes a type, with all types that it has inside, as `node` shows it on `topic`.
    pub(super) fn take(&mut self, resolved: &ResolvedType, node: &str, topic: &str) {
        let shown = resolved.definitions().keys().map(TypeName::interface);
        let names: BTreeSet<TypeName> =
            shown.filter(|name| !OF_ROSIDL.contains(&name.package())).collect();
        for name in names {
            let Some(interface) = interface(&name, resolved.definitions()) else { continue };
            let known = self.0.entry(name).or_default();
            let by = (node.to_owned(), topic.to_owned());
            match known.iter_mut().find(|one| is_same(&one.interface, &interface)) {
                Some(one) if one.shown_by.iter().any(|(known, _)| *known == by.0) => {}
                Some(one) => one.shown_by.push(by),
                None => known.push(Candidate { interface, shown_by: vec![by] }),
            }
        }
    }

    /// Names of all packages.
    pub(super) fn packages(&self) -> BTreeSet<&str> {
        self.0.keys().map(TypeName::package).collect()
    }

    /// True where a type was shown that has this name on ROS 1 or ROS 2: `demo/Pose`, `demo/msg/Pose`.
    pub(super) fn has(&self, name: &str) -> bool {
        let (package, stem) = (name.split('/').next(), name.split('/').next_back());
        self.0.keys().any(|it| Some(it.package()) == package && Some(it.name()) == stem)
    }

    /// The types of a package, each with one definition: where there are several, that of a node in `chosen`.
    ///
    /// # Errors
    /// Types of which several nodes show different definitions, none or several of which are chosen.
    pub(super) fn of_package(
        &self,
        package: &str,
        chosen: &[String],
    ) -> Result<Vec<&Interface>, Vec<Conflict>> {
        let (mut all, mut conflicts) = (Vec::new(), Vec::new());
        for (name, known) in self.0.iter().filter(|(name, _)| name.package() == package) {
            let is_chosen =
                |one: &&Candidate| one.shown_by.iter().any(|(node, _)| chosen.contains(node));
            let left: Vec<&Candidate> = match known.as_slice() {
                [only] => vec![only],
                several => several.iter().filter(is_chosen).collect(),
            };
            match left.as_slice() {
                [one] => all.push(&one.interface),
                _ => conflicts.push(conflict(name, known)),
            }
        }
        if conflicts.is_empty() { Ok(all) } else { Err(conflicts) }
    }
}

/// Packages that the definitions refer to.
pub(super) fn dependencies<'i>(
    package: &str,
    interfaces: impl IntoIterator<Item = &'i Interface>,
) -> BTreeMap<String, Vec<TypeName>> {
    let mut found = BTreeMap::<String, BTreeSet<TypeName>>::new();
    for interface in interfaces {
        for field in interface.parts.iter().flat_map(|part| &part.fields) {
            if let Element::Nested(nested) = &field.field_type.element
                && nested.package() != package
            {
                found.entry(nested.package().to_owned()).or_default().insert(nested.clone());
            }
        }
        if interface.name.kind() == InterfaceKind::Action {
            // Every action has its messages inside; not all versions of rosidl bring it.
            found.entry("action_msgs".to_owned()).or_default();
        }
    }
    found.into_iter().map(|(package, names)| (package, names.into_iter().collect())).collect()
}

/// The parts of an interface.
fn interface(
    name: &TypeName,
    definitions: &BTreeMap<TypeName, MessageDefinition>,
) -> Option<Interface> {
    let suffixes = Interface::suffixes(name.kind());
    let part = |suffix: &&str| {
        let wanted = format!("{}{suffix}", name.name());
        let is_meant =
            |one: &&MessageDefinition| one.name.name() == wanted && one.name.interface() == *name;
        definitions.values().find(is_meant).cloned()
    };
    let parts = suffixes.iter().map(part).collect::<Option<Vec<_>>>()?;
    Some(Interface { name: name.clone(), parts })
}

/// True for the same fields and constants, whatever the comments.
fn is_same(one: &Interface, other: &Interface) -> bool {
    one.parts.len() == other.parts.len()
        && one.parts.iter().zip(&other.parts).all(|(one, other)| difference(one, other).is_none())
}

/// The first difference of two definitions, in words: what the one has, and what the other.
fn difference(one: &MessageDefinition, other: &MessageDefinition) -> Option<(String, String)> {
    let fields = |of: &MessageDefinition| -> Vec<String> {
        of.fields.iter().map(|field| format!("{} {}", field.field_type, field.name)).collect()
    };
    let constants = |of: &MessageDefinition| -> Vec<String> {
        let text = |it: &wrapyfi_interfaces::parser::Constant| {
            format!("{} {}={}", it.element, it.name, it.written)
        };
        of.constants.iter().map(text).collect()
    };
    let lines = |of| [constants(of), fields(of)].concat();
    let (one, other) = (lines(one), lines(other));
    let longest = one.len().max(other.len());
    let at = |lines: &[String], place: usize| {
        lines.get(place).map_or_else(|| "nothing more".to_owned(), |line| format!("`{line}`"))
    };
    (0..longest).map(|place| (at(&one, place), at(&other, place))).find(|(a, b)| a != b)
}

fn conflict(name: &TypeName, known: &[Candidate]) -> Conflict {
    let first = known.first();
    let each = known.iter().map(|one| {
        let who = one.shown_by.iter().map(|(node, topic)| format!("{node} ({topic})"));
        let who = who.collect::<Vec<_>>().join(", ");
        // The first one beside the next, each other one beside the first.
        let beside = known.iter().find(|it| !std::ptr::eq(*it, one));
        let beside = if first.is_some_and(|it| std::ptr::eq(it, one)) { beside } else { first };
        let differs = beside.and_then(|beside| {
            let parts = one.interface.parts.iter().zip(&beside.interface.parts);
            parts.filter_map(|(own, other)| difference(own, other)).next()
        });
        let has = differs.map_or_else(String::new, |(own, _)| format!(" has {own}"));
        format!("{who}{has}")
    });
    let example = known.first().and_then(|one| one.shown_by.first());
    Conflict {
        name: name.clone(),
        count: known.len(),
        each: each.collect(),
        example: example.map_or_else(String::new, |(node, _)| node.clone()),
    }
}

#[cfg(test)]
mod tests {
    use wrapyfi_interfaces::parser::Dialect;

    use super::*;

    fn resolved(text: &str) -> ResolvedType {
        let name = TypeName::parse(Dialect::Ros2, "demo/msg/Whole").unwrap();
        let text = format!("Pose at\n================\nMSG: demo/Pose\n{text}");
        ResolvedType::from_text(Dialect::Ros2, &name, &text).unwrap()
    }

    #[test]
    fn two_definitions_of_one_type_are_named_with_their_nodes_until_one_is_chosen() {
        let mut gathered = Gathered::default();
        for (node, topic, text) in [
            ("/arm", "/a", "float64 x\n"),
            ("/hand", "/b", "float64 x # the same\n"),
            ("/head", "/c", "float32 x\n"),
        ] {
            gathered.take(&resolved(text), node, topic);
        }
        assert_eq!(gathered.packages().into_iter().collect::<Vec<_>>(), ["demo"]);
        let conflicts = gathered.of_package("demo", &[]).unwrap_err();
        let said = conflicts[0].to_string();
        assert_eq!(
            said,
            "demo/msg/Pose has 2 definitions: /arm (/a), /hand (/b) has `float64 x` and /head (/c) has \
             `float32 x`; build the nodes from one, or choose with `wrapyfi export --from /arm`"
        );
        for (node, field) in [("/hand", "float64"), ("/head", "float32")] {
            let chosen = gathered.of_package("demo", &[node.to_owned()]).unwrap();
            let pose = chosen.iter().find(|it| it.name.name() == "Pose").unwrap();
            assert_eq!(pose.parts[0].fields[0].field_type.to_string(), field);
        }
        let both = ["/arm".to_owned(), "/head".to_owned()];
        assert!(gathered.of_package("demo", &both).is_err());
    }

    #[test]
    fn other_packages_and_what_every_action_has_are_dependencies() {
        let name = TypeName::parse(Dialect::Ros2, "demo/action/Do").unwrap();
        let store = wrapyfi_interfaces::store::TypeStore::generated();
        let mut store = wrapyfi_interfaces::store::TypeStore::empty().or(store);
        store.add_definition(&name, "std_msgs/Header h\n---\n---\n").unwrap();
        let action = interface(&name, store.resolve(&name).unwrap().definitions()).unwrap();
        let found = dependencies("demo", [&action]);
        assert_eq!(found.keys().collect::<Vec<_>>(), ["action_msgs", "std_msgs"]);
        assert_eq!(found["std_msgs"][0].to_string(), "std_msgs/msg/Header");
    }
}
