//! Parameter overrides: `-p` and `--params-file` as one sequence.
//!
//! ```text
//!   -p talker:a:=1 ──▶ rule ─┐
//!                            ├─▶ scalar ─▶ (node pattern, name, value) … ─▶ for_node("/talker")
//!   --params-file f ─▶ file ─┘             in the order given               later ones win
//! ```

mod file;
mod rule;
mod scalar;
mod yaml;

use std::collections::BTreeMap;

pub use file::MAX_FILE_BYTES;
pub(super) use rule::parse_rule;

use super::error::YamlError;
use crate::name::absolute;
use wrapyfi_data::types::ParameterValue;

/// Longest name of a parameter or a node in bytes. Groups join their names, so without a bound
/// a small file could make a long name for each of many parameters.
const MAX_NAME_BYTES: usize = 1024;
/// Most overrides of one command line with all its files.
const MAX_OVERRIDES: usize = 65_536;

/// Parameters of the command line and its files, in order.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Overrides {
    /// Patterns of nodes; entries refer to them by index.
    nodes: Vec<String>,
    entries: Vec<Entry>,
}

#[derive(Debug, Clone, PartialEq)]
struct Entry {
    node: usize,
    name: String,
    value: ParameterValue,
}

impl Overrides {
    /// Starts a group of overrides for the nodes that `pattern` matches.
    fn begin_node(&mut self, pattern: &str) -> Result<usize, YamlError> {
        let pattern = absolute(pattern);
        if self.nodes.last() != Some(&pattern) {
            // Blocks without parameters count too, or a file could have any number of them.
            if self.nodes.len() >= MAX_OVERRIDES {
                return Err(YamlError::TooManyParameters(MAX_OVERRIDES));
            }
            self.nodes.push(pattern);
        }
        Ok(self.nodes.len() - 1)
    }

    fn push(&mut self, node: usize, name: &str, value: ParameterValue) -> Result<(), YamlError> {
        if name.len() > MAX_NAME_BYTES {
            return Err(YamlError::NameTooLong(MAX_NAME_BYTES));
        }
        if self.entries.len() >= MAX_OVERRIDES {
            return Err(YamlError::TooManyParameters(MAX_OVERRIDES));
        }
        self.entries.push(Entry { node, name: name.to_owned(), value });
        Ok(())
    }

    /// The overrides of the node with this fully qualified name.
    pub(super) fn for_node(&self, fqn: &str) -> BTreeMap<String, ParameterValue> {
        let matching: Vec<bool> = self.nodes.iter().map(|node| matches(node, fqn)).collect();
        let mut found = BTreeMap::new();
        for entry in &self.entries {
            if matching.get(entry.node) == Some(&true) {
                found.insert(entry.name.clone(), entry.value.clone());
            }
        }
        found
    }
}

/// True when `pattern` (`/ns/talker`, `/*/talker`, `/**`) matches a fully qualified name: `*` is
/// one part, `**` any number of parts, none included.
fn matches(pattern: &str, fqn: &str) -> bool {
    let name: Vec<&str> = fqn.split('/').skip(1).collect();
    // reached[i]: the pattern so far can end before part i of the name. Linear in both, where
    // trying every length for every `**` would not be.
    let mut reached = vec![false; name.len() + 1];
    if let Some(start) = reached.first_mut() {
        *start = true;
    }
    for part in pattern.split('/').skip(1) {
        let mut next = Vec::with_capacity(reached.len());
        let mut open = false;
        let before = std::iter::once(None).chain(name.iter().zip(&reached).map(Some));
        for (&here, before) in reached.iter().zip(before) {
            open |= here;
            next.push(match part {
                "**" => open,
                _ => before.is_some_and(|(&word, &was)| was && (part == "*" || part == word)),
            });
        }
        reached = next;
    }
    reached.last() == Some(&true)
}

#[cfg(test)]
mod tests {
    use super::super::error::ParamsFileError;
    use super::*;

    #[test]
    fn patterns_match_whole_parts() {
        for (pattern, fqn, expected) in [
            ("/talker", "/talker", true),
            ("/talker", "/ns/talker", false),
            ("/ns/talker", "/ns/talker", true),
            ("/*", "/talker", true),
            ("/*", "/ns/talker", false),
            ("/*/talker", "/ns/talker", true),
            ("/*/talker", "/talker", false),
            ("/**", "/a/b/c", true),
            ("/**/talker", "/talker", true),
            ("/**/talker", "/a/b/talker", true),
            ("/**/talker", "/a/b/listener", false),
            ("/a/**/b/*/c", "/a/x/y/b/z/c", true),
            ("/a/**/b/*/c", "/a/x/y/b/c", false),
        ] {
            assert_eq!(matches(pattern, fqn), expected, "{pattern} {fqn}");
        }
        let stars = "/**".repeat(200);
        assert!(matches(&stars, &"/a".repeat(200)));
    }

    #[test]
    fn hostile_files_are_refused() {
        let add = |content: &[u8]| Overrides::default().add_file(content).unwrap_err();
        assert!(matches!(add(&[0xff]), ParamsFileError::NotUtf8(0)));
        assert!(matches!(add(&vec![b' '; MAX_FILE_BYTES + 1]), ParamsFileError::TooLarge { .. }));
        let name = |n| format!("a:\n ros__parameters:\n  ? {}\n  : 1\n", "x".repeat(n));
        let long = add(name(MAX_NAME_BYTES + 1).as_bytes());
        assert!(matches!(long, ParamsFileError::Yaml(YamlError::NameTooLong { .. })));
        let mut many = String::from("a:\n ros__parameters:\n");
        many.push_str(&"  a: 1\n".repeat(MAX_OVERRIDES + 1));
        let many = add(many.as_bytes());
        assert!(matches!(many, ParamsFileError::Yaml(YamlError::TooManyParameters { .. })));
    }

    #[test]
    fn blocks_without_parameters_are_bounded_too() {
        let mut overrides = Overrides::default();
        let file = "a: {ros__parameters: {}}\nb: {ros__parameters: {}}\n".repeat(20_000);
        overrides.add_file(file.as_bytes()).unwrap();
        assert!(overrides.add_file(file.as_bytes()).is_err());
    }

    #[test]
    fn a_byte_order_mark_is_no_content() {
        let mut overrides = Overrides::default();
        overrides.add_file("\u{feff}a:\n ros__parameters: {b: 1}\n".as_bytes()).unwrap();
        assert_eq!(overrides.for_node("/a").len(), 1);
    }
}
