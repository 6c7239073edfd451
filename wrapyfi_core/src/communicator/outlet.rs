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
        let mut state = self.lock();
        let review = state.publisher.review(now);
        self.note(&state);
        drop(state);
        for warning in &review.warnings {
            tracing::warn!("{}: {warning}", self.endpoint);
        }
        self.changed.ring();
        review.next
    }

    /// Under the lock: of two who look at once the one that saw the newer link notes it last.
    fn note(&self, state: &State) -> Link {
        let link = state.publisher.link();
        let is_open = is_open(&link);
        self.is_idle.store(!is_open && !link.keeps_last, SeqCst);
        if is_open {
            self.is_established.store(true, SeqCst);
        }
        link
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
        self.note(&self.lock())
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

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicUsize;

    use super::super::option::Options;
    use super::*;
    use crate::endpoint::Review;

    /// Has this many listeners, and a warning at every look.
    struct Counting(Arc<AtomicUsize>);

    impl Publisher for Counting {
        fn publish(&mut self, _: &Payload) -> Result<usize, PublishError> {
            Ok(0)
        }

        fn link(&self) -> Link {
            Link { peers: Some(self.0.load(SeqCst)), ..Link::default() }
        }

        fn review(&mut self, _: Instant) -> Review {
            Review { warnings: vec!["somebody comes".to_owned()], ..Review::default() }
        }
    }

    /// A log that lets the first listener come, and somebody look at the link, at each line.
    struct Interrupting {
        peers: Arc<AtomicUsize>,
        outlet: Arc<Outlet>,
    }

    impl tracing::Subscriber for Interrupting {
        fn enabled(&self, _: &tracing::Metadata<'_>) -> bool {
            true
        }

        fn new_span(&self, _: &tracing::span::Attributes<'_>) -> tracing::span::Id {
            tracing::span::Id::from_u64(1)
        }

        fn record(&self, _: &tracing::span::Id, _: &tracing::span::Record<'_>) {}

        fn record_follows_from(&self, _: &tracing::span::Id, _: &tracing::span::Id) {}

        fn event(&self, _: &tracing::Event<'_>) {
            self.peers.store(1, SeqCst);
            assert_eq!(self.outlet.link().peers, Some(1));
        }

        fn enter(&self, _: &tracing::span::Id) {}

        fn exit(&self, _: &tracing::span::Id) {}
    }

    #[test]
    fn an_older_look_does_not_undo_a_newer_one() {
        let peers = Arc::new(AtomicUsize::new(0));
        let rules = Rules::from_options(&Options::default()).unwrap();
        let manners = Manners { should_wait: false, timeout: None, rules };
        let publisher = Box::new(Counting(Arc::clone(&peers)));
        let endpoint = "memory:/x".parse().unwrap();
        let outlet = Arc::new(Outlet::new(endpoint, publisher, Arc::default(), manners, false));
        assert!(outlet.is_idle());
        let log = Interrupting { peers, outlet: Arc::clone(&outlet) };
        // The look began before the listener came.
        tracing::subscriber::with_default(log, || outlet.look(Instant::now()));
        assert!(!outlet.is_idle(), "what is sent now would go nowhere");
    }
}
