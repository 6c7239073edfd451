//! Threads that step routes: few for all, and more only while all are stuck.
//!
//! ```text
//!   bell ─▶ ring ─┐               ┌─▶ worker: one step, then back with the time of the next
//!   timer ────────┼─▶ ready ──────┤        at most as many as cores …
//!   start, stop ──┴─▶ behind ─────┘        … and one more each time that none takes what waits
//! ```
//!
//! A step may block: a reliable reader that stalls its writer stalls that route, and one worker. Routes that
//! open or close come behind those that carry messages, and never have all workers.
//!
//! A worker that has stepped one route several times in a row, and has nothing to do, reads that route's connection itself
//! where the middleware lends it: the next message wakes one thread instead of two, and stays in one core's caches.
//!
//! ```text
//!   connection ─▶ I/O thread ─▶ bell ─▶ worker        any other route
//!   connection ─▶ worker: read, bell, step            the route that it stepped last, several times
//! ```

use std::cell::Cell;
use std::collections::{BTreeMap, VecDeque};
use std::sync::atomic::Ordering;
use std::sync::{Arc, Condvar, PoisonError};
use std::time::{Duration, Instant};

use super::member::Member;
use super::work::Progress;
use wrapyfi_endpoint::{Clock, Mutex, Wake};
use wrapyfi_retry::contained;
use wrapyfi_retry::thread::restarted;

/// Largest number of workers while none is stuck, however many cores there are.
const MOST_WORKERS: usize = 8;
/// Largest number of workers: when so many routes are stuck, the others wait for them.
const MOST_STUCK: usize = 256;
/// Time without a taken step after which all workers count as stuck.
const STUCK_AFTER: Duration = Duration::from_millis(5);
/// Time between two looks at all members, and idle time after which a surplus worker ends.
const LOOK_EVERY: Duration = Duration::from_secs(1);
/// Distance of a step in time from which on it may be late by up to [`TOGETHER`]: what many routes look at once in a while
/// wakes few threads few times.
const FAR: Duration = Duration::from_millis(400);
/// Time between two moments at which distant steps are due, all together.
const TOGETHER: Duration = Duration::from_millis(20);
/// One of this many turns goes first to a route that opens or closes, however busy the others are.
const BEHIND_EVERY: u64 = 8;
/// Number of turns of one route in a row after which an idle worker reads its connection.
const SAME_TURNS: u32 = 3;

thread_local! {
    /// Address of the pool and number in it of the worker that this thread is, while it waits. A route that is rung by what
    /// the worker reads is stepped by that worker: no other is woken for it.
    static WAITING_WORKER: Cell<Option<(usize, u64)>> = const { Cell::new(None) };
}

/// Values of [`Member::place`].
pub(super) struct Place;

impl Place {
    pub(super) const IDLE: u8 = 0;
    const QUEUED: u8 = 1;
    const RUNNING: u8 = 2;
    /// In a step, and the bell has rung since it began.
    const RUNG: u8 = 3;
    const CLOSED: u8 = 4;
}

/// Workers, and the members that wait for them.
pub(super) struct Pool {
    state: Mutex<PoolState>,
    /// Signal to the timekeeper that a step is due earlier, or that no worker is free.
    tick: Condvar,
    /// Signal that a thread has ended, or that all threads are to end.
    ended: Condvar,
    /// Number of workers while none is stuck.
    base: usize,
    /// Reference of [`Pool::together`].
    epoch: Instant,
    pub(super) clock: Clock,
}

#[derive(Default)]
struct PoolState {
    ready: VecDeque<Arc<Member>>,
    /// Members that open or close.
    behind: VecDeque<Arc<Member>>,
    timers: BTreeMap<(Instant, u64), Arc<Member>>,
    workers: usize,
    /// Number of threads that have not ended: workers, timekeeper and others that were spawned.
    threads: usize,
    /// Workers without a member. The last to come is the first to go: its core and its caches still know the work, and a route
    /// with one message at a time stays on one worker instead of wandering through all of them.
    idle: Vec<Idle>,
    /// Number of workers that were ever started.
    started: u64,
    /// Number of workers that were taken from `idle` because a member waits, and have not looked yet.
    woken: usize,
    /// Number of workers at members that open or close.
    at_behind: usize,
    /// Number of turns taken, of all members and of those that open or close.
    turns: u64,
    turns_behind: u64,
    /// True once the timekeeper has been told that no worker is free.
    is_watched: bool,
    grown_at: Option<Instant>,
    stop: bool,
}

