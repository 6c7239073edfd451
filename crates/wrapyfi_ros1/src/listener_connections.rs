//! A topic that is received: one connection to each of its publishers.
//!
//! ```text
//!   publishers (master) ─ update ─▶ [ connection task … ] ─▶ inbox ─▶ Ros1Listener::take
//!     requestTopic ─▶ connect ─▶ header ─▶ messages ─▶ lost: back-off, again while it is listed
//! ```
//!
//! A publisher that the master no longer lists keeps its connection until it closes it, and is asked once
//! more then: a master that was restarted knows no node at first. Under policy `block` a task that finds no room stops
//! reading, and TCP holds its publisher back.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, OnceLock, Weak};
use std::time::{Duration, Instant};

use bytes::Bytes;
use tokio::net::TcpStream;
use tokio::sync::Notify;
use tokio::task::AbortHandle;
use tokio::time::timeout;
use wrapyfi_interfaces::ros1::PairPlan;

use super::config::NodeUri;
use super::core::Core;
use super::differences;
use super::header::{Header, MARK, OFFER};
use super::peer_types::{self, request_topic};
use super::splitter::{self, Piece, Splitter};
use super::subscriber::BusLink;
use super::xmlrpc::shortened;
use super::{conversion, tcpros};
use wrapyfi_data::types::MessageType;
use wrapyfi_endpoint::backoff::Backoff;
use wrapyfi_endpoint::codec::ros1::Ros1Type;
use wrapyfi_endpoint::restart::restarted;
use wrapyfi_endpoint::{
    BridgeMark, Cause, Counters, DropReason, Mutex, Named, PROGRESS, PeerFault, Peers as PeerList,
    Refused, Sender, Share, SourceDurability, Waits, Wake,
};

/// Most differences of definitions that are told of one topic.
const MAX_DIFFERENCES: usize = 64;
/// Most publishers of one topic.
const MAX_PUBLISHERS: usize = 256;
/// Longest time that the latched message of a publisher waits for room, whatever the queue's
/// policy: those of many publishers come at once, and none of them comes again.
const KEPT_WAITS: Duration = Duration::from_secs(1);

/// A message as it came.
#[derive(Debug)]
pub(super) struct Arrival {
    pub(super) message: Bytes,
    pub(super) received_at: Instant,
    /// Number of the publisher that sent it.
    pub(super) source: u64,
    /// True when the publisher sends its last message to new subscribers.
    pub(super) latched: bool,
    /// Plan that converts the message, where its type has no codec of its own.
    pub(super) plan: Option<PairPlan>,
}

impl Waits for Arrival {
    fn bytes(&self) -> usize {
        self.message.len()
    }
}

/// Type and size of the messages that a listener accepts.
pub(super) struct Wanted {
    pub(super) wire_type: Ros1Type,
    pub(super) message_type: MessageType,
    /// Largest message in bytes.
    pub(super) limit: usize,
    /// Publishers whose mark names this middleware are passed over.
    pub(super) ignore_through: Option<String>,
    /// Publishers that are heard; others are refused.
    pub(super) peers: Option<PeerList>,
}

pub(super) struct ListenerConnections {
    core: Weak<Core>,
    topic: String,
    wanted: Wanted,
    inbox: Sender<Arrival>,
    peers: Mutex<Peers>,
    /// Number among the listeners of this topic in the node, from 1.
    number: OnceLock<usize>,
}

#[derive(Default)]
struct Peers {
    by_uri: BTreeMap<NodeUri, Peer>,
    /// Publishers that latched, are gone, and were not told of.
    ended_publishers: Vec<u64>,
    closed: bool,
    /// Differences of the definitions of publishers, and the number of those that were told already.
    differences: (Vec<String>, usize),
}

/// A connected publisher as others see it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct OtherPublisher {
    /// Name of its node.
    pub(super) node: String,
    /// True where it is the status of an action that this library offers, or is about to.
    pub(super) is_offer: bool,
    /// True once a message has come.
    pub(super) has_sent: bool,
}

/// One publisher.
#[derive(Default)]
struct Peer {
    shared: Arc<ConnectionState>,
    /// The master names it.
    listed: bool,
    /// The socket at its end, while messages flow.
    address: Option<String>,
    /// Name of the node, as its header gave it last.
    caller: String,
    /// True when the publisher sends its last message to new subscribers.
    latches: bool,
    /// True where it is the status of an action of this library.
    is_offer: bool,
    /// Fault of the last try to connect.
    fault: Option<PeerFault>,
    task: Option<AbortHandle>,
    /// Last message of a publisher that latches: one that comes again with a new connection is no
    /// news.
    last: Option<(usize, u64)>,
}

