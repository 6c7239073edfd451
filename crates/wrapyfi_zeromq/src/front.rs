//! One side of a broker: an XPUB that knows each listener, an XSUB that knows each publisher, and likewise a ROUTER of
//! clients, a DEALER of servers.
//!
//! ```text
//!   Proxy ── publish ──▶ index of subscriptions ──▶ Peer: outbox ── write ──▶ TCP ──▶ listener
//!                                                     │ full: this listener misses the message
//!   Proxy ◀── Heard ──── subscriptions ◀── read ────────────────────────────────────── listener
//!
//!   Proxy ◀── messages ── Assembly ◀── read ◀── TCP ◀──────────────────────────────── publisher
//!   Proxy ── want ──▶ first, last subscription of a topic ── write ─────────────────▶ publisher
//! ```
//!
//! libzmq's own XPUB tells neither which listener has no room nor how much it missed, and bounds what waits for one
//! in messages, not in bytes. Here each listener has a queue that is bounded by both, and everything that it does not
//! get is counted by its cause. Its other sockets keep a message whole whose frames never end, and any number of
//! connections.
//! Here a message that is too large is passed over, or ends its connection, and connections beyond the limit are refused;
//! all are counted.
//! Nothing here blocks, and a message that waits for several listeners exists once.

use std::collections::{BTreeMap, BTreeSet};
use std::hash::{BuildHasher as _, RandomState};
use std::io::ErrorKind;
use std::net::{IpAddr, SocketAddr, TcpListener};
use std::os::fd::AsRawFd as _;
use std::sync::Arc;
use std::time::{Duration, Instant};

use bytes::Bytes;
use mio::unix::SourceFd;
use mio::{Events, Interest, Poll, Registry, Token};

use super::assembly::NotTaken;
use super::curve::{Curve, Keys};
use super::ends::{End, Side};
use super::heard::{ConnectionEnd, Heard};
use super::ledger::Refusal;
use super::message::{Loss, Message};
use super::options;
use super::peer::{Peer, TURN};
use super::subscribers::Subscribers;
use super::traffic::REFUSED;
use super::wanted::Wanted;
use super::zmtp::Kind;
use wrapyfi_endpoint::{DropReason, Throttles};

/// The token of the port; peers are counted from 0.
const PORT: Token = Token(usize::MAX);
/// Events taken at once.
const EVENTS: usize = 256;
/// Bytes read at once.
const READ_BYTES: usize = 64 * 1024;

/// Bytes of a topic that the log has where it is foreign.
const MOST_OF_TOPIC: usize = 256;

/// Connections that are refused, as they are counted.
const TOO_MANY: &str = "too_many";

/// Bounds of one side.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bounds {
    /// Messages that may wait for one peer; 0: any number.
    pub(super) hwm: u16,
    /// Bytes of one message, all frames.
    pub(super) message_bytes: usize,
    /// Connections at once.
    pub(super) connections: usize,
}

/// The port, and who is connected to it. The broker takes out what came and what was lost after each turn.
pub(super) struct Front {
    kind: Kind,
    port: TcpListener,
    poll: Poll,
    /// Descriptor of `poll`, which is waited for while this is not locked.
    registry: Arc<Registry>,
    events: Events,
    peers: BTreeMap<usize, Peer>,
    next_id: usize,
    bounds: Bounds,
    wanted: Wanted,
    /// Messages that came, each with the number of its connection.
    pub(super) messages: Vec<(usize, Vec<Bytes>)>,
    /// Messages of publishers that were passed over.
    pub(super) not_taken: Vec<NotTaken>,
    /// Connection that was last given a message in turn.
    last: usize,
    /// Connections that were refused or ended, by reason.
    cuts: BTreeMap<&'static str, u64>,
    /// Keys of the broker, where it speaks CURVE.
    keys: Option<Arc<Keys>>,
    /// Subscriptions and messages of topics that the keys of their clients may not have.
    pub(super) denied: u64,
    /// Throttles of the log, by cause and by who it is.
    faults: Throttles,
    /// Peers that were refused.
    pub(super) refusals: Vec<Refusal>,
    subscribers: Subscribers,
    /// Messages that may wait for one listener; none: any number.
    hwm: Option<usize>,
    /// Listeners to whom something is to be written.
    dirty: BTreeSet<usize>,
    /// Listeners and the port that have more to be read than was read.
    unread: BTreeSet<usize>,
    /// Peer that was read last: those behind it have their turn before it.
    read_last: usize,
    /// Connections wait at the port, because the process had no files left.
    has_waiting: bool,
    /// Subscriptions that came.
    pub(super) heard: Vec<Heard>,
    /// Messages that listeners missed.
    pub(super) losses: Vec<Loss>,
    scratch: Vec<u8>,
}

