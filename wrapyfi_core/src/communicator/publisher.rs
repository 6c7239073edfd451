//! The publisher of one value, shared by all callers.
//!
//! ```text
//!   call ── does a program listen? an atomic, kept by the runtime ──▶ no: counted, that is all
//!             └─ yes ─▶ payload ─▶ publisher, on the caller's thread
//! ```

use std::sync::atomic::{AtomicBool, Ordering::SeqCst};
use std::time::Instant;

use super::end::EndCommon;
use super::error::MethodError;
use super::notifier::LookResult;
use super::runtime::{Runtime, Watched};
use super::wait::{Wait, with_reason};
use wrapyfi_data::codec::Conversion;
use wrapyfi_data::types::Payload;
use wrapyfi_endpoint::{DropReason, Link, Mutex, PublishError, Publisher, Throttle};

pub(super) struct PublisherEnd {
    /// Its bell rings when the link changes.
    pub(super) common: EndCommon,
    /// Conversion of what the method returns to the type of the topic.
    pub(super) conversion: Conversion,
    /// True where messages are messages of ROS, which always have a time.
    pub(super) in_ros: bool,
    /// True while messages need not be sent, because there is no listener and none is kept for later.
    is_idle: AtomicBool,
    /// True once the first listener has come, or where no call waits for it.
    is_established: AtomicBool,
    state: Mutex<PublisherState>,
}

struct PublisherState {
    publisher: Box<dyn Publisher>,
    /// Throttle of lines about messages that were not sent.
    said: Throttle,
}

impl PublisherEnd {
    pub(super) fn new(
        common: EndCommon,
        publisher: Box<dyn Publisher>,
        conversion: Conversion,
        in_ros: bool,
    ) -> Self {
        let end = Self {
            is_established: AtomicBool::new(!common.should_wait),
            common,
            conversion,
            in_ros,
            is_idle: AtomicBool::new(false),
            state: Mutex::new(PublisherState { publisher, said: Throttle::default() }),
        };
        end.look(Instant::now());
        end
    }

    /// True while a message would reach no listener. It costs one atomic load.
    pub(super) fn is_idle(&self) -> bool {
        self.is_idle.load(SeqCst)
    }

    /// Counts a message that was not sent because there is no listener.
    pub(super) fn skip(&self) {
        self.common.counters.dropped(DropReason::NoConsumer);
    }

    /// Sends a message, or counts the reason that it was not sent. A message that the transport
    /// does not take is no fault of the caller.
    ///
    /// # Errors
    /// When the payload has no form on the wire.
    pub(super) fn send(&self, payload: &Payload) -> Result<(), PublishError> {
        let started = Instant::now();
        let mut state = self.state.lock();
        match state.publisher.publish(payload) {
            Ok(bytes) => {
                self.common.counters.sent(bytes, started.elapsed());
                Ok(())
            }
            Err(error @ PublishError::Encode(_)) => {
                self.common.counters.dropped(error.drop_reason());
                Err(error)
            }
            Err(error) => {
                self.common.counters.dropped(error.drop_reason());
                let is_news = !matches!(error, PublishError::NoConsumer(_));
                if is_news && state.said.pass(started).is_some() {
                    tracing::warn!("a message to {} was not sent: {error}", self.common.endpoint);
                }
                Ok(())
            }
        }
    }

    /// Notes the link. The caller holds the lock, so that of two looks at once the newer one is
    /// noted last.
    fn note(&self, state: &PublisherState) -> Link {
        let link = state.publisher.link();
        let is_open = is_open(&link);
        self.is_idle.store(!is_open && !link.keeps_last, SeqCst);
        if is_open {
            self.is_established.store(true, SeqCst);
        }
        link
    }

    /// Waits for the first listener, if the option `should_wait` is set, as [`Notifier::wait`].
    pub(super) async fn await_listener(
        &self,
        wait: &mut Wait<'_>,
        runtime: Option<&Runtime>,
    ) -> Result<(), MethodError> {
        self.common.notifier.wait(wait, runtime, || self.waited_for(), || self.established()).await
    }

    fn established(&self) -> LookResult<()> {
        let is_waited_for = !self.is_established() && !self.common.is_given_up();
        if is_waited_for { LookResult::Again(None) } else { LookResult::Found(()) }
    }

    /// True when a call need not wait for the first listener.
    pub(super) fn is_established(&self) -> bool {
        self.is_established.load(SeqCst)
    }

    /// Connection of the publisher now. Sends go by it from here on.
    pub(super) fn link(&self) -> Link {
        self.note(&self.state.lock())
    }

    fn waited_for(&self) -> String {
        with_reason(format!("a listener of {}", self.common.endpoint), self.link())
    }
}

impl Watched for PublisherEnd {
    /// Looks at the listeners.
    fn look(&self, now: Instant) -> Option<Instant> {
        let mut state = self.state.lock();
        let review = state.publisher.review(now);
        self.note(&state);
        drop(state);
        for warning in &review.warnings {
            tracing::warn!("{}: {warning}", self.common.endpoint);
        }
        self.common.notifier.ring();
        review.next
    }
}

/// True when a message that is sent now reaches a listener, as far as the transport knows.
fn is_open(link: &Link) -> bool {
    match link.peers {
        Some(peers) => peers > 0,
        None => link.waiting_for.is_none(),
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::AtomicUsize;

    use super::*;
    use wrapyfi_data::types::MessageType;
    use wrapyfi_endpoint::{Review, TopicSpec};

    /// Publisher with this many listeners, and a warning at every look.
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

    /// Log whose every line lets the first listener come, and looks at the link.
    struct Interrupting {
        peers: Arc<AtomicUsize>,
        end: Arc<PublisherEnd>,
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
            assert_eq!(self.end.link().peers, Some(1));
        }

        fn enter(&self, _: &tracing::span::Id) {}

        fn exit(&self, _: &tracing::span::Id) {}
    }

    #[test]
    fn an_older_look_does_not_undo_a_newer_one() {
        let peers = Arc::new(AtomicUsize::new(0));
        let common = EndCommon::of_test("memory:/x", false);
        let spec = TopicSpec::new("/x", MessageType::NativeObject);
        let publisher = Box::new(Counting(Arc::clone(&peers)));
        let end = Arc::new(PublisherEnd::new(common, publisher, spec.conversion(), false));
        assert!(end.is_idle());
        let log = Interrupting { peers, end: Arc::clone(&end) };
        // The look began before the listener came.
        tracing::subscriber::with_default(log, || end.look(Instant::now()));
        assert!(!end.is_idle(), "what is sent now would go nowhere");
    }
}
