//! Routes at work, and the thread that makes and ends those of patterns.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Instant;

use super::engine::{Work, log_end};
use super::route::RouteStatus;
use super::scout::{Change, Scout};
use super::threads::{Member, Rest, lock};
use crate::endpoint::{Registry, Wake};

/// Routes at work. Dropping it stops them.
pub struct Running {
    shared: Arc<Shared>,
    /// Makes and ends routes by pattern, where there are patterns.
    scout: Option<JoinHandle<()>>,
    /// Steps the routes that nobody wants.
    rest: Option<JoinHandle<()>>,
}

/// What the thread of the patterns shares with the owner.
struct Shared {
    registry: Registry,
    stop: AtomicBool,
    wake: Wake,
    rest: Arc<Rest>,
    routes: Mutex<Vec<Route>>,
    /// What the patterns say of themselves.
    found: Mutex<Vec<RouteStatus>>,
}

struct Route {
    member: Arc<Member>,
    status: StatusCache,
}

impl Route {
    fn start(id: u64, work: Work, rest: &Arc<Rest>) -> std::io::Result<Self> {
        let status = StatusCache(Mutex::new(work.status()));
        Ok(Self { member: Member::start(id, work, rest)?, status })
    }
}

/// The last status seen, for when the route is busy inside a blocking send.
struct StatusCache(Mutex<RouteStatus>);

impl StatusCache {
    fn refresh(&self, work: &Mutex<Option<Work>>) -> RouteStatus {
        let mut cached = lock(&self.0);
        if let Ok(work) = work.try_lock()
            && let Some(work) = &*work
        {
            *cached = work.status();
        }
        cached.clone()
    }
}

impl Shared {
    /// Does something with a route.
    fn with(&self, id: u64, act: impl FnOnce(&mut Work)) {
        let found = {
            let routes = lock(&self.routes);
            let found = routes.iter().find(|route| route.member.id == id);
            found.map(|route| Arc::clone(&route.member))
        };
        // Outside the lock: it may be in the middle of a send.
        let Some(member) = found else { return };
        let mut work = lock(&member.work);
        if let Some(work) = work.as_mut() {
            act(work);
        }
    }

    fn change(&self, scout: &mut Scout, change: Change) {
        match change {
            Change::Make { id, made, counters } => {
                let work = Work::made(id, made, counters, &self.registry);
                match Route::start(id, work, &self.rest) {
                    Ok(route) => lock(&self.routes).push(route),
                    Err(error) => scout.failed(id, &format!("the system gives no thread: {error}")),
                }
            }
            Change::KeepOpen { id } => {
                self.with(id, Work::keep_open);
            }
            Change::Misfits { id, named } => self.with(id, |work| work.name_misfits(named)),
            Change::End { id, why, is_one_of_many } => {
                let found = {
                    let mut routes = lock(&self.routes);
                    let place = routes.iter().position(|route| route.member.id == id);
                    place.map(|place| routes.remove(place))
                };
                // Outside the lock: it may be in the middle of a send.
                if let Some(Route { member, .. }) = found {
                    member.tell_to_stop();
                    member.join();
                    let ended = lock(&member.work).take();
                    if let Some(work) = ended {
                        log_end(&work.status(), &why, is_one_of_many);
                    }
                }
            }
        }
    }

    fn scout(&self, mut scout: Scout) {
        while !self.stop.load(Ordering::Relaxed) {
            let now = Instant::now();
            for change in scout.scan(now) {
                self.change(&mut scout, change);
            }
            *lock(&self.found) = scout.status();
            self.wake.wait(scout.look_again_in(now));
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
            rest: Arc::default(),
            routes: Mutex::default(),
            found: Mutex::new(scout.as_ref().map(Scout::status).unwrap_or_default()),
        });
        let mut running = Self { shared, scout: None, rest: None };
        let rest = Arc::clone(&running.shared.rest);
        let thread = std::thread::Builder::new().name("routes-at-rest".to_owned());
        running.rest = Some(thread.spawn(move || rest.run())?);
        for (id, relay) in relays {
            let route = Route::start(id, relay, &running.shared.rest)?;
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
            .map(|route| route.status.refresh(&route.member.work))
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
        // Next, so that it gives none a thread.
        self.shared.rest.tell_to_stop();
        if let Some(thread) = self.rest.take()
            && thread.join().is_err()
        {
            tracing::error!("the thread of the routes at rest panicked");
        }
        let routes = lock(&self.shared.routes);
        routes.iter().for_each(|route| route.member.tell_to_stop());
        routes.iter().for_each(|route| route.member.join());
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.halt();
    }
}
