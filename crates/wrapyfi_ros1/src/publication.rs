//! A topic that this node publishes, of one type: its publishers here, its subscribers elsewhere.
//!
//! ```text
//!   Ros1Publisher ┐                        ┌▶ Subscriber ─▶ subscriber
//!   Ros1Publisher ┴─▶ Publication ─────────┴▶ Subscriber ─▶ subscriber
//!                       └ Latched: for who comes later
//! ```

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use tokio::io::AsyncWriteExt as _;

use super::config::NAME;
use super::conversion::ANY;
use super::core::Core;
use super::header::{MARK, OFFER};
use super::subscriber::{BusLink, Frame, Subscriber};
use super::tcpros::Accepted;
use wrapyfi_endpoint::codec::ros1::Ros1Type;
use wrapyfi_endpoint::{
    Absent, BridgeMark, Cause, Counters, Latched, MAX_ORIGINS, Mutex, Peers, Role, Wake,
};

/// Messages that a publisher without a depth keeps for a slow subscriber.
pub(super) const KEEP_ALL: usize = 1000;

pub(super) struct Publication {
    pub(super) topic: String,
    pub(super) wire_type: Ros1Type,
    /// Mark of the bridge that made the publication by pattern.
    mark: Option<BridgeMark>,
    /// It is the status of an action that this node offers, or is about to; so too while it ends.
    is_offer: bool,
    state: Mutex<PublicationState>,
}

#[derive(Default)]
struct PublicationState {
    publishers: BTreeMap<u64, Entry>,
    subscribers: Vec<Arc<Subscriber>>,
    /// The last subscriber that wanted another type, and the type, unless one that fits came after it.
    misfit: Option<(String, String)>,
    closed: bool,
}

/// One publisher of this node.
pub(super) struct Entry {
    pub(super) latches: bool,
    /// The last message of each origin, `None` being the publisher itself. In ROS 1 each node keeps its own; a
    /// route keeps those of all nodes that publish at its other end.
    pub(super) kept: Latched<Option<u64>, Frame>,
    /// True once the log says that not all messages are kept.
    pub(super) warned: bool,
    pub(super) depth: usize,
    pub(super) counters: Arc<Counters>,
    pub(super) wake: Wake,
    /// Subscribers that may have its messages.
    pub(super) peers: Option<Peers>,
}

impl Entry {
    /// True for a subscriber that may have the publisher's messages.
    fn admits(&self, caller: &str, address: &str) -> bool {
        self.peers.as_ref().is_none_or(|peers| peers.admits(caller, address))
    }
}

impl Publication {
    pub(super) fn new(
        topic: &str,
        wire_type: Ros1Type,
        mark: Option<BridgeMark>,
        is_offer: bool,
    ) -> Self {
        Self { topic: topic.to_owned(), wire_type, mark, is_offer, state: Mutex::default() }
    }

    /// Enters a publisher. Subscribers whom it does not let in are cut off, because they would get its messages too.
    pub(super) fn add(&self, id: u64, entry: Entry) {
        let mut state = self.state.lock();
        for subscriber in &state.subscribers {
            if !entry.admits(&subscriber.peer, &subscriber.host()) {
                let (topic, peer) = (&self.topic, &subscriber.peer);
                let refused = Peers::refused(Peers::TO, topic, peer, &subscriber.host());
                entry.counters.refused_peer(refused);
                tracing::warn!(topic, peer, "ROS 1: a subscriber is not among to_peers any more");
                subscriber.cut();
            }
        }
        state.publishers.insert(id, entry);
    }

    pub(super) fn remove(&self, id: u64) {
        self.state.lock().publishers.remove(&id);
    }

    /// Changes what is known of a publisher.
    pub(super) fn change(&self, id: u64, change: impl FnOnce(&mut Entry)) {
        if let Some(entry) = self.state.lock().publishers.get_mut(&id) {
            change(entry);
        }
    }

    /// True while this program publishes.
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

    pub(super) fn subscribers(&self) -> usize {
        self.state.lock().subscribers.len()
    }

    /// Names of the subscribers' nodes.
    pub(super) fn callers(&self) -> BTreeSet<String> {
        self.state.lock().subscribers.iter().map(|subscriber| subscriber.peer.clone()).collect()
    }