/// A worker without a member.
struct Idle {
    /// Number of the worker.
    worker: u64,
    /// Bell at which it waits.
    bell: Wake,
    /// True where it may be reading a connection, so that another comes sooner.
    reads: bool,
}

impl PoolState {
    /// Largest number of workers for members that open or close.
    fn most_at_behind(&self) -> usize {
        self.workers.saturating_sub(1).max(1)
    }

    fn may_take_behind(&self) -> bool {
        !self.behind.is_empty() && self.at_behind < self.most_at_behind()
    }

    /// Takes the next member; true beside it where it opens or closes.
    fn next(&mut self) -> Option<(Arc<Member>, bool)> {
        let first = self.turns.is_multiple_of(BEHIND_EVERY);
        let behind = self.may_take_behind() && (first || self.ready.is_empty());
        let taken = if behind { self.behind.pop_front() } else { self.ready.pop_front() };
        let member = taken?;
        self.turns += 1;
        if behind {
            self.turns_behind += 1;
            self.at_behind += 1;
        }
        Some((member, behind))
    }

    /// True when a member waits and no worker is free to take it.
    fn waits_in_vain(&self) -> bool {
        let nobody_is_free = self.idle.is_empty() && self.woken == 0;
        (!self.ready.is_empty() && nobody_is_free)
            || (!self.behind.is_empty() && (nobody_is_free || !self.may_take_behind()))
    }

    /// True when a member waits that one more worker may take.
    fn has_more(&self) -> bool {
        !self.ready.is_empty() || self.may_take_behind()
    }

    /// Takes the worker that became idle last, if possible one that reads no connection; its bell is to be rung.
    fn take_idle(&mut self) -> Option<Wake> {
        let last = self.idle.len().checked_sub(1)?;
        let place = self.idle.iter().rposition(|idle| !idle.reads).unwrap_or(last);
        self.woken += 1;
        Some(self.idle.remove(place).bell)
    }

    /// Takes the worker of this number, whose bell is to be rung; `None` where it is woken already.
    fn take_idle_worker(&mut self, worker: u64) -> Option<Wake> {
        let place = self.idle.iter().position(|idle| idle.worker == worker)?;
        self.woken += 1;
        Some(self.idle.remove(place).bell)
    }
}

/// Route that a worker stepped last, and how many times in a row.
#[derive(Default)]
struct Recent {
    id: u64,
    turns: u32,
    wake: Wake,
}

impl Recent {
    fn note(&mut self, member: &Member) {
        if self.turns == 0 || self.id != member.id {
            *self = Self { id: member.id, turns: 0, wake: member.wake().clone() };
        }
        self.turns = self.turns.saturating_add(1);
    }

    /// Bell whose connections the worker is to read.
    fn to_read(&self) -> Option<&Wake> {
        (self.turns >= SAME_TURNS).then_some(&self.wake)
    }
}

/// Moves a member from one place to another: true for the one caller that does, false where it is not there.
fn try_move(member: &Member, from: u8, to: u8) -> bool {
    member.place.compare_exchange(from, to, Ordering::AcqRel, Ordering::Acquire).is_ok()
}

impl Pool {
    pub(super) fn new(clock: Clock) -> Arc<Self> {
        let cores = std::thread::available_parallelism().map_or(2, usize::from);
        Arc::new(Self {
            state: Mutex::default(),
            tick: Condvar::new(),
            ended: Condvar::new(),
            base: cores.clamp(2, MOST_WORKERS),
            epoch: clock.now(),
            clock,
        })
    }

    /// Starts the timekeeper, which starts workers; `look` is called once a second.
    ///
    /// # Errors
    /// When the system refuses a thread.
    pub(super) fn start(
        self: &Arc<Self>,
        look: impl Fn(Instant) + Send + 'static,
    ) -> std::io::Result<()> {
        self.grow(&mut self.state.lock())?;
        let pool = Arc::clone(self);
        self.spawn("route-timer", move || pool.keep_time(&look))
    }

