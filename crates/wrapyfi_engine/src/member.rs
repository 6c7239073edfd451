//! A route among those that run: one step at a time on any thread, and the status that others see
//! meanwhile.
//!
//! ```text
//!   orders ──▶ step(now)  Work::step, whose panics end here: counted, both ends closed, back-off
//!                 └─ publish: state and quality of service, where they changed ──▶ status()
//! ```

use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, Ordering};
use std::sync::{Arc, Weak};
use std::task::Waker;
use std::time::{Duration, Instant};

use super::action_relay::ActionRelay;
use super::bridge_circle::CarryingRoute;
use super::candidate::Misfit;
use super::pool::{Place, Pool};
use super::rate::RateMeter;
use super::relay::Relay;
use super::route::{Route, RouteKey, RouteTypes};
use super::route_index::has_parameters;
use super::route_status::{RouteState, RouteStatus};
use super::service_relay::ServiceRelay;
use super::tap::Tap;
use super::work::{Ending, Order, Progress, Work, not_begun};
use wrapyfi_endpoint::backoff::Backoff;
use wrapyfi_endpoint::{
    Cause, Context, Counters, Interaction, Mutex, Qos, Registry, Throttle, Wake,
};
use wrapyfi_retry::contained;

/// Length of a step from which on it shows as blocked.
const BLOCKED_AFTER: Duration = Duration::from_secs(1);
/// Time between two looks of a route at whether the one before it at its destination has closed.
const CLOSING_LOOK_EVERY: Duration = Duration::from_millis(10);
/// Time without a panic after which the back-off begins anew.
const CALM_AFTER: Duration = Duration::from_secs(30);

/// A route that runs.
pub(super) struct Member {
    pub(super) id: u64,
    pub(super) key: RouteKey,
    /// Name, ends and type; the rest of the status is filled in when it is asked for.
    identity: RouteStatus,
    is_one_of_many: bool,
    /// True where it stays closed if it would close a circle over other bridges; `None` where it can close none.
    guarded: Option<bool>,
    /// Circle for which the route was told last to stay closed.
    circle: Mutex<Option<Cause>>,
    context: Context,
    /// Window on its messages; services have none.
    tap: Option<Arc<Tap>>,
    slot: Mutex<Slot>,
    orders: Mutex<Orders>,
    is_ordered: AtomicBool,
    published: Mutex<Arc<Published>>,
    /// Reference of `step_began_ms`: a step that blocks does so by the system's time.
    epoch: Instant,
    /// Time at which the step in progress began, in milliseconds after `epoch` plus one; 0 between
    /// steps.
    step_began_ms: AtomicU64,
    panics: AtomicU64,
    is_open: AtomicBool,
    has_source: AtomicBool,
    is_closed: AtomicBool,
    is_told_blocked: AtomicBool,
    /// Place of the member in the pool, and the earliest timer that it has there.
    pub(super) place: AtomicU8,
    pub(super) timer: Mutex<Option<Instant>>,
    /// Rate of the messages, which no step waits for.
    rate: Mutex<RateMeter>,
    pool: Weak<Pool>,
}

/// The route at work and its back-off; locked for as long as a step takes.
struct Slot {
    /// The route at work; `None` once it has closed.
    work: Option<Box<dyn Work>>,
    last_published: Arc<Published>,
    /// Previous route at the same destination, until that has closed.
    after: Option<Arc<Member>>,
    reopen_at: Option<Instant>,
    panicked_at: Option<Instant>,
    backoff: Backoff,
    /// Throttle for log lines of a state that stays the same while its reason changes.
    reasons: Throttle,
}

/// Number of such lines that pass before the throttle begins: a start changes its reason several times within a moment, and
/// a log that kept back the last one would tell for seconds of what is over. One behind another route waits for that one,
/// then for a server, then for a program. The first is no change, and the throttle passes one more.
const FIRST_REASONS: u32 = 2;

/// Orders that wait for the next step; a later one takes the place of one of its kind.
#[derive(Default)]
struct Orders {
    keep_open: bool,
    misfits: Option<Option<Misfit>>,
    circle: Option<Option<Cause>>,
    stop: Option<Ending>,
}

/// State and quality of service that a route shows in status tables.
#[derive(Debug, PartialEq)]
struct Published {
    state: RouteState,
    qos: [Option<Qos>; 2],
}

