//! Routes at work on threads.
//!
//! ```text
//!   reconciler ── looks at what exists ──▶ starts and stops routes, waits for none of them
//!   route-timer ─┐
//!   route-worker ┴─ step them
//! ```

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use super::driver::Driver;
use super::member::Member;
use super::route_status::RouteStatus;
use wrapyfi_endpoint::give_memory_back;

/// Longest time that a stop waits for steps that block, and for a look at discovery.
const STOP_WITHIN: Duration = Duration::from_secs(1);
/// Largest number of routes that close at once.
const CLOSE_AT_ONCE: usize = 16;
/// Pause of the reconciler where there are no patterns; a new plan rings before.
const IDLE: Duration = Duration::from_secs(3600);

/// Routes at work. Dropping it stops them.
///
/// See [`Engine`](super::Engine).
///
/// ```
/// # use std::{sync::Arc, time::Instant};
/// # use wrapyfi_data::types::MessageType;
/// # use wrapyfi_endpoint::{Registry, memory::Memory};
/// # use wrapyfi_engine::{Engine, Plan, Route, RouteState};
/// # let mut registry = Registry::new();
/// # registry.register(Arc::new(Memory::new("memory")));
/// # let route = Route::topic("memory:/in".parse()?, "memory:/out".parse()?, MessageType::Image);
/// # let plan = Plan { routes: vec![route] };
/// let running = Engine::new(plan, &registry).start()?;
/// let counted = running.stop(); // every route, with its last numbers
/// assert_eq!(counted[0].counters.sent, 0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Running {
    applier: Applier,
    stop: Arc<AtomicBool>,
}

impl std::ops::Deref for Running {
    type Target = Applier;

    fn deref(&self) -> &Applier {
        &self.applier
    }
}

/// Handle of routes that turns them to another plan, as long as they run.
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
/// use wrapyfi_interfaces::store::TypeStore;
/// let mut registry = Registry::new();
/// registry.register(Arc::new(Memory::new("memory")));
/// let running = Engine::new(Plan::default(), &registry).start()?;
/// let route = Route::topic("memory:/in".parse()?, "memory:/out".parse()?, MessageType::Image);
/// let plan = Plan { routes: vec![route] };
/// let diff = running.applier().apply(plan, TypeStore::generated(), registry)?;
/// assert_eq!(diff.added.len(), 1);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub type Applier = Arc<Driver>;

impl Running {
    pub(super) fn start(driver: &Arc<Driver>) -> std::io::Result<Self> {
        let running = Self { applier: Arc::clone(driver), stop: Arc::default() };
        let looks = Arc::clone(driver);
        driver.pool.start(move |now| {
            looks.look_at_members(now);
            give_memory_back(now);
        })?;
        let (looks, stop) = (Arc::clone(driver), Arc::clone(&running.stop));
        driver.pool.spawn("reconciler", move || {
            while !stop.load(Ordering::Relaxed) {
                let pause = looks
                    .look(looks.pool.clock.now())
                    .map_or(IDLE, |next| next.saturating_duration_since(looks.pool.clock.now()));
                looks.wake.wait(pause);
            }
        })?;
        Ok(running)
    }

    /// Handle for another thread.
    pub fn applier(&self) -> Applier {
        self.applier.clone()
    }

    /// Stops every route, closes its ends, and returns the final statuses. It waits at most
    /// one second for a step that blocks.
    #[must_use]
    pub fn stop(mut self) -> Vec<RouteStatus> {
        self.halt();
        self.status()
    }

    fn halt(&mut self) {
        let driver = &self.applier;
        self.stop.store(true, Ordering::Relaxed);
        driver.wake.ring();
        driver.pool.stop();
        // A thread whose step or look takes too long is not waited for.
        driver.pool.wait(STOP_WITHIN);
        let members = driver.members();
        let close = |members: &[Arc<Member>]| {
            for member in members {
                if !member.close() {
                    let RouteStatus { name, state, .. } = member.status();
                    tracing::warn!(route = name, "is left in the middle of a step: {state}");
                }
            }
        };
        // Side by side: a reliable writer of DDS waits a second for a reader that was killed.
        std::thread::scope(|scope| {
            for some in members.chunks(members.len().div_ceil(CLOSE_AT_ONCE).max(1)) {
                let thread = std::thread::Builder::new().name("route-close".to_owned());
                if thread.spawn_scoped(scope, move || close(some)).is_err() {
                    close(some);
                }
            }
        });
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.halt();
    }
}
