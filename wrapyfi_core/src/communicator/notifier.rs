//! Waits of several threads and tasks on one doorbell.
//!
//! One thread answers a ring. A waiter that has got its value passes the ring on, so that the
//! others look as well. The ring itself wakes tasks, without a thread between.

use std::future::poll_fn;
use std::pin::pin;
use std::sync::atomic::{AtomicUsize, Ordering::SeqCst};
use std::task::{Context, Poll, Waker};
use std::time::{Duration, Instant};

use super::error::MethodError;
use super::runtime::Runtime;
use super::wait::Wait;
use wrapyfi_endpoint::Wake;

/// Longest time between two looks, should a middleware forget to ring.
const LOOK_EVERY: Duration = Duration::from_millis(500);

/// A doorbell, and the number of threads and tasks that wait for it.
#[derive(Debug, Default)]
pub(super) struct Notifier {
    wake: Wake,
    waiters: AtomicUsize,
}

/// Result of one look by a waiting thread or task.
pub(super) enum LookResult<T> {
    /// Value that the wait was for.
    Found(T),
    /// Nothing yet; the next look is due at this instant without a ring.
    Again(Option<Instant>),
}

/// One thread or task that waits. Dropping it passes the ring on to the others.
struct Waiting<'a>(&'a Notifier);

impl<'a> Waiting<'a> {
    fn new(notifier: &'a Notifier) -> Self {
        notifier.waiters.fetch_add(1, SeqCst);
        Self(notifier)
    }
}

impl Drop for Waiting<'_> {
    fn drop(&mut self) {
        if self.0.waiters.fetch_sub(1, SeqCst) > 1 {
            self.0.wake.ring();
        }
    }
}

impl Notifier {
    pub(super) fn new(wake: Wake) -> Self {
        Self { wake, waiters: AtomicUsize::new(0) }
    }

    pub(super) fn ring(&self) {
        self.wake.ring();
    }

    /// Waits until `look` finds the value, or the wait is over: with a `runtime`, which keeps the time, as a task;
    /// without one it blocks its thread, and is ready at its first poll.
    pub(super) async fn wait<T>(
        &self,
        wait: &mut Wait<'_>,
        runtime: Option<&Runtime>,
        waited_for: impl Fn() -> String,
        mut look: impl FnMut() -> LookResult<T>,
    ) -> Result<T, MethodError> {
        let _waiting = Waiting::new(self);
        let mut timer = None::<(Instant, Waker)>;
        poll_fn(|task| {
            loop {
                if runtime.is_some() {
                    // Asked for before the look, so that a ring after the look is not lost.
                    self.wake.notify(task.waker());
                }
                let again = match look() {
                    LookResult::Found(found) => return Poll::Ready(Ok(found)),
                    LookResult::Again(again) => again,
                };
                let step = match wait.check(&waited_for) {
                    Ok(step) => step.min(until(again)),
                    Err(error) => return Poll::Ready(Err(error)),
                };
                let Some(runtime) = runtime else {
                    self.wake.wait(step);
                    continue;
                };
                let now = Instant::now();
                let is_set = timer
                    .as_ref()
                    .is_some_and(|(at, waker)| *at > now && waker.will_wake(task.waker()));
                if !is_set {
                    runtime.wake_at(now + step, task.waker().clone());
                    timer = Some((now + step, task.waker().clone()));
                }
                return Poll::Pending;
            }
        })
        .await
    }
}

/// Result of a future that blocks its thread where it waits.
#[must_use]
pub fn at_once<T>(future: impl Future<Output = T>) -> T {
    let mut future = pin!(future);
    let mut task = Context::from_waker(Waker::noop());
    loop {
        if let Poll::Ready(result) = future.as_mut().poll(&mut task) {
            return result;
        }
    }
}

fn until(again: Option<Instant>) -> Duration {
    again.map_or(LOOK_EVERY, |at| at.saturating_duration_since(Instant::now()).min(LOOK_EVERY))
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicBool;
    use std::sync::{Arc, Mutex};

    use super::super::wait::Stop;
    use super::*;

    #[test]
    fn two_who_wait_are_both_served_by_rings_that_fall_together() {
        let (notifier, goods) = (Arc::new(Notifier::default()), Arc::new(Mutex::new(0)));
        let waiters: Vec<_> = (0..2)
            .map(|_| {
                let (notifier, goods) = (Arc::clone(&notifier), Arc::clone(&goods));
                std::thread::spawn(move || {
                    let stop = Stop::default();
                    let mut wait = Wait::new("A::b", &stop, Some(Duration::from_secs(60)));
                    let look = || {
                        let mut goods = goods.lock().unwrap();
                        if *goods == 0 {
                            return LookResult::Again(None);
                        }
                        *goods -= 1;
                        LookResult::Found(())
                    };
                    at_once(notifier.wait(&mut wait, None, || "goods".into(), look))
                })
            })
            .collect();
        *goods.lock().unwrap() = 2;
        notifier.ring();
        for waiter in waiters {
            assert!(waiter.join().unwrap().is_ok());
        }
    }

    #[test]
    fn a_task_is_woken_by_the_ring() {
        struct Flag(AtomicBool);
        impl std::task::Wake for Flag {
            fn wake(self: Arc<Self>) {
                self.0.store(true, SeqCst);
            }
        }
        let (notifier, stop, runtime) = (Notifier::default(), Stop::default(), Runtime::start());
        let mut wait = Wait::new("A::b", &stop, None);
        let found = AtomicBool::new(false);
        let look =
            || if found.load(SeqCst) { LookResult::Found(7) } else { LookResult::Again(None) };
        let mut wait = pin!(notifier.wait(&mut wait, Some(&runtime), || "seven".into(), look));
        let flag = Arc::new(Flag(AtomicBool::new(false)));
        let waker = Arc::clone(&flag).into();
        let mut task = std::task::Context::from_waker(&waker);
        assert!(wait.as_mut().poll(&mut task).is_pending());
        found.store(true, SeqCst);
        notifier.ring();
        assert!(flag.0.load(SeqCst));
        assert!(matches!(wait.as_mut().poll(&mut task), Poll::Ready(Ok(7))));
    }
}