impl std::task::Wake for Member {
    fn wake(self: Arc<Self>) {
        if let Some(pool) = self.pool.upgrade() {
            pool.ring(self);
        }
    }
}

impl Member {
    /// A route that has opened nothing yet; it begins once `after` has closed.
    pub(super) fn new(
        id: u64,
        route: Route,
        counters: Arc<Counters>,
        registry: &Registry,
        after: Option<Arc<Self>>,
        pool: Weak<Pool>,
    ) -> Arc<Self> {
        let (key, is_one_of_many) = (route.key(), route.mark.is_some());
        let identity = RouteStatus::planned(&route, not_begun());
        let context = Context { clock: registry.clock().clone(), counters, ..Context::default() };
        let front = context.clone();
        let may_circle = route.interaction() == Interaction::Topic && !has_parameters(&route);
        let guarded = may_circle.then_some(route.policy.loop_guard);
        let (work, tap): (Box<dyn Work>, _) = match route.types {
            RouteTypes::Topic(_) => {
                let relay = Relay::new(route, registry, id, front);
                let tap = Some(Arc::clone(&relay.tap));
                (Box::new(relay), tap)
            }
            RouteTypes::Service(_) => {
                (Box::new(ServiceRelay::new(route, registry, id, front)), None)
            }
            RouteTypes::Action(_) => (Box::new(ActionRelay::new(route, registry, id, front)), None),
        };
        let published = Arc::new(Published { state: identity.state.clone(), qos: [None, None] });
        Arc::new(Self {
            id,
            key,
            identity,
            is_one_of_many,
            guarded,
            circle: Mutex::default(),
            context,
            tap,
            slot: Mutex::new(Slot {
                work: Some(work),
                last_published: Arc::clone(&published),
                after,
                reopen_at: None,
                panicked_at: None,
                backoff: Backoff::new(id),
                reasons: Throttle::after(FIRST_REASONS),
            }),
            orders: Mutex::default(),
            is_ordered: AtomicBool::new(false),
            published: Mutex::new(published),
            epoch: Instant::now(),
            step_began_ms: AtomicU64::new(0),
            panics: AtomicU64::new(0),
            is_open: AtomicBool::new(false),
            has_source: AtomicBool::new(false),
            is_closed: AtomicBool::new(false),
            is_told_blocked: AtomicBool::new(false),
            place: AtomicU8::new(Place::IDLE),
            timer: Mutex::default(),
            rate: Mutex::default(),
            pool,
        })
    }

    /// Window on the messages, where the member is the route with this name and these ends.
    pub(super) fn tap_of(&self, [name, from, to]: [&str; 3]) -> Option<Arc<Tap>> {
        let RouteStatus { name: own, from: source, to: target, .. } = &self.identity;
        ([own, source, target] == [name, from, to]).then(|| self.tap.clone()).flatten()
    }

    /// Has the next step carry out `order`.
    pub(super) fn order(&self, order: Order) {
        self.enter(|orders| match order {
            Order::KeepOpen => orders.keep_open = true,
            Order::NameMisfits(named) => orders.misfits = Some(named),
            Order::StayClosed(circle) => orders.circle = Some(circle),
        });
    }

    /// The route for other bridges, where it can be part of a circle.
    pub(super) fn carrying(&self) -> Option<CarryingRoute> {
        let (key, by_pattern) = (self.key.clone(), self.is_one_of_many);
        Some(CarryingRoute { key, by_pattern, guarded: self.guarded? })
    }

    /// Has the next step close the ends because of a circle, or open them again.
    pub(super) fn keep_closed(&self, circle: Option<&Cause>) {
        let mut known = self.circle.lock();
        if known.as_ref() != circle {
            known.clone_from(&circle.cloned());
            drop(known);
            self.order(Order::StayClosed(circle.cloned()));
        }
    }

    /// Closes the route at the next step, which may have to wait for a blocking one.
    pub(super) fn stop(&self, end: Ending) {
        self.enter(|orders| orders.stop = Some(end));
    }

    fn enter(&self, enter: impl FnOnce(&mut Orders)) {
        enter(&mut self.orders.lock());
        self.is_ordered.store(true, Ordering::Release);
        self.context.wake.ring();
    }

