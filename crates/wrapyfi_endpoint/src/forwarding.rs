//! The parts of a listener and a publisher that only routes need: what publishers keep for later listeners goes along.
//!
//! ```text
//!   Listener ── forwarding() ──▶ ForwardingListener     discard_except_latched, ended_publisher, durability
//!                                       │
//!   Publisher ─ forwarding() ──▶ ForwardingPublisher    forward, forget, forget_all, follow_source
//! ```
//!
//! A middleware whose publishers keep nothing implements neither.

use super::{Published, SampleOrigin, SourceDurability};
use wrapyfi_data::types::Payload;

/// The listener of a route whose publishers may keep their last message for listeners that come later (transient local,
/// latched), as [`Listener::forwarding`](super::Listener::forwarding) returns it.
///
/// ```
/// use std::error::Error;
/// use wrapyfi_endpoint::{Listener, Publisher};
///
/// /// Hands on what waits, with the publisher that it comes from, and then those that have gone.
/// fn hand_on(from: &mut dyn Listener, to: &mut dyn Publisher) -> Result<(), Box<dyn Error>> {
///     while let Some(sample) = from.take()? {
///         match to.forwarding() {
///             Some(to) => to.forward(&sample.payload, sample.origin)?,
///             None => to.publish(&sample.payload)?,
///         };
///     }
///     let (Some(from), Some(to)) = (from.forwarding(), to.forwarding()) else { return Ok(()) };
///     while let Some(gone) = from.ended_publisher() {
///         to.forget(gone);
///     }
///     to.follow_source(from.durability());
///     Ok(())
/// }
/// # use wrapyfi_data::types::{MessageType, Value};
/// # use wrapyfi_endpoint::{Context, Middleware, TopicSpec, memory::Memory};
/// # let (bus, context) = (Memory::new("memory"), Context::default());
/// # let open = |topic| TopicSpec::new(topic, MessageType::NativeObject);
/// # let mut first = bus.open_publisher(&open("/in"), &context)?;
/// # let mut from = bus.open_listener(&open("/in"), &context)?;
/// # let mut to = bus.open_publisher(&open("/out"), &context)?;
/// # let mut last = bus.open_listener(&open("/out"), &context)?;
/// # first.publish(&Value::from(5).into())?;
/// # hand_on(from.as_mut(), to.as_mut())?;
/// # assert_eq!(last.take()?.map(|sample| sample.payload), Some(Value::from(5).into()));
/// # Ok::<(), Box<dyn Error>>(())
/// ```
pub trait ForwardingListener {
    /// Passes over the next message unread, because the route does not want it yet; number of messages lost by
    /// that, `None` when none waits. This listener keeps the newest of each publisher that keeps
    /// its last for later listeners, and [`Listener::take`](super::Listener::take) returns those
    /// first.
    fn discard_except_latched(&mut self) -> Option<u64>;

    /// Number ([`SampleOrigin::publisher`]) of a publisher that kept its last message and has ended, was
    /// killed, or is out of reach. Each is returned once, after its last message was taken; `None`
    /// when there is no further one.
    fn ended_publisher(&mut self) -> Option<u64>;

    /// Extent to which its publishers keep their last message for listeners that come later.
    fn durability(&self) -> SourceDurability;
}

/// The publisher of a route that keeps the last message of each origin for listeners that come later, as
/// [`Publisher::forwarding`](super::Publisher::forwarding) returns it. An example is at [`ForwardingListener`].
pub trait ForwardingPublisher {
    /// Publishes a message of a known origin. A publisher that keeps messages keeps the last one of each origin that
    /// does so too, until [`ForwardingPublisher::forget`].
    ///
    /// # Errors
    /// As [`Publisher::publish`](super::Publisher::publish).
    fn forward(&mut self, payload: &Payload, origin: Option<SampleOrigin>) -> Published;

    /// Drops the last message of an origin that has gone, so that later listeners do not get it.
    fn forget(&mut self, publisher: u64);

    /// Drops the last messages of all origins, because the source that numbers them was closed.
    fn forget_all(&mut self);

    /// Takes [`ForwardingListener::durability`] of the source, now and again. A publisher that was opened with
    /// [`TopicSpec::match_peers`](super::TopicSpec::match_peers) offers the same durability.
    fn follow_source(&mut self, source: SourceDurability);
}
