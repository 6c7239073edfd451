//! Routes at work on threads.
//!
//! ```text
//!   reconciler ── looks at what exists ──▶ starts and stops routes, waits for none of them
//!   route-timer ─┐
//!   route-worker ┴─ step them
//! ```

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use wrapyfi_interfaces::store::TypeStore;

use super::driver::Driver;
use super::member::Member;
use super::plan::Plan;
use super::plan_diff::{ApplyError, PlanDiff};
use super::route::RouteStatus;

/// How long a stop waits for steps that block, and for a look at what exists.
const STOP_WITHIN: Duration = Duration::from_secs(1);
/// Most routes that close at once.
const CLOSE_AT_ONCE: usize = 16;
/// Pause of the reconciler where there are no patterns: a new plan rings.
const IDLE: Duration = Duration::from_secs(3600);

/// Routes at work. Dropping it stops them.
pub struct Running {
    driver: Arc<Driver>,
    stop: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

/// Turns running routes to another plan, as long as they run.
#[derive(Clone)]
pub struct Applier(Arc<Driver>);

impl Applier {
    /// As [`Running::apply`].
    ///
    /// # Errors
    /// As [`Running::apply`].
    pub fn apply(&self, plan: Plan, types: TypeStore) -> Result<PlanDiff, ApplyError> {
        self.0.apply(plan, types)
    }
}

impl Running {
    pub(super) fn start(driver: Arc<Driver>) -> std::io::Result<Self> {
        let mut running = Self { driver, stop: Arc::default(), threads: Vec::new() };
        let driver = Arc::clone(&running.driver);
        let timer = running.driver.pool.start(move || driver.tell_blocked())?;
        running.threads.push(timer);
        let (driver, stop) = (Arc::clone(&running.driver), Arc::clone(&running.stop));
        let thread = std::thread::Builder::new().name("reconciler".to_owned());
        let reconciler = thread.spawn(move || {
            while !stop.load(Ordering::Relaxed) {
                let pause = driver
                    .look(Instant::now())
                    .map_or(IDLE, |next| next.saturating_duration_since(Instant::now()));
                driver.wake.wait(pause);
            }
        })?;
        running.threads.push(reconciler);
        Ok(running)
    }

    /// Turns to another plan: as a whole, or not at all. Routes that are the same in both go on untouched,
    /// also those that a pattern made where the new one makes them the same. `types` has the definitions that
    /// patterns learn. Returns the difference at once; routes begin and end soon after.
    ///
    /// # Errors
    /// When the plan needs a middleware that was not started; the plan before goes on.
    pub fn apply(&self, plan: Plan, types: TypeStore) -> Result<PlanDiff, ApplyError> {
        self.driver.apply(plan, types)
    }

    /// Applies plans from another thread, as [`Running::apply`].
    #[must_use]
    pub fn applier(&self) -> Applier {
        Applier(Arc::clone(&self.driver))
    }

    /// The routes now, then the patterns, and what they mean that is no route yet. Waits for no route: one in
    /// the middle of a step shows as it was before, and says so once the step takes over a second.
    #[must_use]
    pub fn status(&self) -> Vec<RouteStatus> {
        self.driver.status()
    }

    /// Stops every route and closes its ends; the final status. A step that blocks is waited for, but not for
    /// long.
    #[must_use]
    pub fn stop(mut self) -> Vec<RouteStatus> {
        self.halt();
        self.status()
    }

    fn halt(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        self.driver.wake.ring();
        self.driver.pool.stop();
        let end = Instant::now() + STOP_WITHIN;
        let threads = std::mem::take(&mut self.threads);
        let is_busy =
            || self.driver.pool.workers() > 0 || threads.iter().any(|it| !it.is_finished());
        while is_busy() && Instant::now() < end {
            std::thread::sleep(Duration::from_millis(1));
        }
        for thread in threads {
            // Another one is left to itself: it is in the middle of a look that takes too long.
            if thread.is_finished() && thread.join().is_err() {
                tracing::error!("a thread of the routes panicked");
            }
        }
        let members = self.driver.members();
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