/// State that the connection to a publisher shares with its task.
#[derive(Default)]
struct ConnectionState {
    id: u64,
    /// Signal that the master named the publisher again: it may have something new.
    again: Notify,
    messages: AtomicU64,
    bytes: AtomicU64,
}

impl ListenerConnections {
    pub(super) fn new(
        core: &Arc<Core>,
        topic: &str,
        wanted: Wanted,
        inbox: Sender<Arrival>,
    ) -> Arc<Self> {
        Arc::new(Self {
            core: Arc::downgrade(core),
            topic: topic.to_owned(),
            wanted,
            inbox,
            peers: Mutex::default(),
            number: OnceLock::new(),
        })
    }

    /// Takes the lowest number that none of `others` has, the other listeners of this topic in the node.
    pub(super) fn number_among(&self, others: &[Arc<Self>]) {
        let taken = |number: &usize| others.iter().any(|other| other.number.get() == Some(number));
        let lowest = (1..).find(|number| !taken(number));
        self.number.get_or_init(|| lowest.unwrap_or(1));
    }

    /// Header with which a publisher is asked for the topic. A publisher of rospy ends an older connection whose
    /// `callerid` is the same: listeners of one topic in a node would take the connection from each other for
    /// ever. So the first has the name of the node, and each further one a name in the node's private namespace.
    fn own_header(&self, core: &Core) -> Header {
        let own = match self.number.get() {
            Some(number) if *number > 1 => core.header_of_part(&format!("listener_{number}")),
            _ => core.header(),
        };
        let wire_type = &self.wanted.wire_type;
        own.with("topic", &self.topic)
            .with("type", &wire_type.name)
            .with("md5sum", &wire_type.md5)
            .with("message_definition", &wire_type.definition)
            .with("tcp_nodelay", "1")
    }

    pub(super) fn wake(&self) -> &Wake {
        &self.inbox.context().wake
    }

    pub(super) fn counters(&self) -> &Counters {
        self.inbox.counters()
    }

    /// Notes what the plan of a publisher loses.
    fn note_differences(&self, plan: Option<&PairPlan>) {
        let (Some(plan), MessageType::Ros(ros_type)) = (plan, self.wanted.message_type) else {
            return;
        };
        let mut peers = self.peers.lock();
        let (known, _) = &mut peers.differences;
        for difference in differences::of_plan(plan, ros_type) {
            if known.len() < MAX_DIFFERENCES && !known.contains(&difference) {
                known.push(difference);
            }
        }
    }

    /// Differences that were not told yet.
    pub(super) fn untold_differences(&self) -> Vec<String> {
        let mut peers = self.peers.lock();
        let (known, told) = &mut peers.differences;
        let untold = known.get(*told..).unwrap_or_default().to_vec();
        *told = known.len();
        untold
    }

    pub(super) fn type_name(&self) -> &str {
        &self.wanted.wire_type.name
    }

    /// Publishers that are connected, and why those are not that are not.
    pub(super) fn connected(&self) -> (usize, Option<Cause>) {
        let peers = self.peers.lock();
        let up = peers.by_uri.values().filter(|peer| peer.address.is_some());
        let core = self.core.upgrade();
        let hint = |uri: &NodeUri| {
            core.as_ref().map_or("", |core| core.master.whereabouts.hint(&uri.host))
        };
        let why = peers.by_uri.iter().find_map(|(uri, peer)| {
            let fault = peer.fault.clone()?;
            Some(Cause::peer(Named::server("publisher", uri), "", Some(fault), hint(uri)))
        });
        (up.count(), why)
    }

    /// Names of the connected publishers' nodes, by their numbers.
    pub(super) fn callers(&self) -> BTreeMap<u64, String> {
        let peers = self.peers.lock();
        let up = peers.by_uri.values().filter(|peer| peer.address.is_some());
        up.map(|peer| (peer.shared.id, peer.caller.clone())).collect()
    }

    /// The connected publishers.
    pub(super) fn publishers(&self) -> Vec<OtherPublisher> {
        let peers = self.peers.lock();
        let up = peers.by_uri.values().filter(|peer| peer.address.is_some());
        let of = |Peer { shared, caller, is_offer, .. }: &Peer| OtherPublisher {
            node: caller.clone(),
            is_offer: *is_offer,
            has_sent: shared.messages.load(Relaxed) > 0,
        };
        up.map(of).collect()
    }

