//! A topic that this node publishes, of one type: its publishers here, its subscribers elsewhere.
//!
//! ```text
//!   Ros1Publisher ┐                        ┌▶ Subscriber ─▶ subscriber
//!   Ros1Publisher ┴─▶ Publication ─────────┴▶ Subscriber ─▶ subscriber
//!                       └ Latched: for who comes later
//! ```

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::sync::Arc;

use tokio::io::AsyncWriteExt as _;
use wrapyfi_interfaces::ros1::PairPlan;

use super::core::{Core, Mark};
use super::listener_connections::MARK;
use super::subscriber::{BusLink, Frame, Subscriber};
use super::tcpros::Accepted;
use super::{NAME, conversion};
use wrapyfi_data::types::{Encoding, Image, MessageType, Payload, Pixels};
use wrapyfi_data::{EncodeError, EncodeResult, Limits};
use wrapyfi_endpoint::codec::ros1::Ros1Type;
use wrapyfi_endpoint::{
    BridgeMark, Context, Counters, Durability, ForwardingPublisher, History, Latched, Link,
    MAX_ORIGINS, Mutex, OpenResult, Origin, Peers, PublishError, Published, Publisher, Role,
    SourceDurability, TopicSpec, Wake, codec,
};

/// Messages that a publisher without a depth keeps for a slow subscriber.
const KEEP_ALL: usize = 1000;

pub(super) struct Publication {
    pub(super) topic: String,
    pub(super) wire_type: Ros1Type,
    /// Mark of the bridge that made the publication by pattern.
    mark: Option<BridgeMark>,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    publishers: BTreeMap<u64, Entry>,
    subscribers: Vec<Arc<Subscriber>>,
    closed: bool,
}

/// One publisher of this node.
struct Entry {
    latches: bool,
    /// The last message of each origin, `None` being the publisher itself. In ROS 1 each node keeps its own; a
    /// route keeps those of all nodes that publish at its other end.
    kept: Latched<Option<u64>, Frame>,
    /// True once the log says that not all messages are kept.
    warned: bool,
    depth: usize,
    counters: Arc<Counters>,
    wake: Wake,
    /// Subscribers that may have its messages.
    peers: Option<Peers>,
}

impl Publication {
    pub(super) fn new(topic: &str, wire_type: Ros1Type, mark: Option<BridgeMark>) -> Self {
        Self { topic: topic.to_owned(), wire_type, mark, state: Mutex::default() }
    }

    /// True while somebody here publishes.
    pub(super) fn in_use(&self) -> bool {
        !self.state.lock().publishers.is_empty()
    }

    /// The bells of its publishers.
    pub(super) fn wakes(&self) -> Vec<Wake> {
        self.state.lock().publishers.values().map(|entry| entry.wake.clone()).collect()
    }

    fn ring(&self) {
        self.wakes().iter().for_each(Wake::ring);
    }

    /// Connections of the publication, for the slave API.
    pub(super) fn links(&self) -> Vec<BusLink> {
        self.state.lock().subscribers.iter().map(|subscriber| subscriber.link()).collect()
    }

    /// Ends its connections when what is queued is sent.
    pub(super) fn close(&self) {
        let mut state = self.state.lock();
        state.closed = true;
        state.subscribers.iter().for_each(|subscriber| subscriber.finish());
    }

    fn subscribers(&self) -> usize {
        self.state.lock().subscribers.len()
    }

    /// Sends to all subscribers; how many there are.
    fn send(&self, publisher: u64, frame: &Frame, keep: Keep) -> usize {
        let mut state = self.state.lock();
        let State { publishers, subscribers, .. } = &mut *state;
        let Some(entry) = publishers.get_mut(&publisher) else { return 0 };
        if let Keep::LastOf(origin) = keep {
            entry.kept.forget(&origin);
            let is_full = entry.kept.keep(origin, frame.clone()) > 0;
            if is_full && !std::mem::replace(&mut entry.warned, true) {
                tracing::warn!(
                    topic = self.topic,
                    "ROS 1: of the latched messages of many publishers the oldest are not kept: \
                     {MAX_ORIGINS} of together max_message_mib are the limit"
                );
            }
        }
        for subscriber in subscribers.iter() {
            subscriber.push(frame, entry.depth, &entry.counters);
        }
        subscribers.len()
    }