impl Front {
    /// Binds the port; with CURVE where there are keys.
    pub(super) fn bind(
        kind: Kind,
        ip: IpAddr,
        port: u16,
        bounds: Bounds,
        keys: Option<Arc<Keys>>,
    ) -> std::io::Result<Self> {
        let port = TcpListener::bind((ip, port))?;
        port.set_nonblocking(true)?;
        let poll = Poll::new()?;
        poll.registry().register(&mut SourceFd(&port.as_raw_fd()), PORT, Interest::READABLE)?;
        Ok(Self {
            kind,
            port,
            registry: Arc::new(poll.registry().try_clone()?),
            poll,
            bounds,
            wanted: Wanted::default(),
            messages: Vec::new(),
            not_taken: Vec::new(),
            last: 0,
            cuts: BTreeMap::new(),
            keys,
            denied: 0,
            faults: Throttles::default(),
            refusals: Vec::new(),
            events: Events::with_capacity(EVENTS),
            peers: BTreeMap::new(),
            next_id: first_id(),
            subscribers: Subscribers::default(),
            hwm: Some(usize::from(bounds.hwm)).filter(|hwm| *hwm > 0),
            dirty: BTreeSet::new(),
            unread: BTreeSet::new(),
            read_last: 0,
            has_waiting: false,
            heard: Vec::new(),
            losses: Vec::new(),
            scratch: vec![0; READ_BYTES],
        })
    }

    /// The port that it is bound to.
    pub(super) fn port(&self) -> std::io::Result<u16> {
        Ok(self.port.local_addr()?.port())
    }

    /// Descriptor that is readable when something happened.
    pub(super) fn registry(&self) -> Arc<Registry> {
        Arc::clone(&self.registry)
    }

    /// True when there is more to be read without waiting.
    pub(super) fn is_unread(&self) -> bool {
        !self.unread.is_empty()
    }

    /// Handles what happened to the sockets, without waiting.
    pub(super) fn turn(&mut self, now: Instant) -> std::io::Result<()> {
        let polled = self.poll.poll(&mut self.events, Some(Duration::ZERO));
        // Those that are read until nothing is left: what else comes is an event again.
        let mut readable: BTreeMap<usize, bool> =
            std::mem::take(&mut self.unread).into_iter().map(|id| (id, true)).collect();
        for event in &self.events {
            let Token(id) = event.token();
            if event.is_writable()
                && let Some(peer) = self.peers.get_mut(&id)
            {
                peer.is_blocked = false;
                self.dirty.insert(id);
            }
            let has_ended = event.is_error() || event.is_read_closed();
            if event.is_readable() || has_ended {
                *readable.entry(id).or_default() |= has_ended;
            }
        }
        let behind = readable.split_off(&self.read_last.saturating_add(1));
        for (place, (id, to_the_end)) in behind.into_iter().chain(readable).enumerate() {
            // However many have much to say: the other side of the broker has its turn, too.
            if place > 0 && now.elapsed() >= TURN {
                self.unread.insert(id);
                continue;
            }
            self.read_last = id;
            if Token(id) == PORT {
                self.accept(now);
            } else {
                self.read(id, to_the_end, now);
            }
        }
        self.flush();
        match polled {
            Err(error) if error.kind() != ErrorKind::Interrupted => Err(error),
            _ => Ok(()),
        }
    }

    /// Asks listeners that were silent whether they live, and leaves those that do not answer.
    pub(super) fn tick(&mut self, now: Instant) {
        let ids: Vec<usize> = self.peers.keys().copied().collect();
        for id in ids {
            let Some(peer) = self.peers.get_mut(&id) else { continue };
            if peer.is_alive(now) {
                if !peer.outbox.is_empty() {
                    self.dirty.insert(id);
                }
            } else if now.elapsed() < TURN {
                self.leave(id, &"it does not answer");
            }
        }
        // Files may have come free elsewhere in the process.
        if self.has_waiting {
            self.unread.insert(PORT.0);
        }
        self.flush();
    }

    /// True where somebody is subscribed to `topic`.
    pub(super) fn is_heard(&self, topic: &[u8]) -> bool {
        !self.subscribers.of(topic).is_empty()
    }