    /// Subscriber that is waited for.
    pub(super) fn awaited(&self) -> Cause {
        let absent =
            Absent::new(Role::Listener, "a ROS 1 node that subscribes to", NAME, &self.topic);
        let ours = self.wire_type.name.clone();
        match self.state.lock().misfit.clone() {
            Some((peer, type_name)) if type_name == ours => {
                Cause::OtherDefinition { absent, peer, type_name }
            }
            Some((peer, theirs)) => Cause::Type { absent, peer: Some(peer), theirs, ours },
            None => Cause::Nobody(absent),
        }
    }

    /// Notes that a node wants another type.
    pub(super) fn misfits(&self, caller: &str, wanted: &str) {
        self.state.lock().misfit = Some((caller.to_owned(), wanted.to_owned()));
        self.ring();
    }

    /// Sends to all subscribers; how many there are.
    pub(super) fn send(&self, publisher: u64, frame: &Frame, keep: Keep) -> usize {
        let mut state = self.state.lock();
        let PublicationState { publishers, subscribers, .. } = &mut *state;
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
        let closed = entries.find(|entry| !entry.admits(caller, &address))?;
        let refused = Peers::refused(Peers::TO, &self.topic, caller, &address);
        closed.counters.refused_peer(refused.clone());
        Some(refused.who)
    }

    /// True where a subscriber is wanted that has no connection.
    pub(super) fn awaits(&self, subscriber: &str) -> bool {
        let state = self.state.lock();
        let has_it = state.subscribers.iter().any(|one| one.peer == subscriber);
        !state.closed && !state.publishers.is_empty() && !has_it
    }

    /// Serves a subscriber until either end closes; true where the connection was lost.
    pub(super) async fn serve(&self, accepted: Accepted, core: &Core) -> bool {
        let caller = accepted.caller().to_owned();
        let Accepted { mut stream, header, peer, place } = accepted;
        let asked = header.get("type").unwrap_or("*");
        // A subscriber of any type is a command that looks, `rostopic` or `wrapyfi why`.
        let is_typed = asked != "*";
        if is_typed && asked != self.wire_type.name && header.get("md5sum") != Some("*") {
            // The same fields under another name: usable, and odd.
            tracing::debug!(
                topic = self.topic,
                "ROS 1: {caller} calls the type {asked}, which is {} here",
                self.wire_type.name
            );
        }
        if self.wire_type.md5 == ANY {
            // It was asked for its type.
            let [name, md5, text] =
                ["type", "md5sum", "message_definition"].map(|it| header.get(it));
            if let (Some(name), Some(md5), Some(text)) = (name, md5, text)
                && let Err(error) = core.types().show(name, md5, text)
            {
                tracing::debug!(topic = self.topic, "ROS 1: {caller} shows no definition: {error}");
            }
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
        let own = if self.is_offer { own.with(OFFER, "1") } else { own };
        let Ok(own) = own.encode() else { return false };
        if stream.write_all(&own).await.is_err() {
            return false;
        }
        let lingers = core.lingering.subscribe();
        let caller_id = header.get("callerid").unwrap_or_default();
        let (id, names) = (core.next_id(), [caller.as_str(), caller_id]);
        let subscriber = Arc::new(Subscriber::new(id, names, peer, stream));
        if !self.enter(&subscriber) {
            return false;
        }
        tracing::debug!(topic = self.topic, "ROS 1: {caller} subscribes");
        if is_typed {
            self.state.lock().misfit = None;
        }
        self.ring();
        let is_lost = subscriber.run().await;
        self.state.lock().subscribers.retain(|one| !Arc::ptr_eq(one, &subscriber));
        self.ring();
        drop((place, lingers));
        is_lost
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
        // A node has one connection for a topic: it has lost the other, or is about to close it.
        let others = state.subscribers.extract_if(.., |one| one.is_same(subscriber));
        others.for_each(|other| other.finish());
        state.subscribers.push(Arc::clone(subscriber));
        true
    }
}

/// Rule by which a publication keeps a message for later subscribers: not at all, or as the last
/// one of a source.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Keep {
    No,
    LastOf(Option<u64>),
}
