//! Runs the routes of a plan: step by step for tests, one thread a route in production.
//!
//! A thread a route keeps them apart: a reliable reader that stalls its writer stalls that route
//! and no other.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Instant;

use super::plan::Plan;
use super::relay::{Relay, Step};
use super::route::RouteStatus;
use super::service_relay::ServiceRelay;
use crate::endpoint::{Registry, Wake};

/// The routes of a plan, not running yet.
pub struct Engine {
    relays: Vec<Work>,
}

/// A route at work.
enum Work {
    Topic(Box<Relay>),
    Service(Box<ServiceRelay>),
}

impl Work {
    fn step(&mut self, now: Instant) -> Step {
        match self {
            Self::Topic(relay) => relay.step(now),
            Self::Service(relay) => relay.step(now),
        }
    }

    fn status(&self) -> RouteStatus {
        match self {
            Self::Topic(relay) => relay.status(),
            Self::Service(relay) => relay.status(),
        }
    }

    fn wake(&self) -> &Wake {
        match self {
            Self::Topic(relay) => relay.wake(),
            Self::Service(relay) => relay.wake(),
        }
    }
}

impl Engine {
    /// Prepares the routes; nothing is opened before the first step.
    #[must_use]
    pub fn new(plan: Plan, registry: &Registry) -> Self {
        let Plan { routes, services } = plan;
        let mut seeds = 1..;
        let mut seed = || seeds.next().unwrap_or_default();
        let topics = routes
            .into_iter()
            .map(|spec| Work::Topic(Box::new(Relay::new(spec, registry, seed()))))
            .collect::<Vec<_>>();
        let services = services
            .into_iter()
            .map(|spec| Work::Service(Box::new(ServiceRelay::new(spec, registry, seed()))));
        let relays = topics.into_iter().chain(services).collect();
        Self { relays }
    }

    /// Brings every route one step on; the number of messages taken.
    pub fn step(&mut self, now: Instant) -> usize {
        self.relays.iter_mut().map(|relay| relay.step(now).moved).sum()
    }

    /// The routes now.
    #[must_use]
    pub fn status(&self) -> Vec<RouteStatus> {
        self.relays.iter().map(Work::status).collect()
    }

    /// Gives every route a thread.
    ///
    /// # Errors
    /// When the system refuses a thread; the routes started before it are stopped.
    pub fn start(self) -> std::io::Result<Running> {
        let mut running = Running {
            stop: Arc::new(AtomicBool::new(false)),
            routes: Vec::with_capacity(self.relays.len()),
        };
        for (index, relay) in self.relays.into_iter().enumerate() {
            let wake = relay.wake().clone();
            let relay = Arc::new(Mutex::new(relay));
            let (stop, shared) = (Arc::clone(&running.stop), Arc::clone(&relay));
            let bell = wake.clone();
            let thread = std::thread::Builder::new()
                .name(format!("route-{index}"))
                .spawn(move || run(&shared, &bell, &stop))?;
            running.routes.push(Route {
                status: StatusCache::new(&relay),
                relay,
                wake,
                thread: Some(thread),
            });
        }
        Ok(running)
    }
}

fn run(relay: &Mutex<Work>, wake: &Wake, stop: &AtomicBool) {
    while !stop.load(Ordering::Relaxed) {
        let step = relay.lock().unwrap_or_else(PoisonError::into_inner).step(Instant::now());
        let rest = step.next.saturating_duration_since(Instant::now());
        if !rest.is_zero() {
            wake.wait(rest);
        }
    }
}

/// Routes at work. Dropping it stops them.
pub struct Running {
    stop: Arc<AtomicBool>,
    routes: Vec<Route>,
}

struct Route {
    relay: Arc<Mutex<Work>>,
    status: StatusCache,
    wake: Wake,
    thread: Option<JoinHandle<()>>,
}

/// The last status seen, for when the route is busy inside a blocking send.
struct StatusCache(Mutex<RouteStatus>);

impl StatusCache {
    fn new(relay: &Mutex<Work>) -> Self {
        Self(Mutex::new(relay.lock().unwrap_or_else(PoisonError::into_inner).status()))
    }

    fn refresh(&self, relay: &Mutex<Work>) -> RouteStatus {
        let mut cached = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Ok(relay) = relay.try_lock() {
            *cached = relay.status();
        }
        cached.clone()
    }
}

impl Running {
    /// The routes now; a route in the middle of a step shows as it was just before.
    #[must_use]
    pub fn status(&self) -> Vec<RouteStatus> {
        self.routes.iter().map(|route| route.status.refresh(&route.relay)).collect()
    }

    /// Stops every route and waits for its thread; the final status.
    #[must_use]
    pub fn stop(mut self) -> Vec<RouteStatus> {
        self.halt();
        self.status()
    }

    fn halt(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        for route in &self.routes {
            route.wake.ring();
        }
        for route in &mut self.routes {
            if let Some(thread) = route.thread.take()
                && thread.join().is_err()
            {
                tracing::error!("a route's thread panicked");
            }
        }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.halt();
    }
}
