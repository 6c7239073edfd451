//! Path from a value to the part that has an error, kept without allocating until there is one.

use std::fmt;

/// A step on the way from the whole value, `$`, to one of its parts: a list on the call stack.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Path<'a> {
    /// The whole.
    Root,
    /// The member of a `dict`.
    Key(&'a Self, &'a str),
    /// The member of a sequence.
    Index(&'a Self, usize),
}

/// Number of characters of foreign text that an error shows.
pub const SHOWN: usize = 40;

impl fmt::Display for Path<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Root => f.write_str("$"),
            Self::Index(parent, index) => write!(f, "{parent}[{index}]"),
            Self::Key(parent, key) => {
                let plain = |c: char| c.is_ascii_alphanumeric() || c == '_';
                if !key.is_empty() && key.len() <= SHOWN && key.chars().all(plain) {
                    write!(f, "{parent}.{key}")
                } else {
                    write!(f, "{parent}[{}]", quote(key))
                }
            }
        }
    }
}

/// Writes text of a message for an error: short, and quoted.
pub fn quote(text: &str) -> String {
    match text.char_indices().nth(SHOWN) {
        None => format!("{text:?}"),
        Some((end, _)) => format!("{:?}…", text.get(..end).unwrap_or_default()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_and_indices() {
        let frames = Path::Key(&Path::Root, "frames");
        let third = Path::Index(&frames, 3);
        assert_eq!(Path::Key(&third, "a b").to_string(), "$.frames[3][\"a b\"]");
        let long = "x".repeat(100);
        assert_eq!(Path::Key(&Path::Root, &long).to_string().len(), 4 + SHOWN + "…".len() + 1);
    }
}
