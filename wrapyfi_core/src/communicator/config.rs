//! Modes by class and method.

use std::collections::BTreeMap;

use super::mode::Modes;

/// Modes by class and method.
///
/// ```
/// use wrapyfi_core::communicator::{Configuration, Mode, Modes};
/// let read_here = Configuration::default().with("Mirror", "read", Mode::Listen);
/// let by_instance = Modes::ByInstance(vec![Mode::Listen, Mode::Publish]);
/// assert_ne!(read_here, Configuration::default().with("Mirror", "read", by_instance));
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Configuration(pub(super) BTreeMap<String, Vec<Entry>>);

/// The modes of one method.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Entry {
    pub(super) method: String,
    pub(super) modes: Modes,
    /// File and line of the entry.
    pub(super) place: String,
}

impl Configuration {
    /// Adds the modes of one method.
    #[must_use]
    pub fn with(
        mut self,
        class: impl Into<String>,
        method: impl Into<String>,
        modes: impl Into<Modes>,
    ) -> Self {
        let class = class.into();
        let entry =
            Entry { method: method.into(), modes: modes.into(), place: "configuration".to_owned() };
        self.0.entry(class).or_default().push(entry);
        self
    }

    /// Adds the entries of `later`, which replace those of the same method.
    pub(super) fn extend(&mut self, later: Self) {
        for (class, entries) in later.0 {
            self.0.entry(class).or_default().extend(entries);
        }
    }

    pub(super) fn of(&self, class: &str) -> &[Entry] {
        self.0.get(class).map_or(&[], Vec::as_slice)
    }
}