    /// Queues a message for everybody who is subscribed to it and has room. `of` is its size as its publisher
    /// counts it, where it is that of a publisher.
    pub(super) fn publish(&mut self, frames: Vec<Bytes>, of: Option<usize>) {
        let Some(topic) = frames.first().cloned() else { return };
        let to = self.subscribers.of(&topic);
        if to.is_empty() {
            return;
        }
        let message = self.message(frames, of.map(|size| (topic.clone(), size)));
        for id in to {
            let Some(peer) = self.peers.get_mut(&id) else { continue };
            // A subscription is the beginning of a topic, which may go on as one that is not allowed.
            if !peer.may_hear(&topic) {
                continue;
            }
            match peer.queue(&message, self.hwm) {
                Ok(()) => _ = self.dirty.insert(id),
                Err(reason) => self.losses.push(message.loss(reason, peer.address)),
            }
        }
    }

    fn message(&self, frames: Vec<Bytes>, of: Option<(Bytes, usize)>) -> Arc<Message> {
        Message::new(frames, self.keys.is_some(), of, None)
    }

    /// A subscription, or its end, as publishers hear it.
    fn word(&self, is_wanted: bool, topic: &[u8]) -> Arc<Message> {
        Message::subscription(is_wanted, topic, self.keys.is_some())
    }

    /// Number of the peers that are connected.
    pub(super) fn connected(&self) -> usize {
        self.peers.values().filter(|peer| peer.is_open()).count()
    }

    /// Tells publishers that a program wants a topic, or no more; as often as it was wanted before it is not. It goes
    /// out with [`Self::flush`].
    pub(super) fn want(&mut self, topic: &[u8], is_wanted: bool) {
        let told = match is_wanted {
            true => self.wanted.subscribed(topic),
            false => self.wanted.unsubscribed(topic),
        };
        let Some(told) = told else { return };
        let message = self.word(is_wanted, &told);
        let open = self.peers.iter().filter(|(_, peer)| peer.is_open()).map(|(id, _)| *id);
        for id in open.collect::<Vec<_>>() {
            self.tell(id, &message, &told);
        }
    }

    /// Tells one publisher what is wanted, and before it that its key may not publish it. One that misses any of it
    /// would never be right again.
    fn tell(&mut self, id: usize, message: &Arc<Message>, topic: &[u8]) {
        let grant = self.peers.get(&id).and_then(Peer::grant);
        let is_refused = grant.is_some_and(|grant| !grant.may_publish(topic));
        let refused = is_refused.then(|| self.word(true, &[REFUSED.as_bytes(), topic].concat()));
        let Some(peer) = self.peers.get_mut(&id) else { return };
        match refused.iter().chain([message]).try_for_each(|word| peer.queue(word, None)) {
            Ok(()) => _ = self.dirty.insert(id),
            Err(_) => self.leave(id, &"it does not read what is wanted"),
        }
    }

    /// Sends frames of `size` bytes to one peer; false when there is no room for them, and none when the peer is gone.
    pub(super) fn send(&mut self, id: usize, frames: Vec<Bytes>, size: usize) -> Option<bool> {
        // They count where they wait.
        let message = self.message(frames, Some((Bytes::new(), size)));
        self.send_to(id, &message)
    }

    fn send_to(&mut self, id: usize, message: &Arc<Message>) -> Option<bool> {
        let peer = self.peers.get_mut(&id).filter(|peer| peer.is_open())?;
        if peer.queue(message, self.hwm).is_err() {
            return Some(false);
        }
        if let Err(error) = peer.write() {
            self.leave(id, &error);
            return None;
        }
        Some(true)
    }

    /// Sends frames of `size` bytes to the peer whose turn it is; false when none has room.
    pub(super) fn send_in_turn(&mut self, frames: Vec<Bytes>, size: usize) -> bool {
        let message = self.message(frames, Some((Bytes::new(), size)));
        let after = self.peers.range(self.last.saturating_add(1)..);
        let ids = after.chain(self.peers.range(..=self.last)).map(|(id, _)| *id);
        for id in ids.collect::<Vec<_>>() {
            if self.send_to(id, &message) == Some(true) {
                self.last = id;
                return true;
            }
        }
        false
    }

    /// Counts a connection that is refused or ended, and says so, but not each time for one `subject`.
    fn cut(
        &mut self,
        reason: &'static str,
        subject: &str,
        peer: SocketAddr,
        why: &dyn std::fmt::Display,
    ) {
        *self.cuts.entry(reason).or_default() += 1;
        if let Some(unlogged_before) = self.faults.pass(&(reason, subject), Instant::now()) {
            tracing::warn!(%peer, reason, unlogged_before, "the ZeroMQ broker ends a connection: {why}");
        }
    }

