//! Runs the routes of a plan: step by step for tests, on threads in production.

use std::sync::Arc;
use std::time::Instant;

use wrapyfi_interfaces::store::TypeStore;

use super::driver::Driver;
use super::plan::Plan;
use super::plan_diff::PlanDiff;
use super::rate;
use super::route_status::RouteStatus;
use super::running::Running;
use wrapyfi_endpoint::{EndpointAddress, Registry, UnknownMiddleware};

/// The routes of a plan, not running yet.
///
/// ```
/// # mod wrapyfi_core {
/// #     pub use {wrapyfi_data::types, wrapyfi_endpoint as endpoint, wrapyfi_engine as engine};
/// #     pub mod middleware { pub use wrapyfi_endpoint::memory; }
/// # }
/// use std::sync::Arc;
/// use wrapyfi_core::endpoint::Registry;
/// use wrapyfi_core::engine::{Engine, Plan, Route};
/// use wrapyfi_core::middleware::memory::Memory;
/// use wrapyfi_core::types::MessageType;
/// let mut registry = Registry::new();
/// registry.register(Arc::new(Memory::new("memory")));
/// let route = Route::topic("memory:/in".parse()?, "memory:/out".parse()?, MessageType::Image);
/// let running = Engine::new(Plan { routes: vec![route] }, &registry).start()?;
/// assert_eq!(running.status().len(), 1); // dropping it stops the routes
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Engine {
    driver: Arc<Driver>,
    look_at: Option<Instant>,
    rates_at: Option<Instant>,
}

impl Engine {
    /// Prepares the routes; nothing is opened before the first step.
    pub fn new(plan: Plan, registry: &Registry) -> Self {
        Self { driver: Arc::new(Driver::new(plan, registry)), look_at: None, rates_at: None }
    }

    /// Looks up the types that patterns learn in `types`; without this call below
    /// `AMENT_PREFIX_PATH`, then among the definitions that are built in.
    #[must_use]
    pub fn with_types(self, types: TypeStore) -> Self {
        self.driver.set_types(types);
        self
    }

    /// Leaves out of every pattern what the program has at these addresses about itself.
    #[must_use]
    pub fn with_own(self, addresses: impl IntoIterator<Item = EndpointAddress>) -> Self {
        self.driver.set_own(addresses.into_iter().collect());
        self
    }

    /// As `apply` of [`Applier`](super::Applier); the next step turns to the plan.
    ///
    /// # Errors
    /// As there.
    pub fn apply(
        &mut self,
        plan: Plan,
        types: TypeStore,
        registry: Registry,
    ) -> Result<PlanDiff, UnknownMiddleware> {
        let diff = self.driver.apply(plan, types, registry)?;
        self.look_at = None;
        Ok(diff)
    }

    /// Brings every route one step on; number of messages taken.
    pub fn step(&mut self, now: Instant) -> usize {
        if self.look_at.is_none_or(|at| now >= at) {
            let next = self.driver.look(now);
            self.look_at = Some(next.unwrap_or(now + super::reconciler::LOOK_EVERY));
        }
        let members = self.driver.members();
        if self.rates_at.is_none_or(|at| now.saturating_duration_since(at) >= rate::LOOK_EVERY) {
            self.rates_at = Some(now);
            members.iter().for_each(|member| member.look(now));
        }
        members.iter().filter_map(|member| member.step(now)).map(|step| step.moved).sum()
    }

    /// Statuses of the routes, then of the patterns and of the names they match that have no route
    /// yet.
    pub fn status(&self) -> Vec<RouteStatus> {
        self.driver.status()
    }

    /// Runs the routes on threads: a few for all of them, and one that looks at discovery.
    ///
    /// # Errors
    /// When the system refuses a thread.
    pub fn start(self) -> std::io::Result<Running> {
        Running::start(&self.driver)
    }
}
