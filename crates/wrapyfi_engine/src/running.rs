//! Routes at work on threads.
//!
//! ```text
//!   reconciler ── looks at what exists ──▶ starts and stops routes, waits for none of them
//!   route-timer ─┐
//!   route-worker ┴─ step them
//! ```

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use wrapyfi_interfaces::store::TypeStore;

use super::driver::Driver;
use super::member::Member;
use super::plan::Plan;
use super::plan_diff::{ApplyError, PlanDiff};
use super::route_status::RouteStatus;
use super::tap::Tap;
use wrapyfi_endpoint::Registry;

/// Longest time that a stop waits for steps that block, and for a look at discovery.
const STOP_WITHIN: Duration = Duration::from_secs(1);
/// Pause between two looks whether all routes are closed.
const LOOK_AGAIN: Duration = Duration::from_millis(5);
/// Largest number of routes that close at once.
const CLOSE_AT_ONCE: usize = 16;
/// Pause of the reconciler where there are no patterns; a new plan rings before.
const IDLE: Duration = Duration::from_secs(3600);

/// Routes at work. Dropping it stops them.
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
#[derive(Clone)]
pub struct Applier(Arc<Driver>);

impl Applier {
    /// Turns to another plan, as a whole or not at all. Routes that are the same in both go on
    /// untouched, also those that a pattern made where the new one makes them the same. Routes on a
    /// middleware that `registry` has replaced begin anew. `types` has the definitions that
    /// patterns learn. Returns the difference at once; routes begin and end soon after.
    ///
    /// # Errors
    /// When the plan needs a middleware that is not in `registry`; the plan before goes on.
    pub fn apply(
        &self,
        plan: Plan,
        types: TypeStore,
        registry: Registry,
    ) -> Result<PlanDiff, ApplyError> {
        self.0.apply(plan, types, registry)
    }

    /// Starts the routes of the plan, as they are at first, or stops them all: their ends close, and plan and
    /// middlewares stay. It happens soon after.
    pub fn set_active(&self, is_active: bool) {
        self.0.set_active(is_active);
    }

    /// Waits until no end of a route is open any more, at most for some time; true where that is so.
    #[must_use]
    pub fn wait_closed(&self, most: Duration) -> bool {
        let end = Instant::now() + most;
        while !self.0.is_closed() {
            if Instant::now() >= end {
                return false;
            }
            std::thread::sleep(LOOK_AGAIN);
        }
        true
    }

    /// Turns to other middlewares of the same names: routes on one that is another begin anew.
    pub fn turn_to(&self, registry: Registry) {
        self.0.turn_to(registry);
    }

    /// The latest plan.
    #[must_use]
    pub fn plan(&self) -> Plan {
        self.0.plan()
    }

    /// Middlewares of the latest plan.
    #[must_use]
    pub fn registry(&self) -> Registry {
        self.0.registry()
    }

    /// Statuses of the routes, then of the patterns and of the names they match that have no route
    /// yet. It waits for no route: one in the middle of a step shows its state before it, and that
    /// it is blocked once the step takes over a second.
    #[must_use]
    pub fn status(&self) -> Vec<RouteStatus> {
        self.0.status()
    }

    /// Window on the messages of a route that carries a topic, by its name and its ends as its status has
    /// them.
    #[must_use]
    pub fn tap(&self, name: &str, from: &str, to: &str) -> Option<Arc<Tap>> {
        self.0.tap([name, from, to])
    }
}

impl Running {
    pub(super) fn start(driver: &Arc<Driver>) -> std::io::Result<Self> {
        let running = Self { applier: Applier(Arc::clone(driver)), stop: Arc::default() };
        let looks = Arc::clone(driver);
        driver.pool.start(move |now| looks.look_at_members(now))?;
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
    #[must_use]
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
        let driver = &self.applier.0;
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