    /// Starts a thread that ends once the pool is stopped. After a panic of `act` it begins again,
    /// with a pause.
    ///
    /// # Errors
    /// When the system refuses a thread; the pool stops then.
    pub(super) fn spawn(
        self: &Arc<Self>,
        name: &'static str,
        act: impl FnMut() + Send + 'static,
    ) -> std::io::Result<()> {
        let pool = Arc::clone(self);
        self.state.lock().threads += 1;
        let thread = std::thread::Builder::new().name(name.to_owned());
        let started = thread.spawn(move || {
            restarted(&format!("thread {name}"), |time| pool.goes_on_after(time), act);
            pool.has_ended(&mut pool.state.lock());
        });
        started.map(drop).inspect_err(|_| {
            self.state.lock().threads -= 1;
            self.stop();
        })
    }

    /// Waits before a thread that panicked begins again; false once the pool is stopped.
    fn goes_on_after(&self, pause: Duration) -> bool {
        let goes_on = |state: &mut PoolState| !state.stop;
        let waited = self.ended.wait_timeout_while(self.state.lock(), pause, goes_on);
        !waited.unwrap_or_else(PoisonError::into_inner).0.stop
    }

    fn has_ended(&self, state: &mut PoolState) {
        state.threads -= 1;
        self.ended.notify_all();
    }

    /// Queues a member that is new, or whose bell rang.
    pub(super) fn ring(self: &Arc<Self>, member: Arc<Member>) {
        let place = &member.place;
        let rung = place.fetch_update(Ordering::AcqRel, Ordering::Acquire, |place| match place {
            Place::IDLE => Some(Place::QUEUED),
            Place::RUNNING => Some(Place::RUNG),
            _ => None,
        });
        if rung == Ok(Place::IDLE) {
            let mut state = self.state.lock();
            self.enqueue(&mut state, member);
            self.watch(&mut state);
            let bell = match WAITING_WORKER.get() {
                Some((pool, own)) if pool == self.address() => state.take_idle_worker(own),
                _ => state.take_idle(),
            };
            // Rung without the lock, which is the first thing that the worker takes.
            drop(state);
            if let Some(bell) = bell {
                bell.ring();
            }
        }
    }

    /// Queues a member. Its caller wakes a worker, or is one that looks next.
    fn enqueue(&self, state: &mut PoolState, member: Arc<Member>) {
        if state.stop {
            return;
        }
        let is_behind = member.begins_or_ends();
        if is_behind {
            state.behind.push_back(member);
        } else {
            state.ready.push_back(member);
        }
    }

    /// Has the timekeeper look where a member waits and no worker is free.
    fn watch(&self, state: &mut PoolState) {
        if !state.is_watched && state.waits_in_vain() {
            state.is_watched = true;
            self.tick.notify_one();
        }
    }

    /// Starts one more worker.
    fn grow(self: &Arc<Self>, state: &mut PoolState) -> std::io::Result<()> {
        let pool = Arc::clone(self);
        let number = state.started;
        let thread = std::thread::Builder::new().name("route-worker".to_owned());
        thread.spawn(move || {
            let pause = |time| {
                pool.goes_on_after(time);
                // A worker that is to end does so in `work`, which counts it off.
                true
            };
            restarted("thread route-worker", pause, || pool.work(number));
        })?;
        state.started += 1;
        state.workers += 1;
        state.threads += 1;
        if state.workers > self.base {
            state.grown_at = Some(Instant::now());
        }
        Ok(())
    }

    fn address(&self) -> usize {
        std::ptr::from_ref(self).addr()
    }

