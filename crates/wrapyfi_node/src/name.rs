//! Names of the graph: nodes, namespaces, topics, services, enclaves.
//!
//! ```text
//!   "chatter"    + /ns, talker ──▶ /ns/chatter
//!   "~/private"  + /ns, talker ──▶ /ns/talker/private      expand, then check
//!   "/abs"                     ──▶ /abs
//! ```

use std::fmt;

/// Longest node name.
const MAX_NODE_NAME: usize = 255;
/// Longest namespace.
const MAX_NAMESPACE: usize = 245;
/// Longest topic or service name.
const MAX_TOPIC: usize = 247;
/// Longest enclave.
const MAX_ENCLAVE: usize = 255;

/// Name of a node and the namespace it lives in.
///
/// ```
/// use wrapyfi_node::NodeName;
/// let node = NodeName::new("talker", "/ns")?;
/// assert_eq!(node.fqn(), "/ns/talker");
/// assert_eq!(node.logger_name(), "ns.talker");
/// assert_eq!(node.expand("~/private")?, "/ns/talker/private");
/// # Ok::<(), wrapyfi_node::NameError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct NodeName {
    name: String,
    namespace: String,
}

impl NodeName {
    /// Checks a name. An empty namespace is the root, a relative one is below the root.
    ///
    /// # Errors
    /// When the name or the namespace breaks the rules of the graph.
    pub fn new(name: &str, namespace: &str) -> Result<Self, NameError> {
        check_node_name(name)?;
        let namespace = absolute(namespace);
        check_namespace(&namespace)?;
        Ok(Self { name: name.to_owned(), namespace })
    }

    /// The name without its namespace.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The absolute namespace, `/` for the root.
    #[must_use]
    pub fn namespace(&self) -> &str {
        &self.namespace
    }

    /// Fully qualified name, for instance `/ns/talker`.
    #[must_use]
    pub fn fqn(&self) -> String {
        join(&self.namespace, &self.name)
    }

    /// Name of the node's logger: the fully qualified name with dots.
    #[must_use]
    pub fn logger_name(&self) -> String {
        self.fqn().trim_start_matches('/').replace('/', ".")
    }

    /// The absolute form of a topic or service name that this node uses.
    ///
    /// `{node}`, `{ns}` and `{namespace}` are replaced, `~` is the node, a relative name is in
    /// the node's namespace.
    ///
    /// # Errors
    /// When the name, or what it becomes, is no topic name.
    pub fn expand(&self, name: &str) -> Result<String, NameError> {
        let name = self.substitute(name)?;
        let expanded = match name.strip_prefix('~') {
            Some("") => self.fqn(),
            Some(rest) if rest.starts_with('/') => format!("{}{rest}", self.fqn()),
            Some(_) => return Err(NameKind::Topic.error(NameFault::TildeInside, 0)),
            None if name.starts_with('/') => name,
            None if name.is_empty() => return Err(NameKind::Topic.error(NameFault::Empty, 0)),
            None => join(&self.namespace, &name),
        };
        Self::check_topic(&expanded)?;
        Ok(expanded)
    }

    /// Checks a topic or service name that is absolute already.
    ///
    /// # Errors
    /// When the name breaks a rule; the error names the first.
    pub fn check_topic(absolute: &str) -> Result<(), NameError> {
        check_absolute(absolute, NameKind::Topic, MAX_TOPIC)
    }

    fn substitute(&self, name: &str) -> Result<String, NameError> {
        let mut out = String::with_capacity(name.len());
        let mut rest = name;
        while let Some((before, after)) = rest.split_once('{') {
            out.push_str(before);
            let at = name.len() - after.len() - 1;
            let Some((key, tail)) = after.split_once('}') else {
                return Err(NameKind::Topic.error(NameFault::OpenBrace, at));
            };
            out.push_str(match key {
                "node" => &self.name,
                // An absolute name may hold {ns}: `/x{ns}/y` is /x/ns/y.
                "ns" | "namespace" => &self.namespace,
                _ => return Err(NameKind::Topic.error(NameFault::UnknownSubstitution, at)),
            });
            rest = tail;
        }
        out.push_str(rest);
        Ok(out)
    }
}

