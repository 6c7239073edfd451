//! The way out of one value: a publisher, shared by all callers.
//!
//! ```text
//!   call ── does anybody listen? an atomic, kept by the runtime ──▶ no: counted, that is all
//!             └─ yes ─▶ payload ─▶ publisher, on the caller's thread
//! ```

use std::sync::atomic::{AtomicBool, Ordering::SeqCst};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::bell::{Bell, Look};
use super::error::CallError;
use super::inlet::Manners;
use super::rules::Rules;
use super::runtime::Runtime;
use super::wait::Patience;
use crate::endpoint::{Counters, DropReason, EndpointAddress, Link, PublishError, Publisher};
use crate::types::Payload;

/// Shortest time between two lines about messages that were not sent.
const SAY_EVERY: Duration = Duration::from_secs(5);

pub(super) struct Outlet {
    pub(super) endpoint: EndpointAddress,
    pub(super) rules: Rules,
    pub(super) counters: Arc<Counters>,
    pub(super) timeout: Option<Duration>,
    /// Its messages are messages of ROS, where none comes without a time.
    pub(super) in_ros: bool,
    /// Nothing need be sent: nobody listens, and nothing is kept for later.
    is_idle: AtomicBool,
    /// The first listener was there, or nobody waits for it.
    is_established: AtomicBool,
    /// Rung when the link changes.
    changed: Bell,
    state: Mutex<State>,
}

struct State {
    publisher: Box<dyn Publisher>,
    say_at: Instant,
}

impl Outlet {
    pub(super) fn new(
        endpoint: EndpointAddress,
        publisher: Box<dyn Publisher>,
        counters: Arc<Counters>,
        manners: Manners,
        in_ros: bool,
    ) -> Self {
        let outlet = Self {
            endpoint,
            rules: manners.rules,
            counters,
            timeout: manners.timeout,
            in_ros,
            is_idle: AtomicBool::new(false),
            is_established: AtomicBool::new(!manners.should_wait),
            changed: Bell::default(),
            state: Mutex::new(State { publisher, say_at: Instant::now() }),
        };
        outlet.look(Instant::now());
        outlet
    }

    /// True where a message would go nowhere. Costs one load.
    pub(super) fn is_idle(&self) -> bool {
        self.is_idle.load(SeqCst)
    }

    /// Counts what was not sent because nobody listens.
    pub(super) fn skip(&self) {
        self.counters.dropped(DropReason::NoConsumer);
    }

    /// Sends, or counts why not. What the transport does not take is no fault of the caller.
    ///
    /// # Errors
    /// When the payload has no form on the wire.
    pub(super) fn send(&self, payload: &Payload) -> Result<(), PublishError> {
        let started = Instant::now();
        let mut state = self.lock();
        match state.publisher.publish(payload) {
            Ok(bytes) => {
                self.counters.sent(bytes, started.elapsed());
                Ok(())
            }
            Err(error @ PublishError::Encode(_)) => {
                self.counters.dropped(error.drop_reason());
                Err(error)
            }
            Err(error) => {
                self.counters.dropped(error.drop_reason());
                let is_news = !matches!(error, PublishError::NoConsumer { .. });
                if is_news && started >= state.say_at {
                    tracing::warn!("a message to {} was not sent: {error}", self.endpoint);
                    state.say_at = started + SAY_EVERY;
                }
                Ok(())
            }
        }
    }

    /// Takes note of who listens; when to do it again.
    pub(super) fn look(&self, now: Instant) -> Option<Instant> {
        let (review, link) = {
            let mut state = self.lock();
            let review = state.publisher.review(now);
            (review, state.publisher.link())
        };
        for warning in &review.warnings {
            tracing::warn!("{}: {warning}", self.endpoint);
        }
        self.note(&link);
        self.changed.ring();
        review.next
    }

    fn note(&self, link: &Link) {
        let is_open = is_open(link);
        self.is_idle.store(!is_open && !link.keeps_last, SeqCst);
        if is_open {
            self.is_established.store(true, SeqCst);
        }
    }

    /// Waits for the first listener, where it is to be waited for.
    pub(super) fn await_listener(&self, patience: &mut Patience<'_>) -> Result<(), CallError> {
        self.changed.wait(patience, || self.waited_for(), || self.established())
    }

    /// The same for a task.
    pub(super) async fn await_listener_async(
        &self,
        patience: &mut Patience<'_>,
        runtime: &Runtime,
    ) -> Result<(), CallError> {
        let waited_for = || self.waited_for();
        self.changed.wait_async(patience, runtime, waited_for, || self.established()).await
    }

    fn established(&self) -> Look<()> {
        if self.is_established() { Look::Found(()) } else { Look::Again(None) }
    }

    /// True where the first call may go on at once.
    pub(super) fn is_established(&self) -> bool {
        self.is_established.load(SeqCst)
    }

    /// Has those who wait look.
    pub(super) fn ring(&self) {
        self.changed.ring();
    }

    /// What it is connected to now; sends follow it from here on.
    pub(super) fn link(&self) -> Link {
        let link = self.lock().publisher.link();
        self.note(&link);
        link
    }

    fn waited_for(&self) -> String {
        let what = format!("a listener of {}", self.endpoint);
        match self.link().waiting_for {
            Some(reason) => format!("{what} ({reason})"),
            None => what,
        }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// True when what is sent now arrives somewhere, as far as the transport knows.
fn is_open(link: &Link) -> bool {
    match link.peers {
        Some(peers) => peers > 0,
        None => link.waiting_for.is_none(),
    }
}