    fn work(&self, number: u64) {
        let bell = Wake::new();
        let mut recent = Recent::default();
        let mut state = self.state.lock();
        while !state.stop {
            let next = state.next();
            // Not when a member is put back: the worker that does so takes the next, which may be the same.
            self.watch(&mut state);
            let Some((member, is_behind)) = next else {
                let is_needed = state.grown_at.is_some_and(|at| at.elapsed() < LOOK_EVERY);
                let is_alone = state.idle.is_empty() && state.woken == 0;
                if state.workers > self.base && !is_alone && !is_needed {
                    break;
                }
                let read = recent.to_read();
                state.idle.push(Idle { worker: number, bell: bell.clone(), reads: read.is_some() });
                drop(state);
                WAITING_WORKER.set(Some((self.address(), number)));
                let waited = contained(|| bell.wait_reading(read, Duration::MAX));
                WAITING_WORKER.set(None);
                if let Err(panic) = waited {
                    tracing::error!("a panic where a route's connection was read: {panic}");
                    recent = Recent::default();
                }
                state = self.state.lock();
                // No other thread has taken it from `idle` where the wait ended by itself, or for all.
                _ = state.take_idle_worker(number);
                state.woken = state.woken.saturating_sub(1);
                continue;
            };
            // One woken worker wakes the next, as long as members wait.
            let another = (state.has_more() && state.woken == 0).then(|| state.take_idle());
            drop(state);
            if let Some(bell) = another.flatten() {
                bell.ring();
            }
            recent.note(&member);
            member.place.store(Place::RUNNING, Ordering::Release);
            let turn = contained(|| (member.turn(), self.clock.now()));
            let (step, now) = turn.unwrap_or_else(|panic| {
                // The clock may be what panicked, so the system's time is taken.
                let now = Instant::now();
                (Some(member.turn_panicked(&panic, now)), now)
            });
            state = self.state.lock();
            if is_behind {
                state.at_behind -= 1;
            }
            if state.stop {
                drop(state);
                // A route that was in the middle of its step at the stop is closed here, because
                // no other thread does. The lock is free, because its ends ring when they close. The
                // program waits for the close, in which the ends unregister from masters and name
                // servers.
                member.close();
                state = self.state.lock();
                break;
            }
            self.put_back(&mut state, member, step, now);
        }
        state.workers -= 1;
        self.has_ended(&mut state);
    }

    /// Lets a member wait for the time of its next step, or for its turn where that has come.
    fn put_back(
        &self,
        state: &mut PoolState,
        member: Arc<Member>,
        step: Option<Progress>,
        now: Instant,
    ) {
        let Some(Progress { next, .. }) = step else {
            member.place.store(Place::CLOSED, Ordering::Release);
            return;
        };
        let is_due = next <= now;
        let is_at_rest = try_move(&member, Place::RUNNING, Place::IDLE);
        if !is_at_rest || is_due {
            // A bell that rings at this moment finds the member queued, or queues it itself.
            if !is_at_rest || try_move(&member, Place::IDLE, Place::QUEUED) {
                member.place.store(Place::QUEUED, Ordering::Release);
                self.enqueue(state, member);
            }
            return;
        }
        let next = self.together(next, now);
        let mut timer = member.timer.lock();
        if timer.is_none_or(|at| next < at) {
            *timer = Some(next);
            drop(timer);
            let is_first = state.timers.first_key_value().is_none_or(|((at, _), _)| next < *at);
            state.timers.insert((next, member.id), member);
            if is_first {
                self.tick.notify_one();
            }
        }
    }

    /// Time at which a step that is due at `next` is taken: with others where it is distant.
    fn together(&self, next: Instant, now: Instant) -> Instant {
        if next.saturating_duration_since(now) < FAR {
            return next;
        }
        let since = next.saturating_duration_since(self.epoch).as_nanos();
        let late = since.next_multiple_of(TOGETHER.as_nanos()) - since;
        u64::try_from(late).map_or(next, |late| next + Duration::from_nanos(late))
    }