    /// True once each publisher was connected to, or the first try has failed.
    pub(super) fn is_settled(&self) -> bool {
        let peers = self.peers.lock();
        peers.by_uri.values().all(|peer| peer.address.is_some() || peer.fault.is_some())
    }

    /// Number of the connected publishers that latch: all, some or none.
    pub(super) fn keeping(&self) -> SourceDurability {
        let peers = self.peers.lock();
        let up = peers.by_uri.values().filter(|peer| peer.address.is_some());
        SourceDurability::of(up.map(|peer| peer.latches))
    }

    /// A publisher that latched and has gone.
    pub(super) fn ended_publisher(&self) -> Option<u64> {
        self.peers.lock().ended_publishers.pop()
    }

    /// Connections of the subscription, for the slave API.
    pub(super) fn links(&self) -> Vec<BusLink> {
        let peers = self.peers.lock();
        let link = |(uri, peer): (&NodeUri, &Peer)| {
            let address = peer.address.as_ref()?;
            Some(BusLink {
                id: peer.shared.id,
                peer: uri.to_string(),
                address: address.clone(),
                connected: true,
                messages: peer.shared.messages.load(Relaxed),
                bytes: peer.shared.bytes.load(Relaxed),
            })
        };
        peers.by_uri.iter().filter_map(link).collect()
    }

    /// Ends all connections for good.
    pub(super) fn close(&self) {
        let mut peers = self.peers.lock();
        peers.closed = true;
        for peer in std::mem::take(&mut peers.by_uri).into_values() {
            peer.task.iter().for_each(AbortHandle::abort);
        }
    }

    /// Takes what the master says about who publishes.
    pub(super) fn update(self: &Arc<Self>, publishers: &[NodeUri]) {
        let Some(core) = self.core.upgrade() else { return };
        let mut peers = self.peers.lock();
        if peers.closed {
            return;
        }
        for (uri, peer) in &mut peers.by_uri {
            peer.listed = publishers.contains(uri);
        }
        let Peers { by_uri, ended_publishers, .. } = &mut *peers;
        by_uri.retain(|_, peer| {
            let stays = peer.listed || peer.address.is_some();
            if !stays {
                peer.task.iter().for_each(AbortHandle::abort);
                peer.note_end(ended_publishers);
            }
            stays
        });
        for uri in publishers {
            if let Some(peer) = peers.by_uri.get(uri) {
                peer.shared.again.notify_one();
                continue;
            }
            if peers.by_uri.len() >= MAX_PUBLISHERS {
                tracing::warn!(
                    topic = self.topic,
                    "ROS 1: publisher {uri} is left out: {MAX_PUBLISHERS} are the limit"
                );
                break;
            }
            let shared =
                Arc::new(ConnectionState { id: core.next_id(), ..ConnectionState::default() });
            let connection = Connection {
                connections: Arc::clone(self),
                uri: uri.clone(),
                shared: Arc::clone(&shared),
                caller: String::new(),
                latched: false,
                is_offer: false,
                plan: None,
            };
            let (connections, at) = (Arc::clone(self), uri.clone());
            let task = restarted(
                format!("the connection to publisher {uri} of {}", self.topic),
                move |what| _ = connections.note(&at, Err(what.into())),
                move || connection.clone().keep(),
            );
            let task = core.handle.spawn(task).abort_handle();
            let peer = Peer { shared, listed: true, task: Some(task), ..Peer::default() };
            peers.by_uri.insert(uri.clone(), peer);
        }
        drop(peers);
        self.wake().ring();
    }