    /// Reason why a subscriber is refused: every publisher here must let it in, because it gets the messages of all.
    pub(super) fn refusal(&self, accepted: &Accepted) -> Option<String> {
        let (caller, address) = (accepted.caller(), accepted.peer.ip().to_string());
        let state = self.state.lock();
        let mut entries = state.publishers.values();
        let admits = |peers: &Peers| peers.admits(caller, &address);
        let closed = entries.find(|entry| !entry.peers.as_ref().is_none_or(admits))?;
        closed.counters.refused_peer();
        let topic = &self.topic;
        Some(format!("{caller} at {address} is not among to_peers of the route to {topic}"))
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
        let latches = self.state.lock().publishers.values().any(|entry| entry.latches);
        let own = core
            .header()
            .with("topic", &self.topic)
            .with("type", &self.wire_type.name)
            .with("md5sum", &self.wire_type.md5)
            .with("message_definition", &self.wire_type.definition)
            .with("latching", if latches { "1" } else { "0" });
        let own = match &self.mark {
            Some(mark) => own.with(MARK, mark.to_string()),
            None => own,
        };
        let Ok(own) = own.encode() else { return };
        if stream.write_all(&own).await.is_err() {
            return;
        }
        let lingers = core.lingering.subscribe();
        let subscriber =
            Arc::new(Subscriber::new(core.next_id(), &caller, peer.to_string(), stream));
        if !self.enter(&subscriber) {
            return;
        }
        tracing::debug!(topic = self.topic, "ROS 1: {caller} subscribes");
        self.ring();
        subscriber.run().await;
        self.state.lock().subscribers.retain(|one| !Arc::ptr_eq(one, &subscriber));
        self.ring();
        drop((place, lingers));
    }

    /// Lets a subscriber in: it gets what is kept first, and then every message.
    fn enter(&self, subscriber: &Arc<Subscriber>) -> bool {
        let mut state = self.state.lock();
        if state.closed {
            return false;
        }
        for entry in state.publishers.values() {
            for kept in entry.kept.messages() {
                subscriber.push(kept, KEEP_ALL, &entry.counters);
            }
        }
        state.subscribers.push(Arc::clone(subscriber));
        true
    }
}

/// Rule by which a publication keeps a message for later subscribers: not at all, or as the last
/// one of a source.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Keep {
    No,
    LastOf(Option<u64>),
}

/// Sends to one topic.
pub(super) struct Ros1Publisher {
    id: u64,
    core: Arc<Core>,
    publication: Arc<Publication>,
    spec: TopicSpec,
    plan: Option<PairPlan>,
    sequence: u32,
    /// True when the publisher was opened as one that latches, whatever it publishes.
    latches: bool,
    /// All that its source publishes is kept there.
    source_latches: bool,
    /// Told to other bridges while the publisher lives.
    _mark: Option<Mark>,
}

impl Ros1Publisher {
    pub(super) fn open(
        core: &Arc<Core>,
        topic: &str,
        (wire_type, plan): (Ros1Type, Option<PairPlan>),
        spec: &TopicSpec,
        context: &Context,
    ) -> OpenResult<Self> {
        let md5 = wire_type.md5.clone();
        let latches = spec.qos.durability == Durability::TransientLocal;
        let depth = match spec.qos.history {
            History::KeepLast(depth) => usize::try_from(depth).unwrap_or(KEEP_ALL),
            History::KeepAll => KEEP_ALL,
        };
        let id = core.next_id();
        let entry = Entry {
            latches,
            kept: Latched::new(spec.limits.message_bytes),
            warned: false,
            depth,
            counters: Arc::clone(&context.counters),
            wake: context.wake.clone(),
            peers: Peers::of(&spec.options, Peers::TO, NAME, topic)?,
        };
        let publication = core.advertise(
            topic,
            &md5,
            || Publication::new(topic, wire_type, spec.mark.clone()),
            |publication| {
                publication.state.lock().publishers.insert(id, entry);
            },
        );
        let mark = core.mark(Role::Publisher, topic, &spec.mark);
        let (core, spec, sequence) = (Arc::clone(core), spec.clone(), 0);
        Ok(Self {
            id,
            core,
            publication,
            spec,
            plan,
            sequence,
            latches,
            source_latches: false,
            _mark: mark,
        })
    }

    /// Changes what the publication knows of this publisher.
    fn change(&self, change: impl FnOnce(&mut Entry)) {
        if let Some(entry) = self.publication.state.lock().publishers.get_mut(&self.id) {
            change(entry);
        }
    }

    fn encode(&mut self, payload: &Payload) -> EncodeResult<Frame> {
        let pieces = conversion::encode(payload, self.plan.as_ref(), self.sequence, &self.spec)?;
        self.sequence = self.sequence.wrapping_add(1);
        let size: usize = pieces.iter().map(bytes::Bytes::len).sum();
        let (actual, limit) = (size as u64, u64::from(u32::MAX));
        Frame::new(pieces).ok_or(EncodeError::TooLarge { actual, limit })
    }

    /// While nobody subscribes nothing is encoded, unless it is kept.
    fn send(&mut self, payload: &Payload, keep: Keep) -> Published {
        if keep == Keep::No && self.publication.subscribers() == 0 {
            return Err(PublishError::NoConsumer { topic: self.spec.topic.clone() });
        }
        let frame = self.encode(payload)?;
        let reached = self.publication.send(self.id, &frame, keep);
        if reached == 0 && keep == Keep::No {
            return Err(PublishError::NoConsumer { topic: self.spec.topic.clone() });
        }
        Ok(frame.len())
    }
}

