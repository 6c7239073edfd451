//! A subscription to serialised messages.

#![allow(unsafe_code, reason = "subscriptions of rmw are structs of C")]

use std::ptr;
use std::sync::Arc;

use bytes::Bytes;

use super::dispatch::{Callback, call};
use super::endpoint::gid;
use super::event::{Events, Source};
use super::node::{Inner, Node};
use super::own::Kind;
use super::{EndpointType, EventCounts, Fault, Gid, Notify, TypeInfo, c_text, qos, sys, types};
use wrapyfi_endpoint::Qos;

/// Takes serialised messages of one topic.
pub struct Subscription {
    /// Dropped before the subscription is destroyed.
    events: Option<Events>,
    raw: *mut sys::rmw_subscription_t,
    topic: String,
    kind: Kind,
    node: Arc<Inner>,
    _on_message: Callback,
}

// SAFETY: rmw takes from any thread; the pointer is this value's alone.
unsafe impl Send for Subscription {}

/// A message that was taken.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Message {
    /// Encapsulation header and body, in the buffer that the middleware filled.
    pub bytes: Bytes,
    /// Time at which it was published, in nanoseconds since 1970.
    pub source_timestamp_ns: i64,
    /// Identity of its publisher.
    pub publisher: Gid,
}

/// Outcome of [`Subscription::take`].
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Taken {
    /// Nothing: no message waits.
    Nothing,
    /// The next message.
    Message(Message),
    /// The next message had so many bytes, more than the limit: it is gone.
    TooLarge(usize),
}

/// Memory that rmw allocates for a message.
pub(crate) struct Buffer(pub(crate) sys::rmw_serialized_message_t);

// SAFETY: the memory is this value's alone.
unsafe impl Send for Buffer {}
// SAFETY: nothing is written to it any more.
unsafe impl Sync for Buffer {}

impl AsRef<[u8]> for Buffer {
    fn as_ref(&self) -> &[u8] {
        if self.0.buffer.is_null() {
            return &[];
        }
        // SAFETY: rmw has written so many bytes.
        unsafe { std::slice::from_raw_parts(self.0.buffer, self.0.buffer_length) }
    }
}

impl Buffer {
    /// No bytes yet, and the allocator with which rmw enlarges it.
    pub(crate) fn new() -> Self {
        // SAFETY: structs of values, by value.
        unsafe {
            let mut empty = sys::rcutils_get_zero_initialized_uint8_array();
            empty.allocator = sys::rcutils_get_default_allocator();
            Self(empty)
        }
    }
}

impl Drop for Buffer {
    fn drop(&mut self) {
        // SAFETY: allocated by the allocator that it names, or null.
        let code = unsafe { sys::rcutils_uint8_array_fini(&raw mut self.0) };
        if code != 0 {
            tracing::debug!(code, "a buffer was not freed");
        }
    }
}

impl Node {
    /// Creates a subscription to any type; topics are named as for [`Node::publisher`]. This node's own messages are
    /// heard if `hears_own` is true. `on_event` is called when a message waits, when publishers come and go, and for
    /// events of quality of service.
    ///
    /// # Errors
    /// When rmw refuses; the reason is its own.
    pub fn subscription(
        &self,
        topic: &str,
        of: &TypeInfo<'_>,
        qos: &Qos,
        hears_own: bool,
        on_event: &Notify,
    ) -> Result<Subscription, Fault> {
        let support = types::message(of)?;
        let name = c_text("rmw_create_subscription", topic)?;
        let node = Arc::clone(&self.0);
        let making = node.making();
        // SAFETY: the node lives, the type support lives as long as the process, and rmw copies the rest.
        let raw = unsafe {
            let mut options = sys::rmw_get_default_subscription_options();
            options.ignore_local_publications = !hears_own;
            let profile = qos::to_rmw(qos, topic);
            sys::rmw_create_subscription(
                node.node(),
                support.0,
                name.as_ptr(),
                &raw const profile,
                &raw const options,
            )
        };
        if raw.is_null() {
            return Err(Fault::last("rmw_create_subscription"));
        }
        drop(making);
        let on_message = node.dispatch().callback(Arc::clone(on_event), None);
        let user_data = on_message.user_data();
        let events = Events::new(Source::Subscription(raw), node.dispatch(), Arc::clone(on_event));
        let kind = Kind { type_name: of.name.to_owned(), qos: (*qos).into() };
        node.own().add(topic, EndpointType::Subscriptions, &kind);
        let topic = topic.to_owned();
        let made =
            Subscription { events: Some(events), raw, topic, kind, node, _on_message: on_message };
        // SAFETY: the callback lives as long as the subscription, which takes it back on drop.
        let code = unsafe {
            sys::rmw_subscription_set_on_new_message_callback(raw, Some(call), user_data)
        };
        Fault::check("rmw_subscription_set_on_new_message_callback", code)?;
        Ok(made)
    }
}

