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

/// Characters of a key that are shown: keys come from foreign messages.
const SHOWN: usize = 40;

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
                    let shown: String = key.chars().take(SHOWN).collect();
                    let more = if shown.len() < key.len() { "…" } else { "" };
                    write!(f, "{parent}[{shown:?}{more}]")
                }
            }
        }
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
