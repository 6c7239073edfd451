//! The ports that we publish and serve with: what comes from them to us is not received, and they are
//! not found.

use std::collections::BTreeSet;
use std::sync::{Mutex, PoisonError};

/// Their names. A name belongs to one port of a network at a time.
#[derive(Debug, Default)]
pub(super) struct OwnPorts(Mutex<BTreeSet<String>>);

impl OwnPorts {
    fn with<T>(&self, look: impl FnOnce(&mut BTreeSet<String>) -> T) -> T {
        look(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }

    pub(super) fn insert(&self, name: &str) {
        self.with(|names| _ = names.insert(name.to_owned()));
    }

    pub(super) fn remove(&self, name: &str) {
        self.with(|names| _ = names.remove(name));
    }

    pub(super) fn contains(&self, name: &str) -> bool {
        self.with(|names| names.contains(name))
    }
}
