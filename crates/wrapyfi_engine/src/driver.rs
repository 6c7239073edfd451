//! The driver, which keeps the routes that run in step with the plan, in tests as in production.
//!
//! ```text
//!   plan ─▶ mailbox ─▶ look(now): reconciler ─ Change::Start, Stop, … ─▶ members
//!                                                                          │ step(now)
//!                        Engine::step: each in turn   Running: a pool of threads
//! ```

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::{Duration, Instant};

use wrapyfi_interfaces::store::TypeStore;

use super::bridge_circle::CarryingRoute;
use super::member::Member;
use super::plan::Plan;
use super::plan_diff::PlanDiff;
use super::pool::Pool;
use super::reconciler::{Change, Reconciler};
use super::replacement::{INACTIVE, REMOVED};
use super::route::RouteKey;
use super::route_status::{RouteState, RouteStatus};
use super::tap::Tap;
use wrapyfi_endpoint::{
    Cause, EndpointAddress, Mutex, Registry, UnknownMiddleware, Wake, note_routes,
};
use wrapyfi_retry::contained;

/// Pause between two looks whether all routes are closed.
const LOOK_AGAIN: Duration = Duration::from_millis(5);

/// The routes that run, with the reconciler and the pool.
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
/// let driver = running.applier(); // for another thread
/// driver.set_active(false);
/// assert_eq!(driver.plan().routes.len(), 1);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Driver {
    /// Number of the bridge, in the marks of what it makes.
    number: u64,
    pub(super) pool: Arc<Pool>,
    members: Mutex<Members>,
    reconciler: Mutex<Reconciler>,
    /// Statuses of the patterns.
    found: Mutex<Vec<RouteStatus>>,
    latest: Mutex<Latest>,
    /// Bell that rings for a look.
    pub(super) wake: Wake,
}

/// The plan that holds, or that the next look turns to.
struct Latest {
    plan: Plan,
    registry: Registry,
    /// True until the reconciler has turned to it.
    is_new: bool,
    /// Types for the patterns of a plan that is new.
    types: Option<TypeStore>,
    /// False while none of its routes is to run.
    is_active: bool,
}

#[derive(Default)]
struct Members {
    running: BTreeMap<u64, Arc<Member>>,
    /// Members that were told to stop.
    closing: Vec<Arc<Member>>,
}

impl Driver {
    pub(super) fn new(plan: Plan, registry: &Registry) -> Self {
        let mut reconciler = Reconciler::new(registry);
        let changes =
            reconciler.replace(plan.clone(), registry.clone(), REMOVED, registry.clock().now());
        let driver = Self {
            number: reconciler.number,
            pool: Pool::new(registry.clock().clone()),
            members: Mutex::default(),
            found: Mutex::new(reconciler.status()),
            reconciler: Mutex::new(reconciler),
            latest: Mutex::new(Latest {
                plan,
                registry: registry.clone(),
                is_new: false,
                types: None,
                is_active: true,
            }),
            wake: Wake::new(),
        };
        driver.carry_out(registry, changes);
        driver
    }

    /// Number of the bridge, in the marks of what it makes.
    pub fn number(&self) -> u64 {
        self.number
    }

    pub(super) fn set_types(&self, types: TypeStore) {
        self.reconciler.lock().types = types;
    }

