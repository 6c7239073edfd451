//! Remap rules: `-r from:=to`.
//!
//! ```text
//!   [node:] __node := name             name of the node
//!   [node:] __ns   := /namespace       its namespace
//!   [node:] [rostopic://|rosservice://] from := to
//! ```
//!
//! The first rule that matches wins, however special a later one is.

use super::error::RuleError;
use super::rule::{Rule, check_name, is_namespace, is_token};
use crate::{NameError, NodeName};

/// One rule.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct RemapRule {
    node: Option<String>,
    target: Target,
}

#[derive(Debug, Clone, PartialEq, Eq)]
enum Target {
    NodeName(String),
    Namespace(String),
    Name { scope: Scope, from: String, to: String },
}

/// Kind of names that a rule remaps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Scope {
    Both,
    Topics,
    Services,
}

impl RemapRule {
    /// Reads a rule. A refused `__node` or `__ns` is warned of as well, because outside a block
    /// its author gets nothing but the warning.
    pub(super) fn parse(text: &str, warnings: &mut Vec<String>) -> Result<Self, RuleError> {
        let Rule { node, left, right } = Rule::cut(text)?;
        let mut refused = |warning| {
            warnings.push(warning);
            RuleError::no_name(right)
        };
        let target = match left {
            "__node" | "__name" if is_token(right) => Target::NodeName(right.to_owned()),
            "__node" | "__name" => {
                return Err(refused(format!("Node name not remapped to invalid name: '{right}'")));
            }
            "__ns" if is_namespace(right) => Target::Namespace(right.to_owned()),
            "__ns" => {
                return Err(refused(format!(
                    "Namespace not remapped to a fully qualified name (found: {right})"
                )));
            }
            _ => {
                let schemes = [("rostopic://", Scope::Topics), ("rosservice://", Scope::Services)];
                let mut cut = schemes
                    .into_iter()
                    .filter_map(|(it, scope)| Some((scope, left.strip_prefix(it)?)));
                let (scope, from) = cut.next().unwrap_or((Scope::Both, left));
                check_name(from)?;
                check_name(right)?;
                Target::Name { scope, from: from.to_owned(), to: right.to_owned() }
            }
        };
        Ok(Self { node: node.map(str::to_owned), target })
    }

    fn is_for(&self, node: &str) -> bool {
        self.node.as_deref().is_none_or(|wanted| wanted == node)
    }
}

/// The new name of node `node`, if a rule gives one.
pub(super) fn node_name<'a>(rules: &'a [RemapRule], node: &str) -> Option<&'a str> {
    rules.iter().filter(|rule| rule.is_for(node)).find_map(|rule| match &rule.target {
        Target::NodeName(name) => Some(name.as_str()),
        _ => None,
    })
}

/// The namespace of node `node` (its new name), if a rule gives one.
pub(super) fn namespace<'a>(rules: &'a [RemapRule], node: &str) -> Option<&'a str> {
    rules.iter().filter(|rule| rule.is_for(node)).find_map(|rule| match &rule.target {
        Target::Namespace(namespace) => Some(namespace.as_str()),
        _ => None,
    })
}

/// Remaps the absolute `name` for `node`, if a rule in `wanted` matches it.
///
/// # Errors
/// When the rule makes it a name that is too long.
pub(super) fn resource(
    rules: &[RemapRule],
    wanted: Scope,
    node: &NodeName,
    name: &str,
) -> Result<Option<String>, NameError> {
    for rule in rules.iter().filter(|rule| rule.is_for(node.name())) {
        if let Target::Name { scope, from, to } = &rule.target
            && (*scope == Scope::Both || *scope == wanted)
            && node.expand(from).is_ok_and(|from| from == name)
        {
            return node.expand(to).map(Some);
        }
    }
    Ok(None)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error(text: &str) -> String {
        RemapRule::parse(text, &mut Vec::new()).unwrap_err().to_string()
    }

    #[test]
    fn broken_rules_say_what_is_wrong() {
        assert_eq!(error("a/*:=x"), "Wildcard '*' is not implemented");
        assert_eq!(error(r"a:=\1"), "Backreferences are not implemented");
        for text in ["", "__node", "rostopic://", "a"] {
            assert_eq!(
                error(text),
                "a rule is written FROM:=TO, and this one has no `:=`",
                "{text}"
            );
        }
        assert!(error("a__b:=c").starts_with("\"a__b\" is no name: "));
        assert!(error("__nodes:=c").starts_with("\"__nodes\" is no name: "));
        assert_eq!(error("a:="), "a rule is written FROM:=TO, and one of the two is missing");
    }

    #[test]
    fn refused_names_are_warned_of() {
        let mut warnings = Vec::new();
        assert!(RemapRule::parse("__node:=1", &mut warnings).is_err());
        assert!(RemapRule::parse("x:__ns:=a", &mut warnings).is_err());
        assert_eq!(
            warnings,
            [
                "Node name not remapped to invalid name: '1'",
                "Namespace not remapped to a fully qualified name (found: a)"
            ]
        );
    }
}
