//! Routes at work: a thread each, and one that makes and ends those of patterns.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Instant;

use super::engine::{Work, log_end};
use super::route::RouteStatus;
use super::scout::{Change, LOOK_EVERY, Scout};
use crate::endpoint::{Registry, Wake};

/// Routes at work. Dropping it stops them.
pub struct Running {
    shared: Arc<Shared>,
    /// Makes and ends routes by pattern, where there are patterns.
    scout: Option<JoinHandle<()>>,
}

/// What the thread of the patterns shares with the owner.
struct Shared {
    registry: Registry,
    stop: AtomicBool,
    wake: Wake,
    routes: Mutex<Vec<Route>>,
    /// What the patterns say of themselves.
    found: Mutex<Vec<RouteStatus>>,
}

struct Route {
    id: u64,
    stop: Arc<AtomicBool>,
    relay: Arc<Mutex<Work>>,
    status: StatusCache,
    wake: Wake,
    thread: Option<JoinHandle<()>>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Route {
    fn start(id: u64, relay: Work) -> std::io::Result<Self> {
        let wake = relay.wake().clone();
        let relay = Arc::new(Mutex::new(relay));
        let stop = Arc::new(AtomicBool::new(false));
        let status = StatusCache::new(&relay);
        let (stopped, shared, bell) = (Arc::clone(&stop), Arc::clone(&relay), wake.clone());
        let thread = std::thread::Builder::new()
            .name(format!("route-{id}"))
            .spawn(move || run(&shared, &bell, &stopped))?;
        Ok(Self { id, stop, relay, status, wake, thread: Some(thread) })
    }

    fn tell_to_stop(&self) {
        self.stop.store(true, Ordering::Relaxed);
        self.wake.ring();
    }

    fn join(&mut self) {
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("a route's thread panicked");
        }
    }
}

fn run(relay: &Mutex<Work>, wake: &Wake, stop: &AtomicBool) {
    while !stop.load(Ordering::Relaxed) {
        let step = lock(relay).step(Instant::now());
        let rest = step.next.saturating_duration_since(Instant::now());
        if !rest.is_zero() {
            wake.wait(rest);
        }
    }
}

/// The last status seen, for when the route is busy inside a blocking send.
struct StatusCache(Mutex<RouteStatus>);

impl StatusCache {
    fn new(relay: &Mutex<Work>) -> Self {
        Self(Mutex::new(lock(relay).status()))
    }

    fn refresh(&self, relay: &Mutex<Work>) -> RouteStatus {
        let mut cached = lock(&self.0);
        if let Ok(relay) = relay.try_lock() {
            *cached = relay.status();
        }
        cached.clone()
    }
}

impl Shared {
    fn change(&self, scout: &mut Scout, change: Change) {
        match change {
            Change::Make { id, made, counters } => {
                match Route::start(id, Work::made(id, made, counters, &self.registry)) {
                    Ok(route) => lock(&self.routes).push(route),
                    Err(error) => scout.failed(id, &format!("the system gives no thread: {error}")),
                }
            }
            Change::KeepOpen { id } => {
                let found = lock(&self.routes)
                    .iter()
                    .find(|route| route.id == id)
                    .map(|route| Arc::clone(&route.relay));
                // Outside the lock, as below.
                if let Some(relay) = found {
                    lock(&relay).keep_open();
                }
            }
            Change::End { id, why } => {
                let found = {
                    let mut routes = lock(&self.routes);
                    let place = routes.iter().position(|route| route.id == id);
                    place.map(|place| routes.remove(place))
                };
                // Outside the lock: it may be in the middle of a send.
                if let Some(mut route) = found {
                    route.tell_to_stop();
                    route.join();
                    log_end(&lock(&route.relay).status(), &why);
                }
            }
        }
    }

    fn scout(&self, mut scout: Scout) {
        while !self.stop.load(Ordering::Relaxed) {
            for change in scout.scan(Instant::now()) {
                self.change(&mut scout, change);
            }
            *lock(&self.found) = scout.status();
            self.wake.wait(LOOK_EVERY);
        }
    }
}

impl Running {
    pub(super) fn start(
        registry: Registry,
        relays: Vec<(u64, Work)>,
        scout: Option<Scout>,
    ) -> std::io::Result<Self> {
        let shared = Arc::new(Shared {
            registry,
            stop: AtomicBool::new(false),
            wake: Wake::new(),
            routes: Mutex::default(),
            found: Mutex::new(scout.as_ref().map(Scout::status).unwrap_or_default()),
        });
        let mut running = Self { shared, scout: None };
        for (id, relay) in relays {
            let route = Route::start(id, relay)?;
            lock(&running.shared.routes).push(route);
        }
        if let Some(scout) = scout {
            let shared = Arc::clone(&running.shared);
            let thread = std::thread::Builder::new()
                .name("route-patterns".to_owned())
                .spawn(move || shared.scout(scout))?;
            running.scout = Some(thread);
        }
        Ok(running)
    }

    /// The routes now, then the patterns, and what they mean that is no route yet. A route in the
    /// middle of a step shows as it was just before.
    #[must_use]
    pub fn status(&self) -> Vec<RouteStatus> {
        let mut all: Vec<RouteStatus> = lock(&self.shared.routes)
            .iter()
            .map(|route| route.status.refresh(&route.relay))
            .collect();
        all.extend(lock(&self.shared.found).iter().cloned());
        all
    }

    /// Stops every route and waits for its thread; the final status.
    #[must_use]
    pub fn stop(mut self) -> Vec<RouteStatus> {
        self.halt();
        self.status()
    }

    fn halt(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        self.shared.wake.ring();
        // First, so that it makes no more of them.
        if let Some(thread) = self.scout.take()
            && thread.join().is_err()
        {
            tracing::error!("the thread of the patterns panicked");
        }
        let mut routes = lock(&self.shared.routes);
        routes.iter().for_each(Route::tell_to_stop);
        routes.iter_mut().for_each(Route::join);
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.halt();
    }
}