    pub(super) fn set_own(&self, addresses: BTreeSet<EndpointAddress>) {
        self.reconciler.lock().own = addresses;
    }

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
    ) -> Result<PlanDiff, UnknownMiddleware> {
        let unknown = plan.middlewares().find_map(|name| registry.get(name).err());
        if let Some(unknown) = unknown {
            return Err(unknown);
        }
        let diff = {
            let mut latest = self.latest.lock();
            let (diff, is_active) = (latest.plan.diff(&plan), latest.is_active);
            *latest = Latest { plan, registry, is_new: true, types: Some(types), is_active };
            diff
        };
        self.wake.ring();
        Ok(diff)
    }

    /// Starts the routes of the plan, as they are at first, or stops them all: their ends close, and plan and
    /// middlewares stay. It happens soon after.
    pub fn set_active(&self, is_active: bool) {
        let mut latest = self.latest.lock();
        latest.is_new |= latest.is_active != is_active;
        latest.is_active = is_active;
        drop(latest);
        self.wake.ring();
    }

    /// Turns to other middlewares of the same names: routes on one that is another begin anew.
    pub fn turn_to(&self, registry: Registry) {
        let mut latest = self.latest.lock();
        (latest.registry, latest.is_new) = (registry, true);
        drop(latest);
        self.wake.ring();
    }

    /// Waits until no end of a route is open any more, at most for some time; true where that is so.
    #[must_use]
    pub fn wait_closed(&self, most: Duration) -> bool {
        let end = Instant::now() + most;
        while self.latest.lock().is_new || !self.members().is_empty() {
            if Instant::now() >= end {
                return false;
            }
            std::thread::sleep(LOOK_AGAIN);
        }
        true
    }

    /// Turns to a new plan where there is one, and looks at discovery; instant of the next look, if
    /// nothing rings before.
    pub(super) fn look(&self, now: Instant) -> Option<Instant> {
        let mut reconciler = self.reconciler.lock();
        let next = {
            let mut latest = self.latest.lock();
            if let Some(types) = latest.types.take() {
                reconciler.types = types;
            }
            std::mem::take(&mut latest.is_new).then(|| {
                let (plan, removed) = match latest.is_active {
                    true => (latest.plan.clone(), REMOVED),
                    false => (Plan::default(), INACTIVE),
                };
                (plan, removed, latest.registry.clone())
            })
        };
        if let Some((plan, removed, registry)) = next {
            let changes = reconciler.replace(plan, registry, removed, now);
            self.carry_out(&reconciler.registry, changes);
        }
        let next = match contained(|| reconciler.scan(now)) {
            Ok(changes) => {
                self.carry_out(&reconciler.registry, changes);
                reconciler.has_patterns().then(|| now + reconciler.look_again_in(now))
            }
            Err(panic) => Some(now + reconciler.panicked(panic, now)),
        };
        *self.found.lock() = reconciler.status();
        next
    }

    /// Carries out the reconciler's changes without waiting for a step.
    fn carry_out(&self, registry: &Registry, changes: Vec<Change>) {
        for change in changes {
            let mut members = self.members.lock();
            match change {
                Change::Start { id, route, counters } => {
                    let key = route.key();
                    members.closing.retain(|member| !member.is_closed());
                    let same_end = |it: &&Arc<Member>| {
                        it.key.interaction == key.interaction && it.key.to == key.to
                    };
                    let after = members.closing.iter().rev().find(same_end).cloned();
                    let pool = Arc::downgrade(&self.pool);
                    let member = Member::new(id, *route, counters, registry, after, pool);
                    members.running.insert(id, Arc::clone(&member));
                    drop(members);
                    self.pool.ring(member);
                }
                Change::Order { id, order } => {
                    let Some(member) = members.running.get(&id).cloned() else { continue };
                    drop(members);
                    member.order(order);
                }
                Change::Stop { id, ending } => {
                    let Some(member) = members.running.remove(&id) else { continue };
                    members.closing.push(Arc::clone(&member));
                    drop(members);
                    member.stop(ending);
                    // A member that has not been stepped yet has no waker that its own bell could
                    // wake.
                    self.pool.ring(member);
                }
            }
        }
    }

    /// Members that run, those that close before the others.
    pub(super) fn members(&self) -> Vec<Arc<Member>> {
        let mut members = self.members.lock();
        members.closing.retain(|member| !member.is_closed());
        members.closing.iter().chain(members.running.values()).cloned().collect()
    }

    /// Statuses of the routes, then of the patterns and of the names they match that have no route
    /// yet. It waits for no route: one in the middle of a step shows its state before it, and that
    /// it is blocked once the step takes over a second.
    pub fn status(&self) -> Vec<RouteStatus> {
        let latest = self.latest.lock();
        if !latest.is_active {
            let state = || RouteState::Waiting(Cause::Inactive);
            return latest.plan.routes.iter().map(|it| RouteStatus::planned(it, state())).collect();
        }
        drop(latest);
        let running: Vec<_> = self.members.lock().running.values().cloned().collect();
        let found = self.found.lock().clone();
        running.iter().map(|member| member.status()).chain(found).collect()
    }

    /// The latest plan.
    pub fn plan(&self) -> Plan {
        self.latest.lock().plan.clone()
    }

    /// Window on the messages of a route that carries a topic, by its name and its ends as its status has
    /// them.
    #[doc(hidden)]
    pub fn tap(&self, name: &str, from: &str, to: &str) -> Option<Arc<Tap>> {
        self.members.lock().running.values().find_map(|member| member.tap_of([name, from, to]))
    }

    /// Middlewares of the latest plan.
    pub fn registry(&self) -> Registry {
        self.latest.lock().registry.clone()
    }

    /// Routes that carry a topic, but for those of parameters, which are not set again where they are the same.
    pub fn carrying(&self) -> Vec<CarryingRoute> {
        self.members.lock().running.values().filter_map(|member| member.carrying()).collect()
    }

    /// Closes the ends of the routes that would close a circle over other bridges, each with the reason, and opens
    /// those of all others again.
    pub fn keep_closed(&self, circles: &BTreeMap<RouteKey, Cause>) {
        for member in self.members.lock().running.values() {
            member.keep_closed(circles.get(&member.key));
        }
    }

    /// Looks at the rates of the routes, and logs of those whose step takes too long.
    pub(super) fn look_at_members(&self, now: Instant) {
        let members = self.members();
        note_routes(members.len());
        members.iter().for_each(|member| member.look(now));
    }
}
