//! Middlewares by name.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::{Clock, Middleware};

/// The middlewares of this process, by name, and the clock of its routes. A crate of its own adds one with
/// [`Registry::register`] just as the built-in ones are added.
///
/// ```
/// # mod wrapyfi_core {
/// #     pub use wrapyfi_endpoint as endpoint;
/// #     pub mod middleware { pub use wrapyfi_endpoint::memory; }
/// # }
/// use std::sync::Arc;
/// use wrapyfi_core::endpoint::Registry;
/// use wrapyfi_core::middleware::memory::Memory;
/// let mut registry = Registry::new();
/// registry.register(Arc::new(Memory::new("memory")));
/// assert_eq!(registry.get("memory")?.name(), "memory");
/// # Ok::<(), wrapyfi_endpoint::UnknownMiddleware>(())
/// ```
#[derive(Clone, Default)]
pub struct Registry {
    middlewares: BTreeMap<String, Arc<dyn Middleware>>,
    clock: Clock,
}

/// An address names a middleware that is not in the registry.
///
/// ```
/// # mod wrapyfi_core {
/// #     pub use wrapyfi_endpoint as endpoint;
/// #     pub mod middleware { pub use wrapyfi_endpoint::memory; }
/// # }
/// use std::sync::Arc;
/// use wrapyfi_core::endpoint::Registry;
/// use wrapyfi_core::middleware::memory::Memory;
/// let mut registry = Registry::new();
/// registry.register(Arc::new(Memory::new("memory")));
/// let Err(error) = registry.get("zeromq") else { panic!("it is there") };
/// assert_eq!(error.to_string(), "middleware \"zeromq\" is not available here; available: memory");
/// ```
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("middleware {name:?} is not available here; available: {}", available.join(", "))]
pub struct UnknownMiddleware {
    /// Name that was asked for.
    pub name: String,
    /// Names of the middlewares that exist.
    pub available: Vec<String>,
}

impl Registry {
    /// A registry without middlewares.
    pub fn new() -> Self {
        Self::default()
    }

    /// Enters a middleware under its name, in place of one that had it.
    pub fn register(&mut self, middleware: Arc<dyn Middleware>) {
        self.middlewares.insert(middleware.name().to_owned(), middleware);
    }

    /// Sets the clock from which routes take the time, in place of the system's.
    pub fn set_clock(&mut self, clock: Clock) {
        self.clock = clock;
    }

    /// The clock of routes.
    pub fn clock(&self) -> &Clock {
        &self.clock
    }

    /// True when both registries have the same started middleware under this name.
    pub fn has_same(&self, other: &Self, name: &str) -> bool {
        match (self.middlewares.get(name), other.middlewares.get(name)) {
            (Some(one), Some(another)) => Arc::ptr_eq(one, another),
            (one, another) => one.is_none() && another.is_none(),
        }
    }

    /// Removes the middleware called `name`; routes that have it keep it.
    pub fn remove(&mut self, name: &str) {
        self.middlewares.remove(name);
    }

    /// The middleware called `name`.
    ///
    /// # Errors
    /// When no middleware has the name; the error lists those that exist.
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
