//! Marks of bridges among the parameters of the master: who made which topic by pattern.
//!
//! ```text
//!   /wrapyfi_bridges/9f3a…: "publisher /chatter /wrapyfi_bridge 0196a3b2c4d5e6f7:ros2"
//! ```
//!
//! The master tells names of nodes and nothing else of them, and a connection may cost its publisher
//! something: so bridges say it where everybody may look. The mark of a bridge that was killed names
//! a node that the master no longer has for that topic.

use std::collections::BTreeMap;
use std::fmt;
use std::hash::{BuildHasher as _, BuildHasherDefault, DefaultHasher};

use super::xmlrpc::Value;
use wrapyfi_endpoint::{BridgeMark, Role};

/// Namespace of the parameter server below which bridges leave their marks.
pub(super) const NAMESPACE: &str = "/wrapyfi_bridges";
/// Most marks that are read.
const MAX_MARKS: usize = 20_000;

/// Something that a bridge made by pattern.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Marked {
    pub(super) role: Role,
    pub(super) name: String,
    pub(super) node: String,
    pub(super) mark: BridgeMark,
}

/// The marks by role, topic or service, and node.
pub(super) type Marks = BTreeMap<(Role, String, String), BridgeMark>;

impl Marked {
    /// Name of its parameter.
    pub(super) fn parameter(&self) -> String {
        let hasher = BuildHasherDefault::<DefaultHasher>::default();
        let number = hasher.hash_one((self.role, &self.name, &self.node));
        format!("{NAMESPACE}/m{number:016x}")
    }

    pub(super) fn parse(text: &str) -> Option<Self> {
        let mut words = text.split(' ');
        let role = match words.next()? {
            "publisher" => Role::Publisher,
            "server" => Role::Server,
            "action_server" => Role::ActionServer,
            _ => return None,
        };
        let (name, node) = (words.next()?.to_owned(), words.next()?.to_owned());
        let mark = words.next()?.parse().ok()?;
        Some(Self { role, name, node, mark })
    }
}

impl fmt::Display for Marked {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { role, name, node, mark } = self;
        write!(f, "{role} {name} {node} {mark}")
    }
}

/// Reads the namespace. Anything but marks is passed over: any program may write there.
pub(super) fn read(value: Option<&Value>) -> Marks {
    let Some(Value::Struct(members)) = value else { return Marks::new() };
    let texts = members.values().filter_map(|value| match value {
        Value::String(text) => Marked::parse(text),
        _ => None,
    });
    texts.take(MAX_MARKS).map(|found| ((found.role, found.name, found.node), found.mark)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_are_read_as_they_are_written() {
        let mark = BridgeMark { bridge: 7, path: vec!["ros2".into()] };
        let marked = Marked {
            role: Role::Publisher,
            name: "/chatter".into(),
            node: "/bridge".into(),
            mark: mark.clone(),
        };
        assert_eq!(Marked::parse(&marked.to_string()), Some(marked.clone()));
        assert!(marked.parameter().starts_with("/wrapyfi_bridges/m"));
        let other = Marked { role: Role::Server, ..marked.clone() };
        assert_ne!(marked.parameter(), other.parameter());
        let odd = Value::String("publisher /x".into());
        let members = [("a".into(), Value::String(marked.to_string())), ("b".into(), odd)];
        let read = read(Some(&Value::Struct(members.into_iter().collect())));
        let key = (Role::Publisher, "/chatter".to_owned(), "/bridge".to_owned());
        assert_eq!(read, Marks::from([(key, mark)]));
    }
}