    /// Counts what the key of a client may not have, and says so, but not each time.
    fn deny(&mut self, id: usize, topic: &[u8]) {
        self.denied += 1;
        let Some(peer) = self.peers.get(&id) else { return };
        let key = peer.grant().map(|grant| grant.key()).unwrap_or_default();
        let may_not = if self.kind == Kind::Xsub { "publish" } else { "subscribe to" };
        let name = String::from_utf8_lossy(topic.get(..MOST_OF_TOPIC).unwrap_or(topic));
        if let Some(unlogged_before) = self.faults.pass(&(key, &name), Instant::now()) {
            tracing::warn!(
                peer = %peer.address, key, topic = %name, unlogged_before,
                "a CURVE client may not {may_not} this topic (curve: clients)"
            );
        }
        let who = format!("{}: its CURVE key {key} may not {may_not} {name:?}", peer.address);
        let key = key.to_owned();
        self.refuse(who, key, Some(topic.to_vec()));
    }

    /// Says that a subscription is ignored, but not each time for one host.
    fn crowd(&mut self, peer: SocketAddr, topic: &[u8]) {
        if let Some(unlogged_before) = self.faults.pass(&("crowd", peer.ip()), Instant::now()) {
            let topic = String::from_utf8_lossy(topic.get(..MOST_OF_TOPIC).unwrap_or(topic));
            tracing::warn!(
                %peer, %topic, unlogged_before,
                "the ZeroMQ broker ignores a subscription: this listener has as many as may be, or all together take \
                 what they may of limits: waiting_mib"
            );
        }
    }

    /// Notes a message that is passed over, and says so, but not each time for one topic.
    fn pass_over(&mut self, peer: SocketAddr, message: NotTaken) {
        // Requests and replies have no topic: the end of their connection is counted.
        if self.kind != Kind::Xsub {
            return;
        }
        let NotTaken { topic, reason } = &message;
        let topic = String::from_utf8_lossy(topic.get(..MOST_OF_TOPIC).unwrap_or(topic));
        if let Some(unlogged_before) = self.faults.pass(&(*reason, &topic), Instant::now()) {
            let why = match reason {
                DropReason::OverBudget => "too much waits in this process (limits: waiting_mib)",
                _ => "it is larger than the broker takes (max_message_mib)",
            };
            let limit_bytes = self.bounds.message_bytes;
            tracing::warn!(
                %peer, %topic, limit_bytes, unlogged_before,
                "the ZeroMQ broker does not pass on a message: {why}"
            );
        }
        self.not_taken.push(message);
    }

    /// Notes a peer that is refused.
    fn refuse(&mut self, who: String, key: String, topic: Option<Vec<u8>>) {
        let entry = self.keys.as_ref().and_then(|keys| keys.entry(&key)).cloned();
        self.refusals.push(Refusal { key, entry, topic, ..Refusal::of(self.kind, who) });
    }

    /// Writes what waits, as far as there is room.
    pub(super) fn flush(&mut self) {
        for id in std::mem::take(&mut self.dirty) {
            let Some(peer) = self.peers.get_mut(&id) else { continue };
            if let Err(error) = peer.write() {
                self.leave(id, &error);
            }
        }
    }

