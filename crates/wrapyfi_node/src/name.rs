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
/// # mod wrapyfi_core { pub use wrapyfi_node as node; }
/// use wrapyfi_core::node::NodeName;
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
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The absolute namespace, `/` for the root.
    pub fn namespace(&self) -> &str {
        &self.namespace
    }

    /// Fully qualified name, for instance `/ns/talker`.
    pub fn fqn(&self) -> String {
        join(&self.namespace, &self.name)
    }

    /// Name of the node's logger: the fully qualified name with dots.
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
            Some(_) => {
                let rule = "must have a '/' behind the leading tilde '~'";
                return Err(NameError::new(TOPIC, rule, 0));
            }
            None if name.starts_with('/') => name,
            None if name.is_empty() => return Err(NameError::new(TOPIC, "must not be empty", 0)),
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
        check_absolute(absolute, TOPIC, MAX_TOPIC)
    }

    fn substitute(&self, name: &str) -> Result<String, NameError> {
        let mut out = String::with_capacity(name.len());
        let mut rest = name;
        while let Some((before, after)) = rest.split_once('{') {
            out.push_str(before);
            let at = name.len() - after.len() - 1;
            let Some((key, tail)) = after.split_once('}') else {
                return Err(NameError::new(TOPIC, "must close every '{' with a '}'", at));
            };
            out.push_str(match key {
                "node" => &self.name,
                // An absolute name may hold {ns}: `/x{ns}/y` is /x/ns/y.
                "ns" | "namespace" => &self.namespace,
                _ => {
                    let rule =
                        "must not have a substitution other than {node}, {ns} or {namespace}";
                    return Err(NameError::new(TOPIC, rule, at));
                }
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

/// Word that messages have for the name of a topic or service.
const TOPIC: &str = "topic name";

/// Error of a name that is not valid, in the words of ROS 2.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_node as node; }
/// use wrapyfi_core::node::NodeName;
/// let error = NodeName::new("1camera", "/").unwrap_err();
/// assert!(error.to_string().contains("must not"), "{error}");
/// ```
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{what} {rule}")]
pub struct NameError {
    what: &'static str,
    rule: String,
    /// Index of the byte that breaks the rule.
    pub index: usize,
}

impl NameError {
    fn new(what: &'static str, rule: impl Into<String>, index: usize) -> Self {
        Self { what, rule: rule.into(), index }
    }
}

/// Checks a node name.
pub(super) fn check_node_name(name: &str) -> Result<(), NameError> {
    let fault = |rule: &str, index| Err(NameError::new("node name", rule, index));
    if name.is_empty() {
        return fault("must not be empty", 0);
    }
    if let Some(at) = name.bytes().position(|b| !is_name_byte(b)) {
        return fault("must not contain characters other than alphanumerics or '_'", at);
    }
    if name.starts_with(|c: char| c.is_ascii_digit()) {
        return fault("must not start with a number", 0);
    }
    if name.len() > MAX_NODE_NAME {
        let rule = format!("length should not exceed '{MAX_NODE_NAME}'");
        return fault(&rule, MAX_NODE_NAME - 1);
    }
    Ok(())
}

/// Checks an absolute namespace; `/` alone is one.
pub(super) fn check_namespace(namespace: &str) -> Result<(), NameError> {
    check_absolute(namespace, "namespace", MAX_NAMESPACE)
}

/// Checks a security enclave, which messages call a context.
pub(super) fn check_enclave(enclave: &str) -> Result<(), NameError> {
    check_absolute(enclave, "context name", MAX_ENCLAVE)
}

fn check_absolute(name: &str, what: &'static str, max: usize) -> Result<(), NameError> {
    let fault = |rule: &str, index| Err(NameError::new(what, rule, index));
    if name.is_empty() {
        return fault("must not be empty", 0);
    }
    if !name.starts_with('/') {
        return fault("must be absolute, it must lead with a '/'", 0);
    }
    if name == "/" && what != TOPIC {
        return Ok(());
    }
    if name.ends_with('/') {
        return fault("must not end with a '/', unless only a '/'", name.len() - 1);
    }
    if let Some(at) = name.bytes().position(|b| b != b'/' && !is_name_byte(b)) {
        return fault("must not contain characters other than alphanumerics, '_', or '/'", at);
    }
    for (at, (byte, next)) in name.bytes().zip(name.bytes().skip(1)).enumerate() {
        if byte == b'/' && next == b'/' {
            return fault("must not contain repeated '/'", at + 1);
        }
        if byte == b'/' && next.is_ascii_digit() {
            return fault("must not have a token that starts with a number", at + 1);
        }
    }
    if name.len() > max {
        return fault(&format!("should not exceed '{max}'"), max - 1);
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
            ("", "topic name must not be empty", 0),
            ("~x", "topic name must have a '/' behind", 0),
            ("a//b", "topic name must not contain repeated '/'", 3),
            ("a/", "topic name must not end with a '/'", 2),
            ("/a/1", "topic name must not have a token that starts with a number", 3),
            ("é", "topic name must not contain characters other", 1),
            ("a{", "topic name must close every '{'", 1),
            ("{x}", "topic name must not have a substitution other", 0),
            ("/", "topic name must not end with a '/'", 0),
        ];
        for (name, rule, index) in cases {
            let error = node.expand(name).unwrap_err();
            assert!(error.to_string().starts_with(rule), "{name:?}: {error}");
            assert_eq!(error.index, index, "{name:?}");
        }
        let text = |checked: Result<(), NameError>| checked.unwrap_err().to_string();
        let relative = text(NodeName::check_topic("a"));
        assert_eq!(relative, "topic name must be absolute, it must lead with a '/'");
        assert!(text(NodeName::check_topic("/a\0")).contains("other than alphanumerics"));
        let long = NodeName::new(&"a".repeat(300), "").map(drop);
        assert_eq!(text(long), "node name length should not exceed '255'");
        assert!(NodeName::new("a b", "").is_err());
        assert!(NodeName::new("a", "/ns/").is_err());
    }
}
