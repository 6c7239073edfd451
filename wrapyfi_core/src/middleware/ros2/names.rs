//! ROS names: what is valid, what a short name stands for, and how DDS spells it.
//!
//! ```text
//!   chatter      ~/status            node /robot/bridge
//!      │             │
//!      ▼ expand      ▼
//!   /robot/chatter   /robot/bridge/status      ── topic_to_dds ──▶  rt/robot/chatter
//!
//!   std_msgs/msg/String                        ── type_to_dds ───▶  std_msgs::msg::dds_::String_
//! ```

use super::graph::NodeIdentity;

/// Longest topic name that DDS can carry with ROS's prefix and suffix.
const MAX_TOPIC: usize = 247;
/// Longest node name.
const MAX_NODE: usize = 255;

/// Why a text is no ROS name.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum NameError {
    /// No characters.
    #[error("the name is empty")]
    Empty,
    /// A character that names cannot have.
    #[error(
        "{found:?} at position {position} is not allowed; names have letters, digits, '_' and '/'"
    )]
    Character {
        /// Character found.
        found: char,
        /// Byte position in the name.
        position: usize,
    },
    /// A part starts with a digit.
    #[error("the part {0:?} starts with a digit")]
    Digit(String),
    /// Two slashes without a part between them.
    #[error("'//' is not allowed")]
    DoubleSlash,
    /// A slash with nothing behind it.
    #[error("the name ends with '/'")]
    TrailingSlash,
    /// `~` elsewhere than alone at the start.
    #[error("'~' is only allowed at the start, followed by '/' or nothing")]
    Tilde,
    /// A substitution that does not exist.
    #[error(
        "the substitution {{{0}}} does not exist; there are {{node}}, {{ns}} and {{namespace}}"
    )]
    Substitution(String),
    /// `{` without `}`, or the reverse.
    #[error("'{{' and '}}' do not match")]
    Braces,
    /// A namespace without its leading slash.
    #[error("the namespace {0:?} does not start with '/'")]
    Relative(String),
    /// Longer than ROS allows.
    #[error("the name has {actual} characters, the limit is {limit}")]
    TooLong {
        /// Length found.
        actual: usize,
        /// Longest allowed.
        limit: usize,
    },
    /// Not `package/kind/Type`.
    #[error("{0:?} is no type name: write it as package/msg/Type")]
    Type(String),
}

impl NodeIdentity {
    /// Full name, for instance `/robot/bridge`.
    #[must_use]
    pub fn full_name(&self) -> String {
        join(&self.namespace, &self.name)
    }

    /// Checks name and namespace.
    ///
    /// # Errors
    /// The first rule that one of them breaks.
    pub fn validate(&self) -> Result<(), NameError> {
        validate_part(&self.name)?;
        limit(&self.name, MAX_NODE)?;
        if !self.namespace.starts_with('/') {
            return Err(NameError::Relative(self.namespace.clone()));
        }
        if self.namespace == "/" { Ok(()) } else { validate_absolute(&self.namespace) }
    }
}

/// The absolute name that `name` has in `node`: relative names live in its namespace, `~` is the
/// node itself, absolute names stay. `{node}`, `{ns}` and `{namespace}` are filled in.
///
/// # Errors
/// When `name` breaks a rule for names.
pub fn expand(name: &str, node: &NodeIdentity) -> Result<String, NameError> {
    if name.is_empty() {
        return Err(NameError::Empty);
    }
    let name = substitute(name, node)?;
    let full = match name.strip_prefix('~') {
        Some("") => node.full_name(),
        Some(rest) => match rest.strip_prefix('/') {
            Some("") => return Err(NameError::TrailingSlash),
            Some(rest) => join(&node.full_name(), rest),
            None => return Err(NameError::Tilde),
        },
        // A namespace may stand before an absolute path: "{ns}/a" in the root is "//a".
        None if name.starts_with('/') => name,
        None => join(&node.namespace, &name),
    };
    validate_absolute(&full)?;
    Ok(full)
}

