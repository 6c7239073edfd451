//! A topic that this node publishes, of one type: its publishers here, its subscribers elsewhere.
//!
//! ```text
//!   Ros1Publisher ┐                        ┌▶ Outlet ─▶ subscriber
//!   Ros1Publisher ┴─▶ Publication ─────────┴▶ Outlet ─▶ subscriber
//!                       └ latched: the last message of each publisher, for who comes later
//! ```

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::io::AsyncWriteExt as _;
use wrapyfi_interfaces::ros1::Plan;

use super::core::Core;
use super::form;
use super::header::Header;
use super::intake::MARK;
use super::marks::Marked;
use super::outlet::{Frame, Outlet};
use super::slave_info::BusLink;
use super::tcpros::Accepted;
use crate::codec::ros1::Ros1Type;
use crate::endpoint::{
    BridgeMark, Context, Counters, Durability, History, Link, PublishError, Publisher, Role,
    TopicSpec, Wake,
};
use crate::types::{Encoding, MessageType, Payload, Pixels};
use crate::{EncodeError, Limits, codec};

/// Messages that a publisher without a depth keeps for a slow subscriber.
const KEEP_ALL: usize = 1000;

pub(super) struct Publication {
    topic: String,
    wire_type: Ros1Type,
    /// That a bridge made it by pattern.
    mark: Option<BridgeMark>,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    publishers: BTreeMap<u64, Entry>,
    outlets: Vec<Arc<Outlet>>,
    closed: bool,
}

/// One publisher of this node.
struct Entry {
    latches: bool,
    last: Option<Frame>,
    depth: usize,
    counters: Arc<Counters>,
    wake: Wake,
}

impl Publication {
    pub(super) fn new(topic: &str, wire_type: Ros1Type, mark: Option<BridgeMark>) -> Self {
        Self { topic: topic.to_owned(), wire_type, mark, state: Mutex::default() }
    }

    pub(super) fn topic(&self) -> &str {
        &self.topic
    }

    pub(super) fn wire_type(&self) -> &Ros1Type {
        &self.wire_type
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// True while somebody here publishes.
    pub(super) fn in_use(&self) -> bool {
        !self.state().publishers.is_empty()
    }

    /// The bells of its publishers.
    pub(super) fn wakes(&self) -> Vec<Wake> {
        self.state().publishers.values().map(|entry| entry.wake.clone()).collect()
    }

    fn ring(&self) {
        self.wakes().iter().for_each(Wake::ring);
    }

    /// Its connections, for the slave API.
    pub(super) fn links(&self) -> Vec<BusLink> {
        self.state().outlets.iter().map(|outlet| outlet.link()).collect()
    }

    /// Ends its connections when what is queued is sent.
    pub(super) fn close(&self) {
        let mut state = self.state();
        state.closed = true;
        state.outlets.iter().for_each(|outlet| outlet.finish());
    }

    fn subscribers(&self) -> usize {
        self.state().outlets.len()
    }

    /// Sends to all subscribers; how many there are.
    fn send(&self, publisher: u64, frame: &Frame) -> usize {
        let mut state = self.state();
        let State { publishers, outlets, .. } = &mut *state;
        let Some(entry) = publishers.get_mut(&publisher) else { return 0 };
        if entry.latches {
            entry.last = Some(frame.clone());
        }
        for outlet in outlets.iter() {
            outlet.push(frame, entry.depth, &entry.counters);
        }
        outlets.len()
    }

    /// Serves a subscriber until either end closes.
    pub(super) async fn serve(&self, accepted: Accepted, core: &Arc<Core>) {
        let Accepted { mut stream, header, peer, place } = accepted;
        let caller = header.get("callerid").unwrap_or("(unnamed)").to_owned();
        let asked = header.get("type").unwrap_or("*");
        if asked != "*" && asked != self.wire_type.name && header.get("md5sum") != Some("*") {
            // The same fields under another name: usable, and odd.
            tracing::debug!(
                topic = self.topic,
                "ROS 1: {caller} calls the type {asked}, which is {} here",
                self.wire_type.name
            );
        }
        let latches = self.state().publishers.values().any(|entry| entry.latches);
        let own = Header::new()
            .with("callerid", core.name.full())
            .with("topic", &self.topic)
            .with("type", &self.wire_type.name)
            .with("md5sum", &self.wire_type.md5)
            .with("message_definition", &self.wire_type.definition)
            .with("latching", if latches { "1" } else { "0" });
        let own = match &self.mark {
            Some(mark) => own.with(MARK, &mark.to_string()),
            None => own,
        };
        let Ok(own) = own.encode() else { return };
        if stream.write_all(&own).await.is_err() {
            return;
        }
        let lingers = core.lingering.begin();
        let outlet = Arc::new(Outlet::new(core.next_id(), &caller, peer.to_string(), stream));
        if !self.enter(&outlet) {
            return;
        }
        tracing::debug!(topic = self.topic, "ROS 1: {caller} subscribes");
        self.ring();
        outlet.run().await;
        self.state().outlets.retain(|one| !Arc::ptr_eq(one, &outlet));
        self.ring();
        drop((place, lingers));
    }

    /// Lets a subscriber in: it gets what is kept first, and then every message.
    fn enter(&self, outlet: &Arc<Outlet>) -> bool {
        let mut state = self.state();
        if state.closed {
            return false;
        }
        for entry in state.publishers.values() {
            if let Some(last) = &entry.last {
                outlet.push(last, KEEP_ALL, &entry.counters);
            }
        }
        state.outlets.push(Arc::clone(outlet));
        true
    }
}

/// Sends to one topic.
pub(super) struct Ros1Publisher {
    id: u64,
    core: Arc<Core>,
    publication: Arc<Publication>,
    spec: TopicSpec,
    plan: Option<Plan>,
    sequence: u32,
    latches: bool,
    marked: Option<Marked>,
}

impl Ros1Publisher {
    pub(super) fn open(
        core: &Arc<Core>,
        topic: &str,
        (wire_type, plan): (Ros1Type, Option<Plan>),
        spec: &TopicSpec,
        context: &Context,
    ) -> Self {
        let md5 = wire_type.md5.clone();
        let latches = spec.qos.durability == Durability::TransientLocal;
        let depth = match spec.qos.history {
            History::KeepLast(depth) => usize::try_from(depth).unwrap_or(KEEP_ALL),
            History::KeepAll => KEEP_ALL,
        };
        let id = core.next_id();
        let entry = Entry {
            latches,
            last: None,
            depth,
            counters: Arc::clone(&context.counters),
            wake: context.wake.clone(),
        };
        let publication = core.advertise(
            topic,
            &md5,
            || Publication::new(topic, wire_type, spec.mark.clone()),
            |publication| {
                publication.state().publishers.insert(id, entry);
            },
        );
        let marked = spec.mark.clone().map(|mark| Marked {
            role: Role::Publisher,
            name: topic.to_owned(),
            node: core.name.full().to_owned(),
            mark,
        });
        if let Some(marked) = &marked {
            core.mark(marked);
        }
        let (core, spec, sequence) = (Arc::clone(core), spec.clone(), 0);
        Self { id, core, publication, spec, plan, sequence, latches, marked }
    }