    /// Bell of the route's ends.
    pub(super) fn wake(&self) -> &Wake {
        &self.context.wake
    }

    pub(super) fn is_closed(&self) -> bool {
        self.is_closed.load(Ordering::Acquire)
    }

    /// True while the route opens or closes its ends, for which routes that carry messages need not
    /// wait.
    pub(super) fn begins_or_ends(&self) -> bool {
        !self.is_open.load(Ordering::Relaxed) || self.is_ordered.load(Ordering::Relaxed)
    }

    /// Makes a step on a thread of the pool; the bell rings the pool when the next one is due.
    pub(super) fn turn(self: &Arc<Self>) -> Option<Progress> {
        // Asked for before the step, so that no ring is lost.
        self.context.wake.notify(&Waker::from(Arc::clone(self)));
        self.step(self.context.clock.now())
    }

    /// Brings the route one step on; `None` once it has closed.
    pub(super) fn step(&self, now: Instant) -> Option<Progress> {
        let mut slot = self.slot.lock();
        let slot = &mut *slot;
        if self.is_ordered.swap(false, Ordering::AcqRel) {
            let Orders { keep_open, misfits, circle, stop } =
                std::mem::take(&mut *self.orders.lock());
            if let Some(end) = stop {
                self.close_now(slot, Some(&end));
            } else if let Some(work) = &mut slot.work {
                let keep_open = keep_open.then_some(Order::KeepOpen);
                let misfits = misfits.map(Order::NameMisfits);
                let orders = [keep_open, misfits, circle.map(Order::StayClosed)];
                orders.into_iter().flatten().for_each(|order| work.obey(order));
            }
        }
        let work = slot.work.as_mut()?;
        if let Some(before) = slot.after.take_if(|before| !before.is_closed()) {
            let leaving = Cause::Leaving(self.key.to.to_string());
            slot.after = Some(before);
            self.publish(slot, RouteState::Waiting(leaving), [None, None], now);
            return Some(Progress { moved: 0, next: now + CLOSING_LOOK_EVERY });
        }
        slot.after = None;
        if let Some(next) = slot.reopen_at.filter(|at| now < *at) {
            return Some(Progress { moved: 0, next });
        }
        slot.reopen_at = None;
        let began = self.epoch.elapsed().as_millis().try_into().unwrap_or(u64::MAX - 1);
        self.step_began_ms.store(began + 1, Ordering::Relaxed);
        let stepped = contained(|| work.step(now));
        let step = match stepped {
            Ok(step) => {
                self.is_open.store(work.is_open(), Ordering::Relaxed);
                let (state, qos, has_source) = work.state();
                self.has_source.store(has_source, Ordering::Relaxed);
                if slot.last_published.state != *state || slot.last_published.qos != qos {
                    let state = state.clone();
                    self.publish(slot, state, qos, now);
                }
                step
            }
            Err(panic) => self.contain(slot, &panic, now),
        };
        if let Some(unlogged_before) = slot.reasons.rest(now) {
            slot.last_published.state.log(
                &self.identity.name,
                self.is_one_of_many,
                unlogged_before,
            );
        }
        self.step_began_ms.store(0, Ordering::Relaxed);
        if self.is_told_blocked.swap(false, Ordering::Relaxed) {
            tracing::info!(route = self.identity.name, "goes on, its step has ended");
        }
        Some(step)
    }

    /// Closes the ends of a route whose turn panicked outside of the route's own step.
    pub(super) fn turn_panicked(&self, panic: &str, now: Instant) -> Progress {
        self.step_began_ms.store(0, Ordering::Relaxed);
        self.contain(&mut self.slot.lock(), panic, now)
    }

    /// Closes the ends of a route that panicked; they are opened again after a while.
    fn contain(&self, slot: &mut Slot, panic: &str, now: Instant) -> Progress {
        self.panics.fetch_add(1, Ordering::Relaxed);
        if slot.panicked_at.is_none_or(|at| now.saturating_duration_since(at) >= CALM_AFTER) {
            slot.backoff.reset();
        }
        slot.panicked_at = Some(now);
        let next = now + slot.backoff.wait();
        slot.reopen_at = Some(next);
        if let Some(work) = &mut slot.work
            && let Err(again) = contained(|| work.close())
        {
            tracing::error!(route = self.identity.name, "panicked while it closed: {again}");
        }
        self.is_open.store(false, Ordering::Relaxed);
        self.has_source.store(false, Ordering::Relaxed);
        let what = "a step panicked, both ends are opened again".to_owned();
        let cause = Cause::Panic { what, panic: panic.to_owned() };
        self.publish(slot, RouteState::Error(cause), [None, None], now);
        Progress { moved: 0, next }
    }

