//! The routes that run, and what keeps them in step with the plan: the same for tests and in production.
//!
//! ```text
//!   plan ─▶ mailbox ─▶ look(now): reconciler ─ Change::Start, Stop, … ─▶ members
//!                                                                          │ step(now)
//!                        Engine::step: each in turn   Running: a pool of threads
//! ```

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use std::time::Instant;

use wrapyfi_interfaces::store::TypeStore;

use super::member::{Member, lock};
use super::plan::Plan;
use super::plan_diff::{ApplyError, PlanDiff};
use super::pool::Pool;
use super::reconciler::{Change, Reconciler};
use super::route::RouteStatus;
use super::work::contained;
use crate::endpoint::{Registry, Wake};

/// Routes that run.
pub(super) struct Driver {
    registry: Registry,
    pub(super) pool: Arc<Pool>,
    members: Mutex<Members>,
    reconciler: Mutex<Reconciler>,
    /// What the patterns say of themselves.
    found: Mutex<Vec<RouteStatus>>,
    /// The plan that holds, and the one that the next look turns to.
    plan: Mutex<(Plan, Option<(Plan, TypeStore)>)>,
    /// Rings for a look.
    pub(super) wake: Wake,
}

#[derive(Default)]
struct Members {
    running: BTreeMap<u64, Arc<Member>>,
    /// Those that were told to stop.
    closing: Vec<Arc<Member>>,
}

impl Driver {
    pub(super) fn new(plan: Plan, registry: &Registry) -> Self {
        let mut reconciler = Reconciler::new(registry);
        let changes = reconciler.replace(plan.clone(), Instant::now());
        let driver = Self {
            registry: registry.clone(),
            pool: Pool::new(),
            members: Mutex::default(),
            found: Mutex::new(reconciler.status()),
            reconciler: Mutex::new(reconciler),
            plan: Mutex::new((plan, None)),
            wake: Wake::new(),
        };
        driver.carry_out(changes);
        driver
    }

    pub(super) fn set_types(&self, types: TypeStore) {
        lock(&self.reconciler).types = types;
    }

    /// Takes a plan for the next look.
    pub(super) fn apply(&self, plan: Plan, types: TypeStore) -> Result<PlanDiff, ApplyError> {
        let unknown = plan.middlewares().find_map(|name| self.registry.get(name).err());
        if let Some(unknown) = unknown {
            return Err(ApplyError::Unknown(unknown));
        }
        let diff = {
            let mut plans = lock(&self.plan);
            let diff = plans.0.diff(&plan);
            *plans = (plan.clone(), Some((plan, types)));
            diff
        };
        self.wake.ring();
        Ok(diff)
    }

    /// Turns to a new plan where there is one, and looks at what exists; when to look again, if nothing rings
    /// before.
    pub(super) fn look(&self, now: Instant) -> Option<Instant> {
        let mut reconciler = lock(&self.reconciler);
        let next = lock(&self.plan).1.take();
        if let Some((plan, types)) = next {
            reconciler.types = types;
            self.carry_out(reconciler.replace(plan, now));
        }
        let next = match contained(|| reconciler.scan(now)) {
            Ok(changes) => {
                self.carry_out(changes);
                reconciler.has_patterns().then(|| now + reconciler.look_again_in(now))
            }
            Err(panic) => Some(now + reconciler.panicked(panic, now)),
        };
        *lock(&self.found) = reconciler.status();
        next
    }

    /// Never waits for a step.
    fn carry_out(&self, changes: Vec<Change>) {
        for change in changes {
            let mut members = lock(&self.members);
            let running = |id| members.running.get(&id).cloned();
            match change {
                Change::Start { id, route, counters } => {
                    let key = route.key();
                    members.closing.retain(|member| !member.is_closed());
                    let same_end =
                        |it: &&Arc<Member>| it.key.role == key.role && it.key.to == key.to;
                    let after = members.closing.iter().rev().find(same_end).cloned();
                    let pool = Arc::downgrade(&self.pool);
                    let member = Member::new(id, route, counters, &self.registry, after, pool);
                    members.running.insert(id, Arc::clone(&member));
                    drop(members);
                    self.pool.ring(member);
                }
                Change::KeepOpen { id } => {
                    let member = running(id);
                    drop(members);
                    member.iter().for_each(|member| member.keep_open());
                }
                Change::Misfits { id, named } => {
                    let member = running(id);
                    drop(members);
                    member.iter().for_each(|member| member.name_misfits(named.clone()));
                }
                Change::Stop { id, ending } => {
                    let Some(member) = members.running.remove(&id) else { continue };
                    members.closing.push(Arc::clone(&member));
                    drop(members);
                    member.stop(ending);
                    // One that has not been stepped yet has no bell.
                    self.pool.ring(member);
                }
            }
        }
    }

    /// All that run, those that close before the others.
    pub(super) fn members(&self) -> Vec<Arc<Member>> {
        let mut members = lock(&self.members);
        members.closing.retain(|member| !member.is_closed());
        members.closing.iter().chain(members.running.values()).cloned().collect()
    }

    /// The routes now, then the patterns, and what they mean that is no route yet.
    pub(super) fn status(&self) -> Vec<RouteStatus> {
        let running: Vec<_> = lock(&self.members).running.values().cloned().collect();
        let found = lock(&self.found).clone();
        running.iter().map(|member| member.status()).chain(found).collect()
    }

    /// Logs of routes whose step takes too long.
    pub(super) fn tell_blocked(&self) {
        self.members().iter().for_each(|member| member.tell_blocked());
    }
}
