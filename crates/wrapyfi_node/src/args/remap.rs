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
use super::lexer::{Cursor, Lexeme};
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
        let mut cursor = Cursor::new(text);
        let node = cursor.node_prefix().map(str::to_owned);
        let target = match cursor.peek() {
            Lexeme::Node => {
                value(&mut cursor, token, node_refused, warnings).map(Target::NodeName)?
            }
            Lexeme::Namespace => value(&mut cursor, fully_qualified, namespace_refused, warnings)
                .map(Target::Namespace)?,
            _ => name_target(&mut cursor)?,
        };
        cursor.expect(Lexeme::Eof)?;
        Ok(Self { node, target })
    }

    fn is_for(&self, node: &str) -> bool {
        self.node.as_deref().is_none_or(|wanted| wanted == node)
    }
}

/// Reads `:=` and the value behind it, of whose refusal a warning tells.
fn value(
    cursor: &mut Cursor<'_>,
    read: fn(&mut Cursor<'_>) -> Result<(), RuleError>,
    refusal: fn(&str) -> String,
    warnings: &mut Vec<String>,
) -> Result<String, RuleError> {
    cursor.accept();
    cursor.expect(Lexeme::Separator)?;
    let found = cursor.rest().to_owned();
    if let Err(error) = read(cursor) {
        warnings.push(refusal(&found));
        return Err(error);
    }
    Ok(found)
}

fn node_refused(found: &str) -> String {
    format!("Node name not remapped to invalid name: '{found}'")
}

fn namespace_refused(found: &str) -> String {
    format!("Namespace not remapped to a fully qualified name (found: {found})")
}

fn token(cursor: &mut Cursor<'_>) -> Result<(), RuleError> {
    cursor.expect(Lexeme::Token).map(drop)
}

/// `/`, `/a`, `/a/b`; a slash at the end is left to the check of the node's name.
fn fully_qualified(cursor: &mut Cursor<'_>) -> Result<(), RuleError> {
    cursor.expect(Lexeme::Slash)?;
    while cursor.expect(Lexeme::Token).is_ok() && cursor.expect(Lexeme::Slash).is_ok() {}
    cursor.expect(Lexeme::Eof).map(drop)
}

fn name_target(cursor: &mut Cursor<'_>) -> Result<Target, RuleError> {
    let scope = match cursor.peek() {
        Lexeme::TopicUrl => Scope::Topics,
        Lexeme::ServiceUrl => Scope::Services,
        _ => Scope::Both,
    };
    if scope != Scope::Both {
        cursor.accept();
    }
    let from = name(cursor, Lexeme::Separator, match_token)?;
    cursor.expect(Lexeme::Separator)?;
    let to = name(cursor, Lexeme::Eof, replacement_token)?;
    Ok(Target::Name { scope, from, to })
}

/// `a/b`, `/a/b` or `~/a/b` up to `end`.
fn name(
    cursor: &mut Cursor<'_>,
    end: Lexeme,
    token: fn(&mut Cursor<'_>) -> Result<(), RuleError>,
) -> Result<String, RuleError> {
    let start = cursor.rest();
    if matches!(cursor.peek(), Lexeme::TildeSlash | Lexeme::Slash) {
        cursor.accept();
    }
    token(cursor)?;
    while cursor.peek() != end {
        cursor.expect(Lexeme::Slash)?;
        token(cursor)?;
    }
    Ok(cursor.since(start).to_owned())
}

pub(super) fn match_token(cursor: &mut Cursor<'_>) -> Result<(), RuleError> {
    let found = cursor.peek();
    token(cursor).map_err(|_other| match found {
        Lexeme::WildOne => RuleError::Wildcard("*"),
        Lexeme::WildMulti => RuleError::Wildcard("**"),
        _ => RuleError::NoToken,
    })
}

fn replacement_token(cursor: &mut Cursor<'_>) -> Result<(), RuleError> {
    let found = cursor.peek();
    token(cursor).map_err(|_other| match found {
        Lexeme::BackReference(_) => RuleError::BackReference,
        _ => RuleError::NoReplacement,
    })
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
    fn broken_rules_name_the_place() {
        assert_eq!(error("a/*:=x"), "Wildcard '*' is not implemented");
        assert_eq!(error(r"a:=\1"), "Backreferences are not implemented");
        assert_eq!(error(""), "Expecting token or wildcard");
        assert_eq!(error("a__b:=c"), "Expected lexeme type 19, got 18 at index 2");
        assert_eq!(error("__node"), "Expected lexeme type (8) not found, search ended at index 6");
        assert_eq!(error("rostopic://"), "Expecting token or wildcard");
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
