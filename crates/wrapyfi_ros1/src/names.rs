//! Names of ROS 1: what is valid, what a relative or private name stands for, and remappings.
//!
//! ```text
//!   "scan"  in /arm, node /arm/eye ─▶ /arm/scan         relative: to the namespace
//!   "~scan"                        ─▶ /arm/eye/scan     private: to the node
//!   "/scan"                        ─▶ /scan             global
//!                                        └─ remap /scan:=/laser ─▶ /laser
//! ```
//!
//! Source: the page `Names` of the ROS 1 documentation, and what roscpp does with remappings: both
//! sides are resolved first, then the resolved name is looked up once.

use std::collections::BTreeMap;

/// Longest name in bytes; it is sent with every connection.
const MAX_NAME_BYTES: usize = 1024;

/// Checks the name of a topic, a service or a parameter as it may be written: global, relative or private. Whatever the
/// master of ROS 1 takes is valid: rospy only warns of `/robot-1/x`, and roscpp has `/camera/1st`.
///
/// # Errors
/// The rule that the name breaks, and the remedy.
pub fn check_name(name: &str) -> Result<(), String> {
    let is_odd =
        |letter: char| ":~".contains(letter) || letter.is_whitespace() || letter.is_control();
    parts(name)?
        .find_map(|part| Some((part, part.chars().find(|it| is_odd(*it))?)))
        .map_or(Ok(()), |(part, odd)| {
            Err(format!("{part:?} contains {odd:?}, which names of ROS 1 cannot have"))
        })
}

/// Checks the name of a node or of a namespace, for which rospy and roscpp have rules of their own.
fn check_node_name(name: &str) -> Result<(), String> {
    for part in parts(name)? {
        let mut letters = part.chars();
        if let Some(first) = letters.next().filter(|it| !it.is_ascii_alphabetic() && *it != '_') {
            return Err(format!("{part:?} begins with {first:?}; begin it with a letter"));
        }
        let odd = letters.find(|letter| !letter.is_ascii_alphanumeric() && *letter != '_');
        if let Some(odd) = odd {
            return Err(format!(
                "{part:?} contains {odd:?}; names have letters, digits, underscores and slashes"
            ));
        }
    }
    Ok(())
}

/// Parts of a name between slashes, none of which is empty.
fn parts(name: &str) -> Result<impl Iterator<Item = &str>, String> {
    if name.is_empty() {
        return Err("it is empty; give it a name".to_owned());
    }
    if name.len() > MAX_NAME_BYTES {
        return Err(format!("it is {} bytes long, the limit is {MAX_NAME_BYTES}", name.len()));
    }
    let bare = name.strip_prefix(['/', '~']).unwrap_or(name);
    let bare = bare.strip_prefix('/').filter(|_| name.starts_with("~/")).unwrap_or(bare);
    if bare.split('/').any(str::is_empty) {
        return Err("a part between slashes is empty; remove a slash".to_owned());
    }
    Ok(bare.split('/'))
}

/// Name of a node, and the rules by which it resolves other names.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NodeName {
    /// Absolute name, for instance `/arm/eye`.
    full: String,
    /// Namespace of the node, with a slash at both ends.
    namespace: String,
    remaps: BTreeMap<String, String>,
}

/// Error of a name that breaks ROS 1's rules.
///
/// ```
/// use wrapyfi_ros1::{NodeName, Ros1NameError};
/// let Ros1NameError { name, .. } = NodeName::new("left-eye", "/").unwrap_err();
/// assert_eq!(name, "left-eye");
/// ```
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("ROS 1 name {name:?} is not valid: {reason}")]
pub struct Ros1NameError {
    /// The name.
    pub name: String,
    /// The rule it breaks.
    pub reason: String,
}

fn valid(name: &str, check: impl FnOnce(&str) -> Result<(), String>) -> Result<(), Ros1NameError> {
    check(name).map_err(|reason| Ros1NameError { name: name.to_owned(), reason })
}

impl NodeName {
    /// The node `node` in `namespace`. A node that is named with slashes brings its namespace along.
    ///
    /// # Errors
    /// When one of them is not valid.
    pub fn new(node: &str, namespace: &str) -> Result<Self, Ros1NameError> {
        valid(node, check_node_name)?;
        let inner = namespace.trim_matches('/');
        if !inner.is_empty() {
            valid(inner, check_node_name)?;
        }
        let within = if inner.is_empty() { "/".to_owned() } else { format!("/{inner}/") };
        let full = match node.strip_prefix('~') {
            Some(_) => {
                let reason = "a node cannot be private to itself; remove the ~".to_owned();
                return Err(Ros1NameError { name: node.to_owned(), reason });
            }
            None if node.starts_with('/') => node.to_owned(),
            None => format!("{within}{node}"),
        };
        let end = full.rfind('/').map_or(0, |at| at + 1);
        let namespace = full.get(..end).unwrap_or("/").to_owned();
        Ok(Self { full, namespace, remaps: BTreeMap::new() })
    }