/// The payload in the form that the type carries: pixels, or a file. Wrapyfi's listeners take colour
/// as `bgr8` only, so pixels in the other order are turned, unless `color_order` asks for that order.
pub(super) fn fitted<'p>(
    payload: &'p Payload,
    message_type: MessageType,
    color_order: Encoding,
    limits: &Limits,
) -> EncodeResult<Cow<'p, Payload>> {
    let payload = codec::fitted(payload, message_type, color_order, limits)?;
    Ok(match &*payload {
        Payload::Image(image @ Image { pixels: Pixels::Raw(raw), .. })
            if (raw.encoding, color_order) == (Encoding::Rgb8, Encoding::Bgr8) =>
        {
            let pixels = Pixels::Raw(raw.clone().swap_red_blue());
            Cow::Owned(Payload::Image(Image { pixels, ..image.clone() }))
        }
        _ => payload,
    })
}

impl Publisher for Ros1Publisher {
    fn publish(&mut self, payload: &Payload) -> Published {
        let keep = if self.latches { Keep::LastOf(None) } else { Keep::No };
        self.send(payload, keep)
    }

    fn forwarding(&mut self) -> Option<&mut dyn ForwardingPublisher> {
        Some(self)
    }

    fn link(&self) -> Link {
        let peers = self.publication.subscribers();
        let waiting_for = (peers == 0).then(|| {
            let nobody = || format!("a ROS 1 node that subscribes to {}", self.publication.topic);
            self.core.fault().unwrap_or_else(nobody)
        });
        let keeps_last = self.latches || self.source_latches;
        Link { peers: Some(peers), waiting_for, keeps_last }
    }
}

impl ForwardingPublisher for Ros1Publisher {
    fn forward(&mut self, payload: &Payload, origin: Option<Origin>) -> Published {
        match origin {
            Some(Origin { publisher, keeps: 1.. }) if self.latches || self.spec.match_peers => {
                self.send(payload, Keep::LastOf(Some(publisher)))
            }
            _ => self.publish(payload),
        }
    }

    fn forget(&mut self, publisher: u64) {
        self.change(|entry| _ = entry.kept.forget(&Some(publisher)));
    }

    fn forget_all(&mut self) {
        self.change(|entry| entry.kept.retain(Option::is_none));
    }

    fn follow_source(&mut self, source: SourceDurability) {
        let keeps_last = match source {
            SourceDurability::All => true,
            SourceDurability::NotAll => false,
            // Publishers that are gone may come back as they were.
            SourceDurability::Unknown | SourceDurability::NoPublisher => return,
        };
        if !self.spec.match_peers || keeps_last == self.source_latches {
            return;
        }
        self.source_latches = keeps_last;
        self.change(|entry| entry.latches = self.latches || keeps_last);
    }
}

impl Drop for Ros1Publisher {
    fn drop(&mut self) {
        self.publication.state.lock().publishers.remove(&self.id);
        self.core.unadvertise(&self.publication.topic, &self.publication);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wrapyfi_data::types::RawPixels;

    fn encoding_of(pixels: RawPixels, color_order: Encoding) -> (Encoding, Vec<u8>) {
        let payload = Payload::Image(Image::new(wrapyfi_data::types::Stamp::default(), pixels));
        let payload =
            fitted(&payload, MessageType::Image, color_order, &Limits::default()).unwrap();
        let Payload::Image(Image { pixels: Pixels::Raw(raw), .. }) = payload.into_owned() else {
            panic!("pixels stay pixels");
        };
        (raw.encoding, raw.data.to_vec())
    }

    #[test]
    fn colour_is_as_wrapyfi_takes_it_unless_the_other_order_is_asked_for() {
        let pixel =
            |encoding, bytes: &[u8]| RawPixels::dense(1, 1, encoding, bytes.to_vec()).unwrap();
        let red = || pixel(Encoding::Rgb8, &[255, 1, 0]);
        assert_eq!(encoding_of(red(), Encoding::Bgr8), (Encoding::Bgr8, vec![0, 1, 255]));
        assert_eq!(encoding_of(red(), Encoding::Rgb8), (Encoding::Rgb8, vec![255, 1, 0]));
        let blue = || pixel(Encoding::Bgr8, &[255, 1, 0]);
        assert_eq!(encoding_of(blue(), Encoding::Rgb8), (Encoding::Bgr8, vec![255, 1, 0]));
        let grey = pixel(Encoding::Mono8, &[9]);
        assert_eq!(encoding_of(grey, Encoding::Bgr8), (Encoding::Mono8, vec![9]));
    }
}
