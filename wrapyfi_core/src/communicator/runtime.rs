//! The thread on which endpoints are opened and watched.
//!
//! ```text
//!   first call ── job ──▶ ┌─────────┐ ◀── ring ── publishers whose peers come and go
//!   async call ── timer ▶ │ runtime │ ── look ──▶ publishers: does a program listen?
//!                         └─────────┘ ── flush ─▶ servers with replies that are not heard yet
//! ```
//!
//! Goals of actions are watched as publishers are.
//!
//! A message does not pass through the thread: a call takes and publishes on its own, so that the
//! way is as short as the endpoint's. Work that may take long, such as starting a middleware, is
//! done here, where it blocks no task of an executor.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Weak};
use std::task::Waker;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use wrapyfi_endpoint::{Mutex, Wake};

/// Longest time between two looks at the publishers.
const LOOK_EVERY: Duration = Duration::from_secs(1);
/// Shortest time between two looks, because jobs ring the same bell.
const LOOK_AT_MOST: Duration = Duration::from_millis(1);

/// An end that the thread looks at.
pub(super) trait Watched: Send + Sync {
    /// Looks; instant of the next look. A server that wants none is forgotten.
    fn look(&self, now: Instant) -> Option<Instant>;
}

type Job = Box<dyn FnOnce() + Send>;

/// Handle of the thread, which ends when the handle is dropped.
pub(super) struct Runtime {
    shared: Arc<RuntimeState>,
    thread: Mutex<Option<JoinHandle<()>>>,
}

#[derive(Default)]
struct RuntimeState {
    bell: Wake,
    work: Mutex<Work>,
    is_over: AtomicBool,
    next: AtomicU64,
}

#[derive(Default)]
struct Work {
    jobs: Vec<Job>,
    watched: Vec<Weak<dyn Watched>>,
    /// Servers that keep replies.
    servers: Vec<Weak<dyn Watched>>,
    /// Tasks by the time at which they are woken, and a number.
    timers: BTreeMap<(Instant, u64), Waker>,
}

impl Runtime {
    /// Starts the thread; without one (the system refuses) jobs run where they are submitted.
    pub(super) fn start() -> Self {
        let shared = Arc::<RuntimeState>::default();
        let inner = Arc::clone(&shared);
        let thread = std::thread::Builder::new()
            .name("wrapyfi".to_owned())
            .spawn(move || inner.run())
            .inspect_err(|error| tracing::error!(%error, "the library's thread does not start"))
            .ok();
        if thread.is_none() {
            shared.is_over.store(true, Relaxed);
        }
        Self { shared, thread: Mutex::new(thread) }
    }

    /// Runs `job` on the thread, after the jobs submitted before.
    pub(super) fn submit(&self, job: impl FnOnce() + Send + 'static) {
        if self.shared.is_over.load(Relaxed) {
            job();
            return;
        }
        self.shared.work.lock().jobs.push(Box::new(job));
        self.shared.bell.ring();
    }

    /// Wakes a task at `at`.
    pub(super) fn wake_at(&self, at: Instant, waker: Waker) {
        let number = self.shared.next.fetch_add(1, Relaxed);
        self.shared.work.lock().timers.insert((at, number), waker);
        self.shared.bell.ring();
    }

    /// Watches a publisher, or goals, for as long as they live.
    pub(super) fn watch(&self, end: Weak<dyn Watched>) {
        self.shared.work.lock().watched.push(end);
        self.shared.bell.ring();
    }

    /// Sends the replies that a server keeps, as soon as their clients hear.
    pub(super) fn flush(&self, server: Weak<dyn Watched>) {
        let mut work = self.shared.work.lock();
        if !work.servers.iter().any(|known| known.ptr_eq(&server)) {
            work.servers.push(server);
        }
        drop(work);
        self.shared.bell.ring();
    }

    /// Bell to ring when a publisher's peers change, and when there is news of a goal.
    pub(super) fn bell(&self) -> Wake {
        self.shared.bell.clone()
    }
}

impl Drop for Runtime {
    fn drop(&mut self) {
        self.shared.is_over.store(true, Relaxed);
        self.shared.bell.ring();
        let thread = self.thread.lock().take();
        if let Some(thread) = thread
            // A job may drop the last reference on this very thread, which cannot join itself.
            && thread.thread().id() != std::thread::current().id()
            && thread.join().is_err()
        {
            tracing::error!("the library's thread panicked");
        }
    }
}

impl RuntimeState {
    fn run(&self) {
        let mut looked_at = None::<Instant>;
        let mut look_at = Instant::now();
        while !self.is_over.load(Relaxed) {
            let now = Instant::now();
            let due = self.wake_due(now).unwrap_or(LOOK_EVERY);
            let rang = self.bell.wait(due.min(look_at.saturating_duration_since(now)));
            let jobs = std::mem::take(&mut self.work.lock().jobs);
            jobs.into_iter().for_each(|job| job());
            let now = Instant::now();
            if rang {
                // One look covers several rings, which may come faster than looks are worth.
                let earliest = looked_at.map_or(now, |last| last + LOOK_AT_MOST);
                look_at = look_at.min(earliest);
            }
            if now >= look_at {
                let next = self.look(now).unwrap_or(now + LOOK_EVERY);
                look_at = next.clamp(now + LOOK_AT_MOST, now + LOOK_EVERY);
                looked_at = Some(now);
            }
        }
        // Jobs that were submitted before the stop have callers that wait for them.
        let jobs = std::mem::take(&mut self.work.lock().jobs);
        jobs.into_iter().for_each(|job| job());
    }

    /// Wakes the tasks whose time has come; time until the next one.
    fn wake_due(&self, now: Instant) -> Option<Duration> {
        loop {
            let timer = {
                let mut work = self.work.lock();
                let first = work.timers.first_entry()?;
                let at = first.key().0;
                if at > now {
                    return Some(at - now);
                }
                first.remove()
            };
            timer.wake();
        }
    }

    /// Looks at all that is watched and flushes servers; instant of the next look that one of them wants.
    fn look(&self, now: Instant) -> Option<Instant> {
        let servers = std::mem::take(&mut self.work.lock().servers);
        let mut next = None;
        for server in servers {
            let again = server.upgrade().and_then(|server| server.look(now));
            if again.is_some() {
                self.work.lock().servers.push(server);
            }
            next = next.into_iter().chain(again).min();
        }
        let watched: Vec<_> = {
            let mut work = self.work.lock();
            work.watched.retain(|end| end.strong_count() > 0);
            work.watched.iter().filter_map(Weak::upgrade).collect()
        };
        watched.iter().filter_map(|end| end.look(now)).chain(next).min()
    }
}

#[cfg(test)]
mod tests {
    use super::super::oneshot::channel;
    use super::*;

    #[test]
    fn jobs_are_done_in_order_and_timers_wake() {
        let runtime = Runtime::start();
        let (first, one) = channel();
        let (second, two) = channel();
        runtime.submit(move || first.send(1));
        runtime.submit(move || second.send(2));
        assert_eq!((one.recv(), two.recv()), (Some(1), Some(2)));

        struct Flag(Mutex<Option<super::super::oneshot::Sender<()>>>);
        impl std::task::Wake for Flag {
            fn wake(self: Arc<Self>) {
                self.0.lock().take();
            }
        }
        let (sender, woken) = channel();
        let flag = Arc::new(Flag(Mutex::new(Some(sender))));
        runtime.wake_at(Instant::now() + Duration::from_millis(1), flag.into());
        assert_eq!(woken.recv(), None);
    }
}