    /// Has `from` mean `to` from now on.
    ///
    /// # Errors
    /// When one of them is not valid.
    pub fn remap(&mut self, from: &str, to: &str) -> Result<(), Ros1NameError> {
        let (from, to) = (self.absolute(from)?, self.absolute(to)?);
        self.remaps.insert(from, to);
        Ok(())
    }

    /// The node's absolute name.
    pub fn full(&self) -> &str {
        &self.full
    }

    /// Resolves a name of this node: makes it absolute, then applies the remappings.
    ///
    /// # Errors
    /// When the name is not valid.
    pub fn resolve(&self, name: &str) -> Result<String, Ros1NameError> {
        let absolute = self.absolute(name)?;
        Ok(self.remaps.get(&absolute).cloned().unwrap_or(absolute))
    }

    fn absolute(&self, name: &str) -> Result<String, Ros1NameError> {
        valid(name, check_name)?;
        Ok(match name.strip_prefix('~') {
            Some(private) => format!("{}/{}", self.full, private.trim_start_matches('/')),
            None if name.starts_with('/') => name.to_owned(),
            None => format!("{}{name}", self.namespace),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The table of the documentation: node, relative, global, private.
    #[test]
    fn names_resolve_as_documented() {
        let node = NodeName::new("/node1", "/").unwrap();
        assert_eq!(node.resolve("bar").unwrap(), "/bar");
        assert_eq!(node.resolve("/bar").unwrap(), "/bar");
        assert_eq!(node.resolve("~bar").unwrap(), "/node1/bar");
        let node = NodeName::new("/wg/node2", "/").unwrap();
        assert_eq!(node.resolve("bar").unwrap(), "/wg/bar");
        assert_eq!(node.resolve("~/bar").unwrap(), "/wg/node2/bar");
        let node = NodeName::new("node3", "wg/").unwrap();
        assert_eq!(node.full(), "/wg/node3");
        assert_eq!(node.resolve("foo/bar").unwrap(), "/wg/foo/bar");
        assert_eq!(node.resolve("~foo/bar").unwrap(), "/wg/node3/foo/bar");
    }

    #[test]
    fn a_remapping_is_looked_up_once_and_resolved() {
        let mut node = NodeName::new("eye", "/arm").unwrap();
        node.remap("scan", "/laser").unwrap();
        node.remap("/laser", "elsewhere").unwrap();
        node.remap("~raw", "raw").unwrap();
        assert_eq!(node.resolve("scan").unwrap(), "/laser");
        assert_eq!(node.resolve("/arm/scan").unwrap(), "/laser");
        assert_eq!(node.resolve("/laser").unwrap(), "/arm/elsewhere");
        assert_eq!(node.resolve("~raw").unwrap(), "/arm/raw");
        assert_eq!(node.resolve("/scan").unwrap(), "/scan");
    }

    #[test]
    fn names_that_cannot_be_are_told_why() {
        for (name, why) in [
            ("", "empty"),
            ("/", "slash"),
            ("/a//b", "slash"),
            ("a/", "slash"),
            ("/a b", "contains ' '"),
            ("/a~b", "contains '~'"),
            ("/a:b", "contains ':'"),
            ("/a\u{1b}b", "contains '\\u{1b}'"),
            ("~", "slash"),
        ] {
            let reason = check_name(name).unwrap_err();
            assert!(reason.contains(why), "{name:?}: {reason}");
        }
        assert!(check_name(&"x".repeat(1025)).unwrap_err().contains("1024"));
        for name in [
            "a",
            "/a",
            "~a",
            "~/a",
            "/a/b_1",
            "_private",
            "/_hidden/x",
            "/camera/1st",
            "/robot-1/x.y",
            "/ä",
        ] {
            assert_eq!(check_name(name), Ok(()), "{name:?}");
        }
        assert!(NodeName::new("~x", "/").is_err());
        assert!(NodeName::new("x", "/1").is_err() && NodeName::new("left-eye", "/").is_err());
    }
}
