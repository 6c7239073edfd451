//! The listener of one value, shared by all callers.
//!
//! ```text
//!   I/O thread ─▶ inbox ── take ─▶ caller's thread or task
//!        └──────── ring ──────────▶ (woken here, no thread between)
//! ```

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::error::MethodError;
use super::missing::Missing;
use super::notifier::{Look, Notifier};
use super::rules::Rules;
use super::runtime::Runtime;
use super::wait::{Wait, with_reason};
use wrapyfi_data::types::Payload;
use wrapyfi_endpoint::{Clock, Counters, EndpointAddress, Link, Listener, Mutex, Throttle};

/// Time between two looks at the peers while nothing rings.
const REVIEW_EVERY: Duration = Duration::from_secs(1);

pub(super) struct ListenerEnd {
    pub(super) endpoint: EndpointAddress,
    pub(super) rules: Rules,
    pub(super) counters: Arc<Counters>,
    pub(super) should_wait: bool,
    pub(super) timeout: Option<Duration>,
    pub(super) notifier: Notifier,
    missing: Missing,
    clock: Clock,
    state: Mutex<State>,
}

struct State {
    listener: Box<dyn Listener>,
    /// Messages that were taken for a call that failed; the next call gets them first.
    held: VecDeque<Payload>,
    review_at: Instant,
    /// Throttle of lines about bad messages.
    said: Throttle,
}

/// Options of a value for its endpoint: whether and how long a call waits, and the checks.
pub(super) struct EndOptions {
    pub(super) should_wait: bool,
    pub(super) timeout: Option<Duration>,
    pub(super) rules: Rules,
    pub(super) missing: Missing,
}

impl ListenerEnd {
    pub(super) fn new(
        endpoint: EndpointAddress,
        listener: Box<dyn Listener>,
        context: &wrapyfi_endpoint::Context,
        options: EndOptions,
    ) -> Self {
        Self {
            endpoint,
            rules: options.rules,
            counters: Arc::clone(&context.counters),
            should_wait: options.should_wait,
            timeout: options.timeout,
            notifier: Notifier::new(context.wake.clone()),
            missing: options.missing,
            clock: context.clock.clone(),
            state: Mutex::new(State {
                listener,
                held: VecDeque::new(),
                review_at: context.clock.now(),
                said: Throttle::default(),
            }),
        }
    }

    /// Takes the next message; waits for one if the option `should_wait` is set, as [`Notifier::wait`], and the
    /// middleware is not missing.
    pub(super) async fn take(
        &self,
        wait: &mut Wait<'_>,
        runtime: Option<&Runtime>,
    ) -> Result<Option<Payload>, MethodError> {
        let first = self.take_now();
        if first.is_some() || !self.should_wait {
            return Ok(first);
        }
        let look = || match self.look() {
            Look::Found(payload) => Look::Found(Some(payload)),
            Look::Again(_) if self.missing.is_given_up(&self.endpoint) => Look::Found(None),
            Look::Again(at) => Look::Again(at),
        };
        self.notifier.wait(wait, runtime, || self.waited_for(), look).await
    }

    /// Gives back a message that was taken for a call that failed.
    pub(super) fn put_back(&self, payload: Payload) {
        self.state.lock().held.push_front(payload);
        self.notifier.ring();
    }

    pub(super) fn link(&self) -> Link {
        self.state.lock().listener.link()
    }

    fn look(&self) -> Look<Payload> {
        match self.take_now() {
            Some(payload) => Look::Found(payload),
            None => {
                let mut state = self.state.lock();
                self.review(&mut state, self.clock.now());
                Look::Again(Some(state.review_at))
            }
        }
    }

    fn take_now(&self) -> Option<Payload> {
        let mut state = self.state.lock();
        if let Some(payload) = state.held.pop_front() {
            return Some(payload);
        }
        let now = self.clock.now();
        if now >= state.review_at {
            self.review(&mut state, now);
        }
        loop {
            match state.listener.take() {
                Ok(Some(sample)) => return Some(sample.payload),
                Ok(None) => return None,
                Err(error) => {
                    self.counters.dropped((&error).into());
                    if state.said.pass(now).is_some() {
                        tracing::warn!("dropped a message from {}: {error}", self.endpoint);
                    }
                }
            }
        }
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
        with_reason(format!("a message on {}", self.endpoint), self.link())
    }
}
