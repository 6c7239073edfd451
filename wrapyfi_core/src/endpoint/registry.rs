//! Middlewares by name.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::{Middleware, RosClock};

/// The middlewares of this process, by name, and the clock of its node. A crate of its own adds one with
/// [`Registry::register`] just as the built-in ones are added.
#[derive(Clone, Default)]
pub struct Registry {
    middlewares: BTreeMap<String, Arc<dyn Middleware>>,
    clock: RosClock,
}

/// An address names a middleware that is not in the registry.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("middleware {name:?} is not available here; available: {}", available.join(", "))]
pub struct UnknownMiddleware {
    /// Name asked for.
    pub name: String,
    /// Names that exist.
    pub available: Vec<String>,
}

impl Registry {
    /// No middleware.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Enters a middleware under its name, in place of one that had it.
    pub fn register(&mut self, middleware: Arc<dyn Middleware>) {
        self.middlewares.insert(middleware.name().to_owned(), middleware);
    }

    /// Has routes take the time from `clock`, not from the system.
    pub fn set_clock(&mut self, clock: RosClock) {
        self.clock = clock;
    }

    /// The clock of the node.
    #[must_use]
    pub fn clock(&self) -> &RosClock {
        &self.clock
    }

    /// The middleware called `name`.
    ///
    /// # Errors
    /// When there is none; the error lists those that exist.
    pub fn get(&self, name: &str) -> Result<&Arc<dyn Middleware>, UnknownMiddleware> {
        self.middlewares.get(name).ok_or_else(|| UnknownMiddleware {
            name: name.to_owned(),
            available: self.middlewares.keys().cloned().collect(),
        })
    }
}

impl std::fmt::Debug for Registry {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_set().entries(self.middlewares.keys()).finish()
    }
}
