//! Readers of foreign texts without sockets, for fuzzing: no part of the interface.

use super::marks::Marked;

/// A bridge's mark among the parameters of the master, read and written again; `None` where the text is none.
pub fn marked(text: &str) -> Option<String> {
    Marked::parse(text).map(|marked| marked.to_string())
}