/// Checks an absolute topic or namespace name.
///
/// # Errors
/// The first rule it breaks.
pub fn validate_absolute(name: &str) -> Result<(), NameError> {
    let Some(rest) = name.strip_prefix('/') else {
        return Err(if name.is_empty() {
            NameError::Empty
        } else {
            NameError::Relative(name.to_owned())
        });
    };
    limit(name, MAX_TOPIC)?;
    if rest.contains("//") || rest.starts_with('/') {
        return Err(NameError::DoubleSlash);
    }
    if rest.is_empty() || rest.ends_with('/') {
        return Err(NameError::TrailingSlash);
    }
    if rest.contains('~') {
        return Err(NameError::Tilde);
    }
    let mut position = 1;
    for part in rest.split('/') {
        validate_part(part).map_err(|error| match error {
            NameError::Character { found, position: inside } => {
                NameError::Character { found, position: position + inside }
            }
            other => other,
        })?;
        position += part.len() + 1;
    }
    Ok(())
}

/// DDS topic of an absolute ROS topic: `/chatter` is `rt/chatter`.
#[must_use]
pub fn topic_to_dds(absolute: &str) -> String {
    format!("rt{absolute}")
}

/// ROS topic of a DDS topic, where it is one: `rt/chatter` is `/chatter`, anything else is none.
#[must_use]
pub fn topic_from_dds(dds: &str) -> Option<&str> {
    dds.strip_prefix("rt").filter(|name| name.starts_with('/'))
}

/// DDS type of a ROS type: `std_msgs/msg/String` is `std_msgs::msg::dds_::String_`.
///
/// # Errors
/// When it is not `package/kind/Type`.
pub fn type_to_dds(ros: &str) -> Result<String, NameError> {
    let fault = || NameError::Type(ros.to_owned());
    let mut parts = ros.split('/');
    let (Some(package), Some(kind), Some(name), None) =
        (parts.next(), parts.next(), parts.next(), parts.next())
    else {
        return Err(fault());
    };
    for part in [package, kind, name] {
        validate_part(part).map_err(|_part| fault())?;
    }
    Ok(format!("{package}::{kind}::dds_::{name}_"))
}

/// ROS type of a DDS type, where it is one.
#[must_use]
pub fn type_from_dds(dds: &str) -> Option<String> {
    let (before, name) = dds.split_once("::dds_::")?;
    let name = name.strip_suffix('_')?;
    let (package, kind) = before.split_once("::")?;
    let plain = |part: &str| validate_part(part).is_ok();
    (plain(package) && plain(kind) && plain(name)).then(|| format!("{package}/{kind}/{name}"))
}

fn join(namespace: &str, name: &str) -> String {
    format!("{}/{name}", namespace.trim_end_matches('/'))
}

fn limit(name: &str, limit: usize) -> Result<(), NameError> {
    let actual = name.len();
    if actual > limit { Err(NameError::TooLong { actual, limit }) } else { Ok(()) }
}

/// One part between slashes.
fn validate_part(part: &str) -> Result<(), NameError> {
    let Some(first) = part.chars().next() else { return Err(NameError::Empty) };
    if first.is_ascii_digit() {
        return Err(NameError::Digit(part.to_owned()));
    }
    match part.char_indices().find(|&(_, c)| !c.is_ascii_alphanumeric() && c != '_') {
        Some((position, found)) => Err(NameError::Character { found, position }),
        None => Ok(()),
    }
}