impl fmt::Display for NodeName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.fqn())
    }
}

/// Kind of a refused name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum NameKind {
    /// Name of a node, without namespace.
    Node,
    /// Namespace of a node.
    Namespace,
    /// Topic or service.
    Topic,
    /// Security enclave, which messages call a context.
    Enclave,
}

impl NameKind {
    fn error(self, fault: NameFault, index: usize) -> NameError {
        NameError { kind: self, fault, index }
    }
}

/// The rule a refused name breaks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum NameFault {
    /// The name is empty.
    Empty,
    /// The name does not start at the root.
    NotAbsolute,
    /// The name ends with a slash.
    TrailingSlash,
    /// The name has a character that names cannot have.
    BadCharacter,
    /// The name has two slashes in a row.
    RepeatedSlash,
    /// A part of the name starts with a digit.
    LeadingDigit,
    /// The name is longer than this many bytes.
    TooLong(usize),
    /// `~` with something else than `/` behind it.
    TildeInside,
    /// `{` without `}`.
    OpenBrace,
    /// `{…}` with a word that stands for nothing.
    UnknownSubstitution,
}

/// Error of a name that is not valid, in the words of ROS 2.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("{}", self.text())]
pub struct NameError {
    /// Kind of the name.
    pub kind: NameKind,
    /// Rule that the name breaks.
    pub fault: NameFault,
    /// Index of the byte that breaks it.
    pub index: usize,
}

impl NameError {
    fn text(&self) -> String {
        let what = match self.kind {
            NameKind::Node => "node name",
            NameKind::Namespace => "namespace",
            NameKind::Topic => "topic name",
            NameKind::Enclave => "context name",
        };
        let node = self.kind == NameKind::Node;
        let rule = match self.fault {
            NameFault::Empty => "must not be empty",
            NameFault::NotAbsolute => "must be absolute, it must lead with a '/'",
            NameFault::TrailingSlash => "must not end with a '/', unless only a '/'",
            NameFault::BadCharacter if node => {
                "must not contain characters other than alphanumerics or '_'"
            }
            NameFault::BadCharacter => {
                "must not contain characters other than alphanumerics, '_', or '/'"
            }
            NameFault::RepeatedSlash => "must not contain repeated '/'",
            NameFault::LeadingDigit if node => "must not start with a number",
            NameFault::LeadingDigit => "must not have a token that starts with a number",
            NameFault::TooLong(max) if node => {
                return format!("{what} length should not exceed '{max}'");
            }
            NameFault::TooLong(max) => return format!("{what} should not exceed '{max}'"),
            NameFault::TildeInside => "must have a '/' behind the leading tilde '~'",
            NameFault::OpenBrace => "must close every '{' with a '}'",
            NameFault::UnknownSubstitution => {
                "must not have a substitution other than {node}, {ns} or {namespace}"
            }
        };
        format!("{what} {rule}")
    }
}

/// Checks a node name.
pub(super) fn check_node_name(name: &str) -> Result<(), NameError> {
    let kind = NameKind::Node;
    if name.is_empty() {
        return Err(kind.error(NameFault::Empty, 0));
    }
    if let Some(at) = name.bytes().position(|b| !is_name_byte(b)) {
        return Err(kind.error(NameFault::BadCharacter, at));
    }
    if name.starts_with(|c: char| c.is_ascii_digit()) {
        return Err(kind.error(NameFault::LeadingDigit, 0));
    }
    if name.len() > MAX_NODE_NAME {
        return Err(kind.error(NameFault::TooLong(MAX_NODE_NAME), MAX_NODE_NAME - 1));
    }
    Ok(())
}