    /// Writes what waits until `deadline`, and ends all connections.
    pub(super) fn close(&mut self, deadline: Instant) {
        self.flush();
        while self.peers.values().any(|peer| !peer.outbox.is_empty()) {
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                break;
            }
            _ = self.poll.poll(&mut self.events, Some(left));
            for (id, peer) in &mut self.peers {
                peer.is_blocked = false;
                self.dirty.insert(*id);
            }
            self.flush();
        }
        for id in self.peers.keys().copied().collect::<Vec<_>>() {
            self.leave(id, &"the broker ends");
        }
    }

    fn accept(&mut self, now: Instant) {
        loop {
            let (stream, address) = match self.port.accept() {
                Ok(accepted) => accepted,
                Err(error) if error.kind() == ErrorKind::WouldBlock => {
                    self.has_waiting = false;
                    return;
                }
                Err(error) => {
                    // Such as: no more files. It is tried again when one is free, and with each tick: no event tells
                    // twice of those that wait.
                    tracing::debug!(%error, "a peer could not be accepted");
                    self.has_waiting = true;
                    return;
                }
            };
            let limit = self.bounds.connections;
            if self.peers.len() >= limit {
                let why = format!("{limit} are open, which is the limit (max_connections)");
                self.cut(TOO_MANY, "", address, &why);
                continue;
            }
            let id = self.next_id;
            self.next_id += 1;
            let opened = options::set_stream(&stream).and_then(|()| {
                let interest = Interest::READABLE | Interest::WRITABLE;
                self.poll.registry().register(
                    &mut SourceFd(&stream.as_raw_fd()),
                    Token(id),
                    interest,
                )
            });
            if let Err(error) = opened {
                tracing::debug!(%address, %error, "a peer could not be accepted");
                continue;
            }
            let peer = Peer::new(stream, address, now).at(Some(End::of(address, Side::Broker)));
            let peer = match self.kind {
                Kind::Xpub => peer,
                kind => peer.of_messages(kind, self.bounds.message_bytes),
            };
            let curve = self.keys.as_ref().map(|keys| Curve::server(keys, self.kind));
            let peer = match curve {
                Some(curve) => peer.secured(curve, None),
                None => peer,
            };
            self.peers.insert(id, peer);
            self.dirty.insert(id);
        }
    }

    /// Reads what a peer has said; without `to_the_end` as far as one look shows that nothing is left.
    fn read(&mut self, id: usize, to_the_end: bool, now: Instant) {
        let Some(peer) = self.peers.get_mut(&id) else { return };
        let (mut heard, was_open, address) = (Vec::new(), peer.is_open(), peer.address);
        let read = peer.read(&mut self.scratch, &mut heard, to_the_end, now);
        if peer.is_open() && !was_open {
            for topic in self.wanted.all() {
                self.tell(id, &self.word(true, &topic), &topic);
            }
        }
        self.dirty.insert(id);
        for one in heard {
            match one {
                Heard::Message(frames) => {
                    self.messages.push((id, frames));
                    continue;
                }
                Heard::Denied(topic) => {
                    self.deny(id, &topic);
                    continue;
                }
                Heard::NotTaken(message) => {
                    self.pass_over(address, message);
                    continue;
                }
                Heard::Subscribed(ref topic) => {
                    self.subscribers.add(topic.clone(), id);
                }
                Heard::Unsubscribed(ref topic) => self.subscribers.remove(topic, id),
                Heard::NoRoom(ref topic) => self.crowd(address, topic),
                Heard::Ignored => {}
            }
            self.heard.push(one);
        }
        match read {
            Ok(true) => _ = self.unread.insert(id),
            Ok(false) => {}
            Err(why) => {
                if let Some(reason) = why.reason() {
                    let (key, host) = (why.refused_key(), address.ip().to_string());
                    let subject = key.filter(|key| !key.is_empty()).unwrap_or(&host);
                    self.cut(reason, subject, address, &why);
                    if let Some(key) = key {
                        self.refuse(format!("{address}: {why}"), key.to_owned(), None);
                    }
                    if let ConnectionEnd::OtherPort { ours, .. } = &why {
                        let (side, who) = (ours.other(), format!("{address}: {why}"));
                        self.refusals
                            .push(Refusal { is_elsewhere: true, ..Refusal::of(side, who) });
                    }
                }
                // One that only asks who is here, as a socket that does not fit, is told.
                if let Some(peer) = self.peers.get_mut(&id) {
                    _ = peer.write();
                }
                self.leave(id, &why);
            }
        }
    }

    /// Ends a connection. Messages that waited for it are lost.
    fn leave(&mut self, id: usize, why: &dyn std::fmt::Display) {
        let Some(peer) = self.peers.remove(&id) else { return };
        if self.has_waiting {
            self.unread.insert(PORT.0);
        }
        tracing::debug!(peer = %peer.address, %why, "a connection to the ZeroMQ broker ended");
        for topic in &peer.topics {
            self.subscribers.remove(topic, id);
            self.heard.push(Heard::Unsubscribed(topic.clone()));
        }
        // Closing it takes it off the poll as well.
        if self.kind != Kind::Xpub {
            return;
        }
        let lost = |message: &Arc<Message>| message.loss(DropReason::ConnectionLost, peer.address);
        let waiting = peer.outbox.messages();
        self.losses.extend(waiting.filter(|message| message.of.is_some()).map(lost));
    }
}

/// Number of connections that were refused or ended at these ports, by reason.
pub(super) fn cuts(sides: [&Front; 2]) -> BTreeMap<&'static str, u64> {
    let mut all = BTreeMap::new();
    for (reason, count) in sides.into_iter().flat_map(|side| &side.cuts) {
        *all.entry(*reason).or_default() += count;
    }
    all
}

/// Number of the first connection, another one in each broker: a reply to a client of a broker that has ended must
/// find no other client.
fn first_id() -> usize {
    let random = RandomState::new().hash_one(std::process::id());
    // Far below the token of the port.
    usize::try_from(random >> 8).unwrap_or(0) / 2
}