    /// Notes how a connection is: where it leads, or why there is none. False where no listener wants it
    /// any more.
    fn note(&self, uri: &NodeUri, state: Result<Up, PeerFault>) -> bool {
        let mut peers = self.peers.lock();
        let Peers { by_uri, ended_publishers, .. } = &mut *peers;
        let Some(peer) = by_uri.get_mut(uri) else { return false };
        let stays = peer.listed || state.is_ok() || peer.address.is_some();
        let changed = match state {
            Ok(Up { address, caller, latches, is_offer }) => {
                peer.fault = None;
                (peer.latches, peer.caller, peer.is_offer) = (latches, caller, is_offer);
                // An end that was not reported yet is over.
                ended_publishers.retain(|id| *id != peer.shared.id);
                peer.address.replace(address).is_none()
            }
            Err(reason) => {
                let is_news = peer.fault.as_ref() != Some(&reason);
                let was_up = peer.address.take().is_some();
                // A connection that ends is made again at once; what that comes to is worth the one line.
                if was_up {
                    tracing::debug!(topic = self.topic, %uri, %reason, "ROS 1: disconnected");
                } else if is_news && peer.listed {
                    tracing::warn!(topic = self.topic, "ROS 1: publisher {uri}: {reason}");
                }
                peer.fault = Some(reason);
                // A connection that broke is made again; a node that is gone cannot be reached.
                if !was_up || !stays {
                    peer.note_end(ended_publishers);
                }
                was_up || is_news
            }
        };
        if !stays {
            by_uri.remove(uri);
        }
        drop(peers);
        if changed {
            self.wake().ring();
        }
        stays
    }

    /// True for the message that a publisher which latches sent last, when it comes once more with
    /// a new connection.
    fn came_before(&self, uri: &NodeUri, message: &Bytes, first: bool) -> bool {
        use std::hash::{DefaultHasher, Hasher as _};
        let mut hasher = DefaultHasher::new();
        hasher.write(message);
        let print = Some((message.len(), hasher.finish()));
        let mut peers = self.peers.lock();
        let Some(peer) = peers.by_uri.get_mut(uri) else { return false };
        let again = first && peer.last == print;
        peer.last = print;
        again
    }
}

impl Peer {
    /// Notes that the publisher is gone, and forgets its last message: should it come back, that is
    /// news.
    fn note_end(&mut self, ended_publishers: &mut Vec<u64>) {
        if self.last.take().is_some() {
            ended_publishers.push(self.shared.id);
        }
    }
}

/// The task of one publisher.
#[derive(Clone)]
struct Connection {
    connections: Arc<ListenerConnections>,
    uri: NodeUri,
    shared: Arc<ConnectionState>,
    caller: String,
    latched: bool,
    is_offer: bool,
    plan: Option<PairPlan>,
}

/// A connection on which messages flow.
struct Up {
    address: String,
    caller: String,
    latches: bool,
    is_offer: bool,
}

impl Connection {
    /// Connects, receives, and connects again while the master names the publisher.
    async fn keep(mut self) {
        let mut backoff = Backoff::of_process(self.shared.id);
        loop {
            let reason = match self.open().await {
                Ok(stream) => {
                    let address = stream.peer_addr().map(|a| a.to_string()).unwrap_or_default();
                    let (caller, latches, is_offer) =
                        (self.caller.clone(), self.latched, self.is_offer);
                    let up = Up { address, caller, latches, is_offer };
                    if !self.connections.note(&self.uri, Ok(up)) {
                        return;
                    }
                    backoff.reset();
                    self.receive(stream).await.into()
                }
                Err(Closed::Shunned) => {
                    // It may be another publication when the master names it again.
                    self.shared.again.notified().await;
                    continue;
                }
                Err(Closed::Refused(refused)) => {
                    self.connections.counters().refused_peer(refused.clone());
                    if !self.connections.note(&self.uri, Err(refused.who.into())) {
                        return;
                    }
                    // It is asked again when the master names it again.
                    self.shared.again.notified().await;
                    continue;
                }
                Err(Closed::Fault(reason)) => reason,
            };
            if !self.connections.note(&self.uri, Err(reason)) {
                return;
            }
            // Sooner where the master says that the publisher has something new.
            _ = timeout(backoff.wait(), self.shared.again.notified()).await;
        }
    }