fn substitute(name: &str, node: &NodeIdentity) -> Result<String, NameError> {
    let mut out = String::with_capacity(name.len());
    let mut rest = name;
    while let Some((before, after)) = rest.split_once('{') {
        let Some((key, after)) = after.split_once('}') else { return Err(NameError::Braces) };
        if before.contains('}') {
            return Err(NameError::Braces);
        }
        out.push_str(before);
        match key {
            "node" => out.push_str(&node.name),
            "ns" | "namespace" => out.push_str(node.namespace.trim_end_matches('/')),
            _ => return Err(NameError::Substitution(key.to_owned())),
        }
        rest = after;
    }
    if rest.contains('}') {
        return Err(NameError::Braces);
    }
    out.push_str(rest);
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn node(namespace: &str) -> NodeIdentity {
        NodeIdentity { name: "bridge".into(), namespace: namespace.into() }
    }

    #[test]
    fn short_names_expand_in_the_nodes_namespace() {
        for (name, namespace, full) in [
            ("chatter", "/", "/chatter"),
            ("chatter", "/robot", "/robot/chatter"),
            ("a/b", "/robot/left", "/robot/left/a/b"),
            ("/chatter", "/robot", "/chatter"),
            ("~", "/", "/bridge"),
            ("~/status", "/", "/bridge/status"),
            ("~/status", "/robot", "/robot/bridge/status"),
            ("{node}/x", "/robot", "/robot/bridge/x"),
            ("{ns}/x", "/robot", "/robot/x"),
            ("{namespace}/x", "/", "/x"),
            ("_hidden/__twice", "/", "/_hidden/__twice"),
        ] {
            assert_eq!(
                expand(name, &node(namespace)).as_deref(),
                Ok(full),
                "{name} in {namespace}"
            );
        }
    }

    #[test]
    fn broken_names_say_which_rule() {
        let root = node("/");
        let fault = |name: &str| expand(name, &root).unwrap_err();
        assert_eq!(fault(""), NameError::Empty);
        assert_eq!(fault("/"), NameError::TrailingSlash);
        assert_eq!(fault("a/"), NameError::TrailingSlash);
        assert_eq!(fault("~/"), NameError::TrailingSlash);
        assert_eq!(fault("a//b"), NameError::DoubleSlash);
        assert_eq!(fault("//a"), NameError::DoubleSlash);
        assert_eq!(fault("a/1b"), NameError::Digit("1b".into()));
        assert_eq!(fault("~a"), NameError::Tilde);
        assert_eq!(fault("a/~"), NameError::Tilde);
        assert_eq!(fault("/a-b"), NameError::Character { found: '-', position: 2 });
        assert_eq!(fault("/x/ü"), NameError::Character { found: 'ü', position: 3 });
        assert_eq!(fault("{nope}/a"), NameError::Substitution("nope".into()));
        assert_eq!(fault("{node"), NameError::Braces);
        assert_eq!(fault("node}/a{ns}"), NameError::Braces);
        let long = format!("/{}", "a".repeat(MAX_TOPIC));
        assert_eq!(fault(&long), NameError::TooLong { actual: 248, limit: 247 });
    }

    #[test]
    fn node_names_are_checked() {
        assert_eq!(node("/").validate(), Ok(()));
        assert_eq!(node("/robot/left").validate(), Ok(()));
        assert_eq!(node("robot").validate(), Err(NameError::Relative("robot".into())));
        assert_eq!(node("/robot/").validate(), Err(NameError::TrailingSlash));
        let slash = NodeIdentity { name: "a/b".into(), namespace: "/".into() };
        assert!(slash.validate().is_err());
    }

    #[test]
    fn dds_names_go_both_ways() {
        assert_eq!(topic_to_dds("/a/b"), "rt/a/b");
        assert_eq!(topic_from_dds("rt/a/b"), Some("/a/b"));
        assert_eq!(topic_from_dds("ros_discovery_info"), None);
        assert_eq!(topic_from_dds("rtx"), None);
        assert_eq!(topic_from_dds("rq/a"), None);
        let dds = type_to_dds("std_msgs/msg/String").unwrap();
        assert_eq!(dds, "std_msgs::msg::dds_::String_");
        assert_eq!(type_from_dds(&dds).as_deref(), Some("std_msgs/msg/String"));
        assert_eq!(type_from_dds("Plain"), None);
        for wrong in ["String", "std_msgs/String", "a/b/c/d", "a/msg/", "a/msg/B-C"] {
            assert_eq!(type_to_dds(wrong), Err(NameError::Type(wrong.into())));
        }
    }
}
