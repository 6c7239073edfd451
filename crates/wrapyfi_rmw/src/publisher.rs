//! A publisher of serialised messages.

#![allow(unsafe_code, reason = "publishers of rmw are structs of C")]

use std::sync::Arc;
use std::time::{Duration, Instant};

use wrapyfi_retry::Mutex;

use super::endpoint::gid;
use super::event::{Events, Source};
use super::node::{Inner, Node};
use super::own::Kind;
use super::{
    EndpointType, EventCounts, Fault, Gid, MATCH_SETTLES, Notify, SendFault, TypeInfo, c_text, qos,
    sys, types,
};
use wrapyfi_endpoint::{Qos, Reliability};

/// Publishes serialised messages on one topic.
pub struct Publisher {
    /// Dropped before the publisher is destroyed.
    events: Option<Events>,
    raw: *mut sys::rmw_publisher_t,
    gid: Gid,
    /// Buffer in which the pieces of a message are joined.
    joined: Vec<u8>,
    topic: String,
    kind: Kind,
    /// Time since which there is a subscription.
    matched_since: Arc<Mutex<Option<Instant>>>,
    node: Arc<Inner>,
}

// SAFETY: rmw publishes from any thread; the pointer is this value's alone.
unsafe impl Send for Publisher {}

impl Node {
    /// Creates a publisher of any type, for instance `sensor_msgs/msg/Image`. A topic that begins with no slash is one
    /// as the middleware spells it, for instance `rq/addRequest`. `on_event` is called when subscriptions
    /// come and go, and for events of quality of service.
    ///
    /// # Errors
    /// When rmw refuses; the reason is its own.
    pub fn publisher(
        &self,
        topic: &str,
        of: &TypeInfo<'_>,
        qos: &Qos,
        on_event: Notify,
    ) -> Result<Publisher, Fault> {
        let support = types::message(of)?;
        let name = c_text("rmw_create_publisher", topic)?;
        let node = Arc::clone(&self.0);
        let making = node.making();
        // SAFETY: the node lives, the type support lives as long as the process, and rmw copies the rest.
        let raw = unsafe {
            let options = sys::rmw_get_default_publisher_options();
            let profile = qos::to_rmw(qos, topic);
            sys::rmw_create_publisher(
                node.node(),
                support.0,
                name.as_ptr(),
                &raw const profile,
                &raw const options,
            )
        };
        if raw.is_null() {
            return Err(Fault::last("rmw_create_publisher"));
        }
        // SAFETY: a struct of values that rmw fills in.
        let own = unsafe {
            let mut own = sys::rmw_gid_t::default();
            let code = sys::rmw_get_gid_for_publisher(raw, &raw mut own);
            Fault::check("rmw_get_gid_for_publisher", code).map(|()| gid(&own.data))
        };
        drop(making);
        let kind = Kind { type_name: of.name.to_owned(), qos: (*qos).into() };
        node.own().add(topic, EndpointType::Publishers, &kind);
        let mut publisher = Publisher {
            events: None,
            raw,
            gid: Gid::default(),
            joined: Vec::new(),
            topic: topic.to_owned(),
            kind,
            matched_since: Arc::default(),
            node,
        };
        publisher.gid = own?;
        publisher.node.own().gids.insert(publisher.gid);
        let since = Arc::clone(&publisher.matched_since);
        let on_event = Arc::new(move || {
            let mut since = since.lock();
            since.get_or_insert_with(Instant::now);
            drop(since);
            on_event();
        });
        let dispatch = publisher.node.dispatch();
        publisher.events = Some(Events::new(Source::Publisher(raw), dispatch, on_event));
        Ok(publisher)
    }
}

impl Publisher {
    /// Publishes a message, given in pieces that are concatenated: encapsulation header first.
    ///
    /// # Errors
    /// The message was not sent.
    pub fn publish(&mut self, parts: &[&[u8]]) -> Result<(), SendFault> {
        let bytes: &[u8] = match parts {
            [one] => one,
            parts => {
                self.joined.clear();
                parts.iter().for_each(|part| self.joined.extend_from_slice(part));
                &self.joined
            }
        };
        // SAFETY: rmw reads the bytes until it returns, and writes none: the message is const.
        let code = unsafe {
            let message = sys::rmw_serialized_message_t {
                buffer: bytes.as_ptr().cast_mut(),
                buffer_length: bytes.len(),
                buffer_capacity: bytes.len(),
                allocator: sys::rcutils_get_default_allocator(),
            };
            sys::rmw_publish_serialized_message(self.raw, &raw const message, std::ptr::null_mut())
        };
        if code == sys::RMW_RET_TIMEOUT as sys::rmw_ret_t {
            _ = Fault::last("rmw_publish_serialized_message");
            return Err(SendFault::Timeout);
        }
        Ok(Fault::check("rmw_publish_serialized_message", code)?)
    }

    /// Number of subscriptions of other nodes that are matched now. The first one counts once it has been matched for
    /// [`MATCH_SETTLES`]; `on_event` is called then.
    pub fn matched(&self) -> usize {
        let mut count = 0;
        // SAFETY: the publisher lives.
        let code =
            unsafe { sys::rmw_publisher_count_matched_subscriptions(self.raw, &raw mut count) };
        let count = Fault::check("rmw_publisher_count_matched_subscriptions", code)
            .map_or(0, |()| count)
            .saturating_sub(self.node.own().matching(
                &self.topic,
                EndpointType::Publishers,
                &self.kind,
            ));
        let mut since = self.matched_since.lock();
        if count == 0 {
            *since = None;
            return 0;
        }
        let since = since.get_or_insert_with(Instant::now);
        if since.elapsed() < MATCH_SETTLES { 0 } else { count }
    }

    /// Numbers of events so far.
    pub fn events(&self) -> EventCounts {
        self.events.as_ref().map(Events::counts).unwrap_or_default()
    }

    /// Identity.
    pub fn gid(&self) -> Gid {
        self.gid
    }
}

/// Longest time that a publisher which ends waits for what it has sent to arrive.
const LINGERS: Duration = Duration::from_millis(500);

impl Publisher {
    /// Waits for acknowledgements: messages that lack them are lost with the publisher.
    fn wait_for_acknowledgements(&self) {
        let time = qos::time(Some(LINGERS));
        // SAFETY: the publisher lives.
        let code = unsafe { sys::rmw_publisher_wait_for_all_acked(self.raw, time) };
        if let Err(fault) = Fault::check("rmw_publisher_wait_for_all_acked", code) {
            tracing::debug!(%fault, topic = self.topic, "the last messages may be lost");
        }
    }
}

impl Drop for Publisher {
    fn drop(&mut self) {
        drop(self.events.take());
        let mut own = self.node.own();
        own.gids.remove(&self.gid);
        own.remove(&self.topic, EndpointType::Publishers, &self.kind);
        drop(own);
        if self.kind.qos.reliability == Reliability::Reliable {
            self.wait_for_acknowledgements();
        }
        let _making = self.node.making();
        // SAFETY: made by this node, and not used any more.
        let code = unsafe { sys::rmw_destroy_publisher(self.node.node(), self.raw) };
        if let Err(fault) = Fault::check("rmw_destroy_publisher", code) {
            tracing::warn!(%fault, "a publisher was not destroyed");
        }
    }
}
