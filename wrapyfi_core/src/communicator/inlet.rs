//! The way in of one value: a listener, shared by all callers.
//!
//! ```text
//!   I/O thread ─▶ inbox ── take ─▶ caller's thread or task
//!        └──────── ring ──────────▶ (woken here, no thread between)
//! ```

use std::collections::VecDeque;
use std::future::poll_fn;
use std::sync::atomic::{AtomicUsize, Ordering::SeqCst};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Poll, Waker};
use std::time::{Duration, Instant};

use super::error::CallError;
use super::rules::Rules;
use super::runtime::Runtime;
use super::wait::Patience;
use crate::endpoint::{Counters, EndpointAddress, Link, Listener, Wake};
use crate::types::Payload;

/// Time between two looks at the peers while nothing rings.
const REVIEW_EVERY: Duration = Duration::from_secs(1);
/// Shortest time between two lines about bad messages.
const SAY_EVERY: Duration = Duration::from_secs(5);

pub(super) struct Inlet {
    pub(super) endpoint: EndpointAddress,
    pub(super) rules: Rules,
    pub(super) counters: Arc<Counters>,
    pub(super) should_wait: bool,
    pub(super) timeout: Option<Duration>,
    wake: Wake,
    waiters: AtomicUsize,
    state: Mutex<State>,
}

struct State {
    listener: Box<dyn Listener>,
    /// Taken for a call that did not end well.
    held: VecDeque<Payload>,
    review_at: Instant,
    say_at: Instant,
}

/// One of those who wait; the others are told to look when it has got something.
struct Waiting<'a>(&'a Inlet);

impl<'a> Waiting<'a> {
    fn new(inlet: &'a Inlet) -> Self {
        inlet.waiters.fetch_add(1, SeqCst);
        Self(inlet)
    }
}

impl Drop for Waiting<'_> {
    fn drop(&mut self) {
        if self.0.waiters.fetch_sub(1, SeqCst) > 1 {
            self.0.wake.ring();
        }
    }
}

/// How a value is waited for and checked.
pub(super) struct Manners {
    pub(super) should_wait: bool,
    pub(super) timeout: Option<Duration>,
    pub(super) rules: Rules,
}

impl Inlet {
    pub(super) fn new(
        endpoint: EndpointAddress,
        listener: Box<dyn Listener>,
        context: &crate::endpoint::Context,
        manners: Manners,
    ) -> Self {
        let now = Instant::now();
        Self {
            endpoint,
            rules: manners.rules,
            counters: Arc::clone(&context.counters),
            should_wait: manners.should_wait,
            timeout: manners.timeout,
            wake: context.wake.clone(),
            waiters: AtomicUsize::new(0),
            state: Mutex::new(State {
                listener,
                held: VecDeque::new(),
                review_at: now,
                say_at: now,
            }),
        }
    }

    /// The next message; waits for one where the value is to be waited for.
    pub(super) fn take(&self, patience: &mut Patience<'_>) -> Result<Option<Payload>, CallError> {
        let first = self.take_now(false);
        if first.is_some() || !self.should_wait {
            return Ok(first);
        }
        let _waiting = Waiting::new(self);
        let mut rang = true;
        loop {
            if let Some(payload) = self.take_now(rang) {
                return Ok(Some(payload));
            }
            let step = patience.check(|| self.waited_for())?;
            rang = self.wake.wait(step.min(REVIEW_EVERY));
        }
    }

    /// The same for a task.
    pub(super) async fn take_async(
        &self,
        patience: &mut Patience<'_>,
        runtime: &Runtime,
    ) -> Result<Option<Payload>, CallError> {
        let mut timer = Timer::default();
        let _waiting = Waiting::new(self);
        poll_fn(|task| {
            // Before the look: a ring after it is then not lost.
            self.wake.notify(task.waker());
            if let Some(payload) = self.take_now(true) {
                return Poll::Ready(Ok(Some(payload)));
            }
            if !self.should_wait {
                return Poll::Ready(Ok(None));
            }
            match patience.check(|| self.waited_for()) {
                Err(error) => Poll::Ready(Err(error)),
                Ok(step) => {
                    timer.set(runtime, step.min(REVIEW_EVERY), task.waker());
                    Poll::Pending
                }
            }
        })
        .await
    }

    /// Gives a message back that was taken for nothing.
    pub(super) fn put_back(&self, payload: Payload) {
        self.lock().held.push_front(payload);
        self.wake.ring();
    }

    /// Has those who wait look.
    pub(super) fn ring(&self) {
        self.wake.ring();
    }

    pub(super) fn link(&self) -> Link {
        self.lock().listener.link()
    }

    fn take_now(&self, review: bool) -> Option<Payload> {
        let mut state = self.lock();
        if let Some(payload) = state.held.pop_front() {
            return Some(payload);
        }
        let now = Instant::now();
        if now >= state.review_at {
            self.review(&mut state, now);
        }
        loop {
            match state.listener.take() {
                Ok(Some(sample)) => return Some(sample.payload),
                Ok(None) => break,
                Err(error) => {
                    self.counters.dropped(error.drop_reason());
                    if now >= state.say_at {
                        tracing::warn!("dropped a message from {}: {error}", self.endpoint);
                        state.say_at = now + SAY_EVERY;
                    }
                }
            }
        }
        if review {
            self.review(&mut state, now);
        }
        None
    }

    fn review(&self, state: &mut State, now: Instant) {
        let review = state.listener.review(now);
        for warning in &review.warnings {
            tracing::warn!("{}: {warning}", self.endpoint);
        }
        let latest = now + REVIEW_EVERY;
        state.review_at = review.next.map_or(latest, |next| next.min(latest));
    }

    fn waited_for(&self) -> String {
        let what = format!("a message on {}", self.endpoint);
        match self.link().waiting_for {
            Some(reason) => format!("{what} ({reason})"),
            None => what,
        }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Wakes a waiting task when it should look though nothing rang.
#[derive(Default)]
pub(super) struct Timer(Option<(Instant, Waker)>);

impl Timer {
    /// Asks for a wake in `step`, unless one is on its way to the same task.
    pub(super) fn set(&mut self, runtime: &Runtime, step: Duration, task: &Waker) {
        let now = Instant::now();
        if self.0.as_ref().is_some_and(|(at, waker)| *at > now && waker.will_wake(task)) {
            return;
        }
        let at = now + step;
        runtime.wake_at(at, task.clone());
        self.0 = Some((at, task.clone()));
    }
}