/// Checks an absolute namespace; `/` alone is one.
pub(super) fn check_namespace(namespace: &str) -> Result<(), NameError> {
    check_absolute(namespace, NameKind::Namespace, MAX_NAMESPACE)
}

/// Checks a security enclave.
pub(super) fn check_enclave(enclave: &str) -> Result<(), NameError> {
    check_absolute(enclave, NameKind::Enclave, MAX_ENCLAVE)
}

fn check_absolute(name: &str, kind: NameKind, max: usize) -> Result<(), NameError> {
    if name.is_empty() {
        return Err(kind.error(NameFault::Empty, 0));
    }
    if !name.starts_with('/') {
        return Err(kind.error(NameFault::NotAbsolute, 0));
    }
    if name == "/" && kind != NameKind::Topic {
        return Ok(());
    }
    if name.ends_with('/') {
        return Err(kind.error(NameFault::TrailingSlash, name.len() - 1));
    }
    if let Some(at) = name.bytes().position(|b| b != b'/' && !is_name_byte(b)) {
        return Err(kind.error(NameFault::BadCharacter, at));
    }
    for (at, (byte, next)) in name.bytes().zip(name.bytes().skip(1)).enumerate() {
        if byte == b'/' && next == b'/' {
            return Err(kind.error(NameFault::RepeatedSlash, at + 1));
        }
        if byte == b'/' && next.is_ascii_digit() {
            return Err(kind.error(NameFault::LeadingDigit, at + 1));
        }
    }
    if name.len() > max {
        return Err(kind.error(NameFault::TooLong(max), max - 1));
    }
    Ok(())
}

fn is_name_byte(byte: u8) -> bool {
    byte.is_ascii_alphanumeric() || byte == b'_'
}

/// The namespace with its leading slash.
pub(super) fn absolute(namespace: &str) -> String {
    if namespace.starts_with('/') { namespace.to_owned() } else { format!("/{namespace}") }
}

fn join(namespace: &str, name: &str) -> String {
    if namespace == "/" { format!("/{name}") } else { format!("{namespace}/{name}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_expand_in_the_root_and_below_it() {
        let root = NodeName::new("talker", "").unwrap();
        assert_eq!(root.fqn(), "/talker");
        assert_eq!(root.expand("chatter").unwrap(), "/chatter");
        assert_eq!(root.expand("~").unwrap(), "/talker");
        let below = NodeName::new("talker", "a/b").unwrap();
        assert_eq!(below.namespace(), "/a/b");
        assert_eq!(below.logger_name(), "a.b.talker");
        assert_eq!(below.expand("{node}/x").unwrap(), "/a/b/talker/x");
        assert_eq!(below.expand("/abs").unwrap(), "/abs");
    }

    #[test]
    fn broken_names_say_which_rule_and_where() {
        let node = NodeName::new("n", "/").unwrap();
        let cases = [
            ("", NameFault::Empty, 0),
            ("~x", NameFault::TildeInside, 0),
            ("a//b", NameFault::RepeatedSlash, 3),
            ("a/", NameFault::TrailingSlash, 2),
            ("/a/1", NameFault::LeadingDigit, 3),
            ("é", NameFault::BadCharacter, 1),
            ("a{", NameFault::OpenBrace, 1),
            ("{x}", NameFault::UnknownSubstitution, 0),
            ("/", NameFault::TrailingSlash, 0),
        ];
        for (name, fault, index) in cases {
            let error = node.expand(name).unwrap_err();
            assert_eq!((error.fault, error.index), (fault, index), "{name:?}");
        }
        assert_eq!(NodeName::check_topic("a").unwrap_err().fault, NameFault::NotAbsolute);
        assert_eq!(NodeName::check_topic("/a\0").unwrap_err().fault, NameFault::BadCharacter);
        let long = "a".repeat(300);
        assert_eq!(NodeName::new(&long, "").unwrap_err().fault, NameFault::TooLong(255));
        assert!(NodeName::new("a b", "").is_err());
        assert!(NodeName::new("a", "/ns/").is_err());
    }
}
