//! The listener of one value, shared by all callers.
//!
//! ```text
//!   I/O thread ─▶ inbox ── take ─▶ caller's thread or task
//!        └──────── ring ──────────▶ (woken here, no thread between)
//! ```

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use super::end::EndCommon;
use super::error::MethodError;
use super::notifier::LookResult;
use super::runtime::Runtime;
use super::wait::{Wait, with_reason};
use wrapyfi_data::types::Payload;
use wrapyfi_endpoint::{Clock, Link, Listener, Mutex, Throttle};

/// Time between two looks at the peers while nothing rings.
const REVIEW_EVERY: Duration = Duration::from_secs(1);

pub(super) struct ListenerEnd {
    pub(super) common: EndCommon,
    clock: Clock,
    state: Mutex<ListenerState>,
}

struct ListenerState {
    listener: Box<dyn Listener>,
    /// Messages that were taken for a call that failed; the next call gets them first.
    held: VecDeque<Payload>,
    review_at: Instant,
    /// Throttle of lines about bad messages.
    said: Throttle,
}

impl ListenerEnd {
    pub(super) fn new(common: EndCommon, listener: Box<dyn Listener>, clock: Clock) -> Self {
        let (held, review_at, said) = (VecDeque::new(), clock.now(), Throttle::default());
        Self { common, clock, state: Mutex::new(ListenerState { listener, held, review_at, said }) }
    }

    /// Takes the next message; waits for one if the option `should_wait` is set, as [`Notifier::wait`], and the
    /// middleware is not missing.
    pub(super) async fn take(
        &self,
        wait: &mut Wait<'_>,
        runtime: Option<&Runtime>,
    ) -> Result<Option<Payload>, MethodError> {
        let first = self.take_now();
        if first.is_some() || !self.common.should_wait {
            return Ok(first);
        }
        let look = || match self.look() {
            LookResult::Found(payload) => LookResult::Found(Some(payload)),
            LookResult::Again(_) if self.common.is_given_up() => LookResult::Found(None),
            LookResult::Again(at) => LookResult::Again(at),
        };
        self.common.notifier.wait(wait, runtime, || self.waited_for(), look).await
    }

    /// Gives back a message that was taken for a call that failed.
    pub(super) fn put_back(&self, payload: Payload) {
        self.state.lock().held.push_front(payload);
        self.common.notifier.ring();
    }

    pub(super) fn link(&self) -> Link {
        self.state.lock().listener.link()
    }

    fn look(&self) -> LookResult<Payload> {
        match self.take_now() {
            Some(payload) => LookResult::Found(payload),
            None => {
                let mut state = self.state.lock();
                self.review(&mut state, self.clock.now());
                LookResult::Again(Some(state.review_at))
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
                    self.common.counters.dropped((&error).into());
                    if state.said.pass(now).is_some() {
                        tracing::warn!("dropped a message from {}: {error}", self.common.endpoint);
                    }
                }
            }
        }
    }

    fn review(&self, state: &mut ListenerState, now: Instant) {
        let review = state.listener.review(now);
        for warning in &review.warnings {
            tracing::warn!("{}: {warning}", self.common.endpoint);
        }
        let latest = now + REVIEW_EVERY;
        state.review_at = review.next.map_or(latest, |next| next.min(latest));
    }

    fn waited_for(&self) -> String {
        with_reason(format!("a message on {}", self.common.endpoint), self.link())
    }
}