impl Subscription {
    /// The next message of another node, if one waits.
    ///
    /// # Errors
    /// When rmw refuses.
    pub fn take(&self, max_bytes: usize) -> Result<Taken, Fault> {
        loop {
            // SAFETY: a struct of values, by value.
            let mut info = unsafe { sys::rmw_get_zero_initialized_message_info() };
            let mut buffer = Buffer::new();
            let mut taken = false;
            // SAFETY: the subscription lives; rmw allocates what the message needs.
            let code = unsafe {
                sys::rmw_take_serialized_message_with_info(
                    self.raw,
                    &raw mut buffer.0,
                    &raw mut taken,
                    &raw mut info,
                    ptr::null_mut(),
                )
            };
            Fault::check("rmw_take_serialized_message_with_info", code)?;
            if !taken {
                return Ok(Taken::Nothing);
            }
            let publisher = gid(&info.publisher_gid.data);
            // Not every middleware ignores our own where messages are taken as bytes.
            if self.node.own().gids.contains(&publisher) {
                continue;
            }
            let bytes = buffer.0.buffer_length;
            if bytes > max_bytes {
                return Ok(Taken::TooLarge(bytes));
            }
            return Ok(Taken::Message(Message {
                bytes: Bytes::from_owner(buffer),
                source_timestamp_ns: info.source_timestamp,
                publisher,
            }));
        }
    }

    /// Number of publishers of other nodes that are matched now.
    pub fn matched(&self) -> usize {
        let mut count = 0;
        // SAFETY: the subscription lives.
        let code =
            unsafe { sys::rmw_subscription_count_matched_publishers(self.raw, &raw mut count) };
        Fault::check("rmw_subscription_count_matched_publishers", code).map_or(0, |()| {
            count.saturating_sub(self.node.own().matching(
                &self.topic,
                EndpointType::Subscriptions,
                &self.kind,
            ))
        })
    }

    /// Numbers of events so far.
    pub fn events(&self) -> EventCounts {
        self.events.as_ref().map(Events::counts).unwrap_or_default()
    }
}

impl Drop for Subscription {
    fn drop(&mut self) {
        // SAFETY: after this no thread calls the callback: middlewares hold the lock under which they call.
        let code = unsafe {
            sys::rmw_subscription_set_on_new_message_callback(self.raw, None, ptr::null())
        };
        if let Err(fault) = Fault::check("rmw_subscription_set_on_new_message_callback", code) {
            tracing::debug!(%fault, "a callback was not taken back");
        }
        drop(self.events.take());
        self.node.own().remove(&self.topic, EndpointType::Subscriptions, &self.kind);
        let _making = self.node.making();
        // SAFETY: made by this node, and not used any more.
        let code = unsafe { sys::rmw_destroy_subscription(self.node.node(), self.raw) };
        if let Err(fault) = Fault::check("rmw_destroy_subscription", code) {
            tracing::warn!(%fault, "a subscription was not destroyed");
        }
    }
}