    fn encode(&mut self, payload: &Payload) -> Result<Frame, EncodeError> {
        let pieces = form::encode(payload, self.plan.as_ref(), self.sequence, &self.spec)?;
        self.sequence = self.sequence.wrapping_add(1);
        let size: usize = pieces.iter().map(bytes::Bytes::len).sum();
        let (actual, limit) = (size as u64, u64::from(u32::MAX));
        Frame::new(pieces).ok_or(EncodeError::TooLarge { actual, limit })
    }
}

/// The payload in the form that the type carries: pixels, or a file.
pub(super) fn formed<'p>(
    payload: &'p Payload,
    message_type: MessageType,
    color_order: Encoding,
    limits: &Limits,
) -> Result<Cow<'p, Payload>, EncodeError> {
    let Payload::Image(image) = payload else { return Ok(Cow::Borrowed(payload)) };
    let fits = match message_type {
        MessageType::Image => matches!(image.pixels, Pixels::Raw(_)),
        MessageType::CompressedImage => matches!(image.pixels, Pixels::Compressed { .. }),
        _ => true,
    };
    if fits {
        return Ok(Cow::Borrowed(payload));
    }
    let image = codec::convert(image.clone(), message_type, color_order, limits)?;
    Ok(Cow::Owned(Payload::Image(image)))
}

impl Publisher for Ros1Publisher {
    /// While nobody subscribes nothing is encoded, unless the last message is kept.
    fn publish(&mut self, payload: &Payload) -> Result<usize, PublishError> {
        if !self.latches && self.publication.subscribers() == 0 {
            return Err(PublishError::NoConsumer { topic: self.spec.topic.clone() });
        }
        let frame = self.encode(payload)?;
        let bytes = frame.len();
        let reached = self.publication.send(self.id, &frame);
        if reached == 0 && !self.latches {
            return Err(PublishError::NoConsumer { topic: self.spec.topic.clone() });
        }
        Ok(bytes)
    }

    fn link(&self) -> Link {
        let peers = self.publication.subscribers();
        let waiting_for = (peers == 0).then(|| {
            let nobody = || format!("a ROS 1 node that subscribes to {}", self.publication.topic);
            self.core.fault().unwrap_or_else(nobody)
        });
        Link { peers: Some(peers), waiting_for, keeps_last: self.latches }
    }
}

impl Drop for Ros1Publisher {
    fn drop(&mut self) {
        self.publication.state().publishers.remove(&self.id);
        if let Some(marked) = &self.marked {
            self.core.unmark(marked);
        }
        self.core.unadvertise(&self.publication.topic, &self.publication);
    }
}
