//! Parts of a rule of the command line: `talker:chatter:=/news`.

use super::error::RuleError;

/// A rule cut at its first `:=`, and at the colon behind the name of a node.
pub(super) struct Rule<'a> {
    /// Node for which the rule holds; all nodes where it names none.
    pub(super) node: Option<&'a str>,
    /// Text before `:=`, without the node.
    pub(super) left: &'a str,
    /// Text behind `:=`.
    pub(super) right: &'a str,
}

impl<'a> Rule<'a> {
    pub(super) fn cut(text: &'a str) -> Result<Self, RuleError> {
        let (left, right) = text.split_once(":=").ok_or(RuleError::NoSeparator)?;
        // `rostopic://` names no node.
        let cut =
            left.split_once(':').filter(|(node, rest)| is_token(node) && !rest.starts_with("//"));
        let (node, left) = cut.map_or((None, left), |(node, rest)| (Some(node), rest));
        Ok(Self { node, left, right })
    }
}

/// True for letters, digits and single underscores that do not begin with a digit.
pub(super) fn is_token(text: &str) -> bool {
    text.starts_with(|first: char| first.is_ascii_alphabetic() || first == '_')
        && text.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_')
        && !text.contains("__")
}

/// Checks `a/b`, `/a/b` or `~/a/b`.
pub(super) fn check_name(name: &str) -> Result<(), RuleError> {
    let rest = name.strip_prefix("~/").or_else(|| name.strip_prefix('/')).unwrap_or(name);
    if rest.split('/').all(is_token) { Ok(()) } else { Err(RuleError::no_name(name)) }
}

/// True for `/`, `/a` and `/a/b`; a slash at the end is left to the check of the node's name.
pub(super) fn is_namespace(text: &str) -> bool {
    let is_rest = |rest: &str| rest.strip_suffix('/').unwrap_or(rest).split('/').all(is_token);
    text.strip_prefix('/').is_some_and(|rest| rest.is_empty() || is_rest(rest))
}

/// Checks words with dots between them; a word may have slashes, as in
/// `qos_overrides./parameter_events.publisher.depth`.
pub(super) fn check_parameter(name: &str) -> Result<(), RuleError> {
    let is_part = |part: &str| {
        part.is_empty() || (!part.starts_with("__") && is_token(&part.replace("__", "_")))
    };
    let is_word = |word: &str| !word.is_empty() && word.split('/').all(is_part);
    if name.split('.').all(is_word) { Ok(()) } else { Err(RuleError::no_name(name)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rules_are_cut_at_their_node_and_their_separator() {
        let cut = |text| Rule::cut(text).map(|it| (it.node, it.left, it.right));
        assert_eq!(cut("talker:~/a:=/c"), Ok((Some("talker"), "~/a", "/c")));
        assert_eq!(cut("rostopic://x:=y"), Ok((None, "rostopic://x", "y")));
        assert_eq!(cut("n:rosservice://x:=y"), Ok((Some("n"), "rosservice://x", "y")));
        assert_eq!(cut("rostopic:/x:=y"), Ok((Some("rostopic"), "/x", "y")));
        assert_eq!(cut("a:=b:=c"), Ok((None, "a", "b:=c")));
        assert_eq!(cut("a"), Err(RuleError::NoSeparator));
    }

    #[test]
    fn names_are_told_from_what_is_none() {
        for name in ["a", "/a", "~/a/b", "_a", "a_1/b_"] {
            assert_eq!(check_name(name), Ok(()), "{name}");
        }
        for name in ["", "/", "~", "a//b", "a/", "1a", "a__b", "é", "a.b"] {
            assert!(check_name(name).is_err(), "{name}");
        }
        for name in ["a", "a.b", "a__b", "qos_overrides./parameter_events.depth"] {
            assert_eq!(check_parameter(name), Ok(()), "{name}");
        }
        for name in ["", ".", "a.", "__a", "a/1", "a b"] {
            assert!(check_parameter(name).is_err(), "{name}");
        }
        assert!(["/", "/a", "/a/b", "/a/"].into_iter().all(is_namespace));
        assert!(!["", "a", "//", "/a//b", "/1"].into_iter().any(is_namespace));
    }
}
