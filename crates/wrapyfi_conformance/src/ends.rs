//! A publisher and a listener with what their owner does: waiting, counting what it takes.

use std::borrow::Borrow;
use std::time::{Duration, Instant};

use wrapyfi_data::types::Payload;
use wrapyfi_endpoint::{
    Context, CountersSnapshot, DropReason, Link, Listener, Middleware, PublishError, Publisher,
    TopicSpec, Wake,
};

use crate::{Testbed, WireEnd};

/// Longest time that a case waits for its condition: reached only by failures.
pub const TIMEOUT: Duration = Duration::from_secs(30);
/// Time between two looks at a condition that rings no bell.
const LOOK: Duration = Duration::from_millis(10);
/// Messages that may be on their way at once. Queues of the transports are longer, so that what
/// is sent with [`Source::send_all`] arrives even where they drop.
const WINDOW: usize = 4;

/// Waits until `condition` holds, looking whenever `wake` rings and now and then. `wake` is a
/// clone where `condition` borrows its owner.
///
/// # Panics
/// When it does not within [`TIMEOUT`].
#[track_caller]
pub fn wait_until(wake: impl Borrow<Wake>, what: &str, mut condition: impl FnMut() -> bool) {
    wait_for(wake, what, || condition().then_some(()));
}

/// As [`wait_until`], where no bell tells of a change.
#[track_caller]
pub fn until(what: &str, condition: impl FnMut() -> bool) {
    wait_until(Wake::new(), what, condition);
}

/// Waits until there is something; fails the test when it takes longer than [`TIMEOUT`].
#[track_caller]
pub fn wait_for<T>(wake: impl Borrow<Wake>, what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let deadline = Instant::now() + TIMEOUT;
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(Instant::now() < deadline, "waited {TIMEOUT:?} for {what}");
        wake.borrow().wait(LOOK);
    }
}

/// A publisher and its owner.
pub struct Source {
    /// The publisher.
    pub publisher: Box<dyn Publisher>,
    /// Context of the publisher.
    pub context: Context,
}

/// A listener and its owner, who counts errors as the engine does.
pub struct Sink {
    /// The listener.
    pub listener: Box<dyn Listener>,
    /// Context of the listener.
    pub context: Context,
    /// Messages taken.
    pub taken: u64,
}

impl Source {
    /// Opens a publisher.
    #[track_caller]
    pub fn open(middleware: &dyn Middleware, spec: &TopicSpec) -> Self {
        let context = Context::default();
        let publisher = middleware.open_publisher(spec, &context).unwrap();
        Self { publisher, context }
    }

    /// Publishes one message; the bytes that went out, none where there is no listener.
    #[track_caller]
    pub fn send(&mut self, payload: &Payload) -> usize {
        match self.publisher.publish(payload) {
            Err(PublishError::NoConsumer(_)) => 0,
            sent => sent.unwrap(),
        }
    }

    /// Publishes one message after the other, never further ahead of `sink` than transports queue.
    #[track_caller]
    pub fn send_all(&mut self, payloads: &[Payload], sink: &Sink) {
        let before = sink.counters().received;
        for (sent, payload) in payloads.iter().enumerate() {
            self.send(payload);
            let expected = before + (sent + 1).saturating_sub(WINDOW) as u64;
            wait_until(&sink.context.wake, "messages to arrive", || {
                sink.counters().received >= expected
            });
        }
        wait_until(&sink.context.wake, "the last messages to arrive", || {
            sink.counters().received >= before + payloads.len() as u64
        });
    }

    /// Waits until the publisher has a listener.
    #[track_caller]
    pub fn wait_for_listener(&self) {
        self.wait_for("a listener", |link| link.peers > Some(0) && link.waiting_for.is_none());
    }

    /// Waits until the publisher has no listener.
    #[track_caller]
    pub fn wait_for_nobody(&self) {
        self.wait_for("the listener to be gone", |link| link.peers == Some(0));
    }

    /// Waits until the link is as it should be.
    #[track_caller]
    pub fn wait_for(&self, what: &str, mut condition: impl FnMut(&Link) -> bool) {
        wait_until(&self.context.wake, what, || condition(&self.publisher.link()));
    }
}

impl Sink {
    /// Opens a listener.
    #[track_caller]
    pub fn open(middleware: &dyn Middleware, spec: &TopicSpec) -> Self {
        let context = Context::default();
        let listener = middleware.open_listener(spec, &context).unwrap();
        Self { listener, context, taken: 0 }
    }

    /// Counters so far.
    pub fn counters(&self) -> CountersSnapshot {
        self.context.counters.snapshot()
    }

    /// The next message, if one waits. One that cannot be used is counted and passed over.
    pub fn take(&mut self) -> Option<Payload> {
        loop {
            match self.listener.take() {
                Ok(sample) => {
                    self.taken += u64::from(sample.is_some());
                    return sample.map(|sample| sample.payload);
                }
                Err(error) => self.context.counters.dropped((&error).into()),
            }
        }
    }

    /// Waits for the next message.
    #[track_caller]
    pub fn receive(&mut self) -> Payload {
        wait_for(self.context.wake.clone(), "a message", || self.take())
    }

    /// Waits for `count` messages.
    #[track_caller]
    pub fn receive_many(&mut self, count: usize) -> Vec<Payload> {
        (0..count).map(|_| self.receive()).collect()
    }

    /// Everything that waits.
    pub fn drain(&mut self) -> Vec<Payload> {
        std::iter::from_fn(|| self.take()).collect()
    }

    /// Takes until every message that was received is taken or counted as dropped.
    #[track_caller]
    pub fn settle(&mut self) -> Vec<Payload> {
        let mut messages = Vec::new();
        wait_until(self.context.wake.clone(), "the counters to add up", || {
            messages.extend(self.drain());
            let now = self.counters();
            // A message that was lost before it came here was not received either.
            now.received == self.taken + now.dropped() - now.dropped_for(DropReason::LostUpstream)
        });
        messages
    }

    /// Waits until the link is as it should be.
    #[track_caller]
    pub fn wait_for(&self, what: &str, mut condition: impl FnMut(&Link) -> bool) {
        wait_until(&self.context.wake, what, || condition(&self.listener.link()));
    }
}

/// A publisher at `from` and a listener at the other side, ready to flow.
#[track_caller]
pub fn connect<R: Testbed>(testbed: &R, from: WireEnd, spec: &TopicSpec) -> (Source, Sink) {
    let sink = Sink::open(testbed.side(from.other()), spec);
    let source = Source::open(testbed.side(from), spec);
    ready::<R>(&source, &sink);
    (source, sink)
}

/// Waits until what `source` sends will arrive at `sink`.
#[track_caller]
pub(crate) fn ready<R: Testbed>(source: &Source, sink: &Sink) {
    source.wait_for_listener();
    sink.wait_for("the way to be open", |link| {
        link.waiting_for.is_none()
            && (!R::CAPABILITIES.listener_knows_peers || link.peers > Some(0))
    });
}

/// Messages or requests that were counted as unusable, for whatever reason.
pub(crate) fn unusable(counters: &CountersSnapshot) -> u64 {
    use DropReason::{Malformed, Mismatch, Nesting, Oversize};
    [Malformed, Nesting, Mismatch, Oversize].map(|reason| counters.dropped_for(reason)).iter().sum()
}
