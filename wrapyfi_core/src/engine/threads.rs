//! Threads of routes: one for each that is at work, and one for all that rest.
//!
//! ```text
//!   Member::start ─▶ Rest: one thread steps all that nobody wants
//!                     │ somebody listens, or calls      ▲ nobody any more
//!                     └─▶ a thread of its own ──────────┘
//! ```
//!
//! A thread a route keeps them apart: a reliable reader that stalls its writer stalls that route and no
//! other. A route at rest moves nothing, so it can stall nobody.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::Waker;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::engine::Work;
use crate::endpoint::Wake;

/// How long the thread of those that rest sleeps where none does.
const IDLE: Duration = Duration::from_secs(3600);

pub(super) fn lock<T: ?Sized>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A route and the thread that it has, if it has one.
pub(super) struct Member {
    pub(super) id: u64,
    /// None once it has ended.
    pub(super) work: Mutex<Option<Work>>,
    wake: Wake,
    /// Its bell rang while it rested.
    rung: AtomicBool,
    stop: AtomicBool,
    thread: Mutex<Option<JoinHandle<()>>>,
    rest: Arc<Rest>,
}

impl std::task::Wake for Member {
    fn wake(self: Arc<Self>) {
        self.rung.store(true, Ordering::Release);
        self.rest.bell.ring();
    }
}

impl Member {
    /// Brings a route to work, or to rest.
    pub(super) fn start(id: u64, work: Work, rest: &Arc<Rest>) -> std::io::Result<Arc<Self>> {
        let (wake, rests) = (work.wake().clone(), work.is_at_rest(Instant::now()));
        let member = Arc::new(Self {
            id,
            work: Mutex::new(Some(work)),
            wake,
            rung: AtomicBool::new(true),
            stop: AtomicBool::new(false),
            thread: Mutex::default(),
            rest: Arc::clone(rest),
        });
        if rests {
            rest.take_in(Arc::clone(&member));
        } else {
            member.go_to_work()?;
        }
        Ok(member)
    }

    /// Gives it a thread of its own.
    fn go_to_work(self: &Arc<Self>) -> std::io::Result<()> {
        let mut thread = lock(&self.thread);
        if self.stop.load(Ordering::Relaxed) {
            return Ok(());
        }
        let member = Arc::clone(self);
        let name = format!("route-{}", self.id);
        // The one that it had before has ended, or does nothing any more.
        *thread = Some(std::thread::Builder::new().name(name).spawn(move || member.run())?);
        Ok(())
    }

    fn run(self: Arc<Self>) {
        while !self.stop.load(Ordering::Relaxed) {
            let Some((next, rests)) = self.step() else { return };
            if rests {
                return self.rest.take_in(Arc::clone(&self));
            }
            let rest = next.saturating_duration_since(Instant::now());
            if !rest.is_zero() {
                self.wake.wait(rest);
            }
        }
    }

    /// When the next step is due, and whether it rests; none once it has ended.
    fn step(&self) -> Option<(Instant, bool)> {
        let mut work = lock(&self.work);
        let work = work.as_mut()?;
        let now = Instant::now();
        Some((work.step(now).next, work.is_at_rest(now)))
    }

    pub(super) fn tell_to_stop(&self) {
        self.stop.store(true, Ordering::Relaxed);
        self.wake.ring();
    }

    pub(super) fn join(&self) {
        let thread = lock(&self.thread).take();
        if let Some(thread) = thread
            && thread.join().is_err()
        {
            tracing::error!("a route's thread panicked");
        }
    }
}

/// The routes that rest.
#[derive(Default)]
pub(super) struct Rest {
    /// Those that have come, and are not looked at yet.
    arrived: Mutex<Vec<Arc<Member>>>,
    bell: Wake,
    stop: AtomicBool,
}

impl Rest {
    fn take_in(&self, member: Arc<Member>) {
        member.rung.store(true, Ordering::Release);
        lock(&self.arrived).push(member);
        self.bell.ring();
    }

    pub(super) fn tell_to_stop(&self) {
        self.stop.store(true, Ordering::Relaxed);
        self.bell.ring();
    }

    /// Steps all that rest, each when it is due or rung for, until it is told to stop.
    pub(super) fn run(&self) {
        let mut resting: Vec<(Arc<Member>, Waker, Instant)> = Vec::new();
        while !self.stop.load(Ordering::Relaxed) {
            let now = Instant::now();
            let arrived = std::mem::take(&mut *lock(&self.arrived));
            resting.extend(arrived.into_iter().map(|member| {
                let waker = Waker::from(Arc::clone(&member));
                (member, waker, now)
            }));
            resting.retain_mut(|(member, waker, due)| {
                if member.stop.load(Ordering::Relaxed) {
                    return false;
                }
                if !member.rung.swap(false, Ordering::AcqRel) && *due > now {
                    return true;
                }
                // Before it looks, so that no ring is lost.
                member.wake.notify(waker);
                let Some((next, rests)) = member.step() else { return false };
                *due = next;
                if rests {
                    return true;
                }
                match member.go_to_work() {
                    Ok(()) => false,
                    Err(error) => {
                        let route = member.id;
                        tracing::error!(route, "the system gives no thread: {error}");
                        true
                    }
                }
            });
            let next = resting.iter().map(|(_, _, due)| *due).min();
            let pause = next.map_or(IDLE, |at| at.saturating_duration_since(Instant::now()));
            self.bell.wait(pause);
        }
    }
}