    /// A connection on which messages follow, or why there is none.
    async fn open(&mut self) -> Result<TcpStream, Closed> {
        let core =
            self.connections.core.upgrade().ok_or_else(|| "the node has ended".to_owned())?;
        let (host, port) = request_topic(&core, &self.uri, &self.connections.topic).await?;
        let wire_type = &self.connections.wanted.wire_type;
        let own = self.connections.own_header(&core);
        let (stream, header) =
            tcpros::greeted(&host, port, &own).await.map_err(|why| why.to_string())?;
        peer_types::compare(&core, &self.connections.topic, &header);
        let ours = || tcpros::shown(&wire_type.name, &wire_type.md5);
        if let Some(error) = header.get("error") {
            let (says, theirs) = (shortened(error), type_there(error));
            return Err(Closed::Fault(PeerFault::Refuses { says, theirs, ours: ours() }));
        }
        if let Some(peers) = &self.connections.wanted.peers {
            let caller = header.get("callerid").unwrap_or_default();
            let address = stream.peer_addr().map(|at| at.ip().to_string()).unwrap_or_default();
            if !peers.admits(caller, &address) {
                let topic = &self.connections.topic;
                let refused =
                    PeerList::refused(PeerList::FROM, topic, &shortened(caller), &address);
                return Err(Closed::Refused(refused));
            }
        }
        let came_through = |shunned: &String| {
            let mark = header.get(MARK).and_then(|mark| mark.parse::<BridgeMark>().ok());
            mark.is_some_and(|mark| mark.came_through(shunned))
        };
        if self.connections.wanted.ignore_through.as_ref().is_some_and(came_through) {
            tracing::debug!(topic = self.connections.topic, uri = %self.uri, "ROS 1: a bridge's, passed over");
            return Err(Closed::Shunned);
        }
        let (name, md5) = (header.get("type").unwrap_or("*"), header.get("md5sum").unwrap_or("*"));
        if !wire_type.fits(md5) {
            let theirs = tcpros::shown(name, md5);
            return Err(Closed::Fault(PeerFault::Unlike { verb: "sends", theirs, ours: ours() }));
        }
        self.plan =
            conversion::publisher_plan(&core, &header, self.connections.wanted.message_type)
                .map_err(Closed::Fault)?;
        self.latched = header.is_set("latching");
        self.is_offer = header.is_set(OFFER);
        self.caller = shortened(header.get("callerid").unwrap_or_default());
        self.connections.note_differences(self.plan.as_ref());
        Ok(stream)
    }

    /// Receives until the connection ends; why it did.
    async fn receive(&self, mut stream: TcpStream) -> String {
        let (mut splitter, share) =
            (Splitter::new(self.connections.wanted.limit), Share::default());
        let counters = self.connections.inbox.counters();
        let mut first = true;
        loop {
            loop {
                let message = match splitter.next() {
                    Ok(None) => break,
                    Ok(Some(Piece::Message(message))) => message,
                    Ok(Some(Piece::Oversize(size))) => {
                        counters.received(size);
                        counters.dropped(DropReason::Oversize);
                        first = false;
                        continue;
                    }
                    Err(lost) => return lost.to_string(),
                };
                let size = message.len() + 4;
                counters.received(size);
                self.shared.messages.fetch_add(1, Relaxed);
                self.shared.bytes.fetch_add(size as u64, Relaxed);
                let is_first = std::mem::take(&mut first);
                if self.latched && self.connections.came_before(&self.uri, &message, is_first) {
                    counters.dropped(DropReason::Duplicate);
                    continue;
                }
                self.deliver(message, is_first).await;
            }
            if let Err(ended) = splitter::read(&mut stream, &mut splitter, &share, PROGRESS).await {
                if splitter.begun() > 0 {
                    counters.received(splitter.begun());
                    counters.dropped(ended.drop_reason());
                }
                return ended.to_string();
            }
        }
    }

    /// Puts a message into the inbox, under policy `block` when there is room; so too the one that a
    /// publisher kept for us.
    async fn deliver(&self, message: Bytes, is_first: bool) {
        let inbox = &self.connections.inbox;
        let (source, latched, plan) = (self.shared.id, self.latched, self.plan.clone());
        let kept_waits = if latched && is_first { KEPT_WAITS } else { Duration::ZERO };
        let received_at = inbox.context().clock.now();
        let arrival = Arrival { message, received_at, source, latched, plan };
        inbox.place(arrival, inbox.max_wait().max(kept_waits)).await;
    }
}

/// Reason why there is no connection.
enum Closed {
    /// The publisher is a bridge's, which takes it from where this listener's messages go.
    Shunned,
    /// The publisher is not in the route's list.
    Refused(Refused),
    Fault(PeerFault),
}

/// Type of a publisher that refuses, as the errors of rospy, of roscpp and of this crate tell it.
fn type_there(error: &str) -> Option<String> {
    let begins = ["] vs. [", "but our version has [", " publishes "];
    let (_, theirs) = begins.into_iter().find_map(|begin| error.split_once(begin))?;
    // On roscpp the checksum follows the name.
    let mut parts = theirs.split([']', ' ']).next()?.split('/');
    Some(shortened(&format!("{}/{}", parts.next()?, parts.next()?)))
}

impl From<String> for Closed {
    fn from(reason: String) -> Self {
        Self::Fault(reason.into())
    }
}