    /// Queues members that are due, and adds and removes workers, until the pool is stopped.
    fn keep_time(self: &Arc<Self>, look: &impl Fn(Instant)) {
        let mut looked_at = self.clock.now();
        // Numbers of turns taken at the moment when members were seen waiting without a worker.
        let mut seen: Option<(Instant, (u64, u64))> = None;
        let mut state = self.state.lock();
        while !state.stop {
            let now = self.clock.now();
            while let Some(entry) = state.timers.first_entry().filter(|it| it.key().0 <= now) {
                let member = entry.remove();
                *member.timer.lock() = None;
                if try_move(&member, Place::IDLE, Place::QUEUED) {
                    self.enqueue(&mut state, member);
                    if let Some(bell) = state.take_idle() {
                        bell.ring();
                    }
                }
            }
            if now.saturating_duration_since(looked_at) >= LOOK_EVERY {
                looked_at = now;
                if state.workers > self.base {
                    state.idle.iter().for_each(|idle| idle.bell.ring());
                }
                drop(state);
                look(now);
                state = self.state.lock();
            }
            let mut pause = LOOK_EVERY;
            if state.waits_in_vain() {
                let turns = (state.turns, state.turns_behind);
                let (since, before) = *seen.get_or_insert((now, turns));
                let is_stuck = now.saturating_duration_since(since) >= STUCK_AFTER;
                let is_same = (before.0 == turns.0 && !state.ready.is_empty())
                    || (before.1 == turns.1 && !state.behind.is_empty());
                if is_stuck {
                    seen = Some((now, turns));
                }
                let grows = state.workers < self.base || (is_stuck && is_same);
                if grows
                    && state.workers < MOST_STUCK
                    && let Err(error) = self.grow(&mut state)
                {
                    tracing::error!("the system gives no thread for more routes: {error}");
                }
                pause = STUCK_AFTER;
            } else if seen.take().is_some() {
                // Looks once more before workers have to report the next wait, which costs them a
                // wake-up.
                pause = STUCK_AFTER;
            } else {
                state.is_watched = false;
            }
            if let Some(((at, _), _)) = state.timers.first_key_value() {
                pause = pause.min(at.saturating_duration_since(self.clock.now()));
            }
            state = self.tick.wait_timeout(state, pause).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// Lets every worker end after the step that it is in.
    pub(super) fn stop(&self) {
        let mut state = self.state.lock();
        state.stop = true;
        // Dropped after the lock: the queues hold members, which close their endpoints when
        // dropped.
        let held = (
            std::mem::take(&mut state.ready),
            std::mem::take(&mut state.behind),
            std::mem::take(&mut state.timers),
        );
        state.idle.iter().for_each(|idle| idle.bell.ring());
        drop(state);
        drop(held);
        self.tick.notify_all();
        self.ended.notify_all();
    }

    /// Waits until every thread has ended, at most `limit`.
    pub(super) fn wait(&self, limit: Duration) {
        let is_busy = |state: &mut PoolState| state.threads > 0;
        drop(self.ended.wait_timeout_while(self.state.lock(), limit, is_busy));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Route;
    use wrapyfi_data::types::MessageType;
    use wrapyfi_endpoint::Registry;

    #[test]
    fn the_timekeeper_is_told_of_members_that_wait_in_vain_and_not_of_those_that_their_worker_takes_again()
     {
        let pool = Pool::new(Clock::default());
        let route = "memory:/in".parse().and_then(|from| {
            Ok(Route::topic(from, "memory:/out".parse()?, MessageType::NativeObject))
        });
        let (registry, counters) = (Registry::new(), Arc::default());
        let weak = Arc::downgrade(&pool);
        let member = Member::new(1, route.unwrap(), counters, &registry, None, weak);
        let (mut state, now) = (PoolState { workers: 1, ..PoolState::default() }, Instant::now());
        member.place.store(Place::RUNNING, Ordering::Release);
        let busy = Progress { moved: 16, next: now };
        pool.put_back(&mut state, Arc::clone(&member), Some(busy), now);
        assert!(!state.is_watched, "the only worker takes it next");
        assert!(state.next().is_some());
        pool.watch(&mut state);
        assert!(!state.is_watched, "nobody waits");
        pool.enqueue(&mut state, member);
        pool.watch(&mut state);
        assert!(state.is_watched, "the only worker is in a step");
    }

    #[test]
    fn distant_steps_come_together_and_never_early() {
        let pool = Pool::new(Clock::default());
        let now = Instant::now();
        let near = now + FAR - Duration::from_millis(1);
        assert_eq!(pool.together(near, now), near);
        let moments: std::collections::BTreeSet<Instant> = (0..1000)
            .map(|millis| {
                let next = now + FAR + Duration::from_millis(millis);
                let taken = pool.together(next, now);
                assert!(taken >= next && taken < next + TOGETHER);
                taken
            })
            .collect();
        assert!((50..=51).contains(&moments.len()), "{}", moments.len());
    }
}