    /// Publishes the state of the route. A change of its word is logged; changes of the reason
    /// alone are many, and go through the throttle.
    fn publish(&self, slot: &mut Slot, state: RouteState, qos: [Option<Qos>; 2], now: Instant) {
        if slot.last_published.state != state {
            let is_first = slot.last_published.state == self.identity.state;
            let passes = if is_first || slot.last_published.state.word() != state.word() {
                Some(slot.reasons.finish().unwrap_or(0))
            } else {
                slot.reasons.pass(now)
            };
            if let Some(unlogged_before) = passes {
                state.log(&self.identity.name, self.is_one_of_many, unlogged_before);
            }
        }
        slot.last_published = Arc::new(Published { state, qos });
        *self.published.lock() = Arc::clone(&slot.last_published);
    }

    /// Closes the route for good, and logs its numbers of messages where it `end`s before the
    /// others.
    fn close_now(&self, slot: &mut Slot, end: Option<&Ending>) {
        let Some(mut work) = slot.work.take() else { return };
        if let Err(panic) = contained(|| work.close()) {
            tracing::error!(route = self.identity.name, "panicked while it closed: {panic}");
        }
        self.is_closed.store(true, Ordering::Release);
        // Rings for the route that waits for this one's close.
        self.context.wake.ring();
        let Some(Ending { why, is_one_of_many }) = end else { return };
        let counters = self.context.counters.snapshot();
        let (received, sent, dropped) = (counters.received, counters.sent, counters.dropped());
        let text = format!("route ended: {why}; {received} in, {sent} out, {dropped} dropped");
        match is_one_of_many {
            true => tracing::debug!(route = self.identity.name, "{text}"),
            false => tracing::info!(route = self.identity.name, "{text}"),
        }
    }

    /// Closes the route at the end of the program; false where it is in the middle of a blocking step.
    pub(super) fn close(&self) -> bool {
        let Some(mut slot) = self.slot.try_lock() else { return false };
        self.close_now(&mut slot, None);
        true
    }

    /// Duration of the step in progress; `None` below [`BLOCKED_AFTER`].
    fn blocked_for(&self) -> Option<Duration> {
        let began_ms = self.step_began_ms.load(Ordering::Relaxed).checked_sub(1)?;
        let time = self.epoch.elapsed().saturating_sub(Duration::from_millis(began_ms));
        (time >= BLOCKED_AFTER).then_some(time)
    }

    /// Looks once a second how many messages went through, and logs once that the step in progress takes
    /// too long.
    pub(super) fn look(&self, now: Instant) {
        self.rate.lock().look(&self.context.counters, now);
        self.tell_blocked();
    }

    /// Logs once that the step in progress takes too long.
    fn tell_blocked(&self) {
        if let Some(time) = self.blocked_for()
            && !self.is_told_blocked.swap(true, Ordering::Relaxed)
        {
            let state = self.blocked_state(time);
            tracing::warn!(route = self.identity.name, "{state}");
        }
    }

    fn blocked_state(&self, time: Duration) -> RouteState {
        let (from, to) = (self.identity.from.clone(), self.identity.to.clone());
        RouteState::Degraded(Cause::Blocked { from, to, seconds: time.as_secs() })
    }

    /// Status of the route; does not wait for a step in progress.
    pub(super) fn status(&self) -> RouteStatus {
        let published = Arc::clone(&self.published.lock());
        let state = match self.blocked_for() {
            Some(time) => self.blocked_state(time),
            None => published.state.clone(),
        };
        let [from_qos, to_qos] = published.qos;
        let (messages_per_s, bytes_per_s) = self.rate.lock().rate();
        RouteStatus {
            state,
            has_source: self.has_source.load(Ordering::Relaxed),
            from_qos,
            to_qos,
            counters: self.context.counters.snapshot(),
            messages_per_s,
            bytes_per_s,
            panics: self.panics.load(Ordering::Relaxed),
            ..self.identity.clone()
        }
    }
}
