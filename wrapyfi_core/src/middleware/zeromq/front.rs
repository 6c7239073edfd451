//! The broker's side for listeners: an XPUB that knows each of them.
//!
//! ```text
//!   Proxy ── publish ──▶ index of subscriptions ──▶ Peer: outbox ── write ──▶ TCP ──▶ listener
//!                                                     │ full: this listener misses the message
//!   Proxy ◀── Heard ──── subscriptions ◀── read ────────────────────────────────────── listener
//! ```
//!
//! libzmq's own XPUB tells neither which listener has no room nor how much it missed, and bounds what waits for one
//! in messages, not in bytes. Here each listener has a queue that is bounded by both, and everything that it does not
//! get is counted by its cause. Nothing here blocks, and a message that waits for several listeners exists once.

use std::collections::{BTreeMap, BTreeSet, HashMap, VecDeque};
use std::io::{ErrorKind, IoSlice, Read as _, Write as _};
use std::net::{IpAddr, SocketAddr, TcpListener, TcpStream};
use std::os::fd::{AsRawFd as _, RawFd};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::{Duration, Instant};

use bytes::Bytes;
use mio::unix::SourceFd;
use mio::{Events, Interest, Poll, Token};

use super::options;
use super::zmtp::{self, Breach};
use crate::endpoint::{DropReason, Share};

/// The token of the port; listeners are counted from 0.
const PORT: Token = Token(usize::MAX);
/// Events taken at once.
const EVENTS: usize = 256;
/// Listeners at once. What is beyond is refused.
const MAX_PEERS: usize = 4096;
/// Subscriptions of one listener. What is beyond is ignored.
const MAX_SUBSCRIPTIONS: usize = 4096;
/// Subscriptions are topic names: nothing longer is read.
const MAX_FRAME_BYTES: usize = 64 * 1024;
/// Bytes read at once, and how often before the others have their turn.
const READ_BYTES: usize = 64 * 1024;
const READS: usize = 16;
/// Pieces given to one write.
const SLICES: usize = 64;

/// What listeners want.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Heard {
    Subscribed(Vec<u8>),
    Unsubscribed(Vec<u8>),
    /// Something that is no subscription.
    Ignored,
}

/// A message as it goes on the wire.
#[derive(Debug)]
struct Message {
    parts: Vec<Bytes>,
    wire_bytes: usize,
    /// Topic and size as its publisher counts it; none for what the broker says itself.
    of: Option<(Bytes, usize)>,
    /// A listener missed it already: it is counted once.
    missed: AtomicBool,
}

/// A message that a listener did not get.
#[derive(Debug, Clone)]
pub(super) struct Loss {
    pub(super) reason: DropReason,
    pub(super) listener: SocketAddr,
    /// Topic and size, where no other listener missed it before.
    pub(super) first: Option<(Bytes, usize)>,
}

/// The port, and who is connected to it.
pub(super) struct Front {
    port: TcpListener,
    poll: Poll,
    events: Option<Events>,
    peers: BTreeMap<usize, Peer>,
    next_id: usize,
    /// Listeners by what they are subscribed to, and how many subscriptions have which length.
    index: HashMap<Vec<u8>, BTreeSet<usize>>,
    lengths: BTreeMap<usize, usize>,
    /// Messages that may wait for one listener; none: any number.
    hwm: Option<usize>,
    /// Listeners to whom something is to be written.
    dirty: BTreeSet<usize>,
    /// Listeners and the port that have more to be read than was read.
    unread: BTreeSet<usize>,
    heard: Vec<Heard>,
    losses: Vec<Loss>,
    scratch: Vec<u8>,
}

impl Front {
    /// Binds the port.
    pub(super) fn bind(ip: IpAddr, port: u16, hwm: u16) -> std::io::Result<Self> {
        let port = TcpListener::bind((ip, port))?;
        port.set_nonblocking(true)?;
        let poll = Poll::new()?;
        poll.registry().register(&mut SourceFd(&port.as_raw_fd()), PORT, Interest::READABLE)?;
        Ok(Self {
            port,
            poll,
            events: Some(Events::with_capacity(EVENTS)),
            peers: BTreeMap::new(),
            next_id: 0,
            index: HashMap::new(),
            lengths: BTreeMap::new(),
            hwm: Some(usize::from(hwm)).filter(|hwm| *hwm > 0),
            dirty: BTreeSet::new(),
            unread: BTreeSet::new(),
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
    pub(super) fn fd(&self) -> RawFd {
        self.poll.as_raw_fd()
    }

    /// True when there is more to be read without waiting.
    pub(super) fn is_unread(&self) -> bool {
        !self.unread.is_empty()
    }

    /// What was heard since this was asked last.
    pub(super) fn heard(&mut self) -> Vec<Heard> {
        std::mem::take(&mut self.heard)
    }

    /// What was lost since this was asked last.
    pub(super) fn losses(&mut self) -> Vec<Loss> {
        std::mem::take(&mut self.losses)
    }

    /// Handles what happened to the sockets, without waiting.
    pub(super) fn turn(&mut self, now: Instant) -> std::io::Result<()> {
        let mut events = self.take_events();
        let polled = self.poll.poll(&mut events, Some(Duration::ZERO));
        let mut readable = std::mem::take(&mut self.unread);
        for event in &events {
            let Token(id) = event.token();
            if event.is_writable()
                && let Some(peer) = self.peers.get_mut(&id)
            {
                peer.is_blocked = false;
                self.dirty.insert(id);
            }
            if event.is_readable() || event.is_error() || event.is_read_closed() {
                readable.insert(id);
            }
        }
        self.events = Some(events);
        for id in readable {
            if Token(id) == PORT {
                self.accept(now);
            } else {
                self.read(id, now);
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
            match peer.pulse(now) {
                Pulse::Fine => {}
                Pulse::Ask => {
                    peer.outbox.push_back(control(zmtp::command(b"\x04PING\0\0")));
                    self.dirty.insert(id);
                }
                Pulse::Dead => self.leave(id, &"it does not answer"),
            }
        }
        // Where files had run out there may be some now.
        self.unread.insert(PORT.0);
        self.flush();
    }

    /// Queues a message for everybody who is subscribed to it and has room. `of` is its size as its publisher
    /// counts it, where it is somebody's.
    pub(super) fn publish(&mut self, frames: Vec<zmq::Message>, of: Option<usize>) {
        let Some(topic) = frames.first() else { return };
        let to = self.subscribers(topic);
        if to.is_empty() {
            return;
        }
        let of = of.map(|size| (Bytes::copy_from_slice(topic), size));
        let parts = zmtp::encode(frames);
        let wire_bytes = parts.iter().map(Bytes::len).sum();
        let message = Arc::new(Message { parts, wire_bytes, of, missed: AtomicBool::new(false) });
        for id in to {
            let Some(peer) = self.peers.get_mut(&id) else { continue };
            match peer.queue(&message, self.hwm) {
                Ok(()) => _ = self.dirty.insert(id),
                Err(reason) => self.losses.push(message.loss(reason, peer.address)),
            }
        }
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
            let mut events = self.take_events();
            _ = self.poll.poll(&mut events, Some(left));
            self.events = Some(events);
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

    fn take_events(&mut self) -> Events {
        self.events.take().unwrap_or_else(|| Events::with_capacity(EVENTS))
    }

    fn accept(&mut self, now: Instant) {
        loop {
            let (stream, address) = match self.port.accept() {
                Ok(accepted) => accepted,
                Err(error) if error.kind() == ErrorKind::WouldBlock => return,
                Err(error) => {
                    // Such as: no more files. It is tried again with the next tick.
                    tracing::debug!(%error, "a listener could not be accepted");
                    return;
                }
            };
            if self.peers.len() >= MAX_PEERS {
                tracing::warn!(%address, limit = MAX_PEERS, "too many listeners: one was refused");
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
                tracing::debug!(%address, %error, "a listener could not be accepted");
                continue;
            }
            self.peers.insert(id, Peer::new(stream, address, now));
            self.dirty.insert(id);
        }
    }

    fn read(&mut self, id: usize, now: Instant) {
        let Some(peer) = self.peers.get_mut(&id) else { return };
        let mut end: Option<String> = None;
        for turn in 0.. {
            if turn == READS {
                self.unread.insert(id);
                break;
            }
            match peer.stream.read(&mut self.scratch) {
                Ok(0) => end = Some("it left".to_owned()),
                Ok(count) => {
                    peer.heard_at = now;
                    peer.inbox.extend_from_slice(self.scratch.get(..count).unwrap_or_default());
                    if let Err(breach) = peer.understand(&mut self.heard) {
                        end = Some(breach.to_string());
                    }
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => end = Some(error.to_string()),
            }
            if end.is_some() {
                break;
            }
        }
        self.dirty.insert(id);
        for (topic, on) in std::mem::take(&mut peer.news) {
            if !on {
                unlist(&mut self.index, &mut self.lengths, &topic, id);
                continue;
            }
            let length = topic.len();
            let ids = self.index.entry(topic).or_default();
            if ids.insert(id) && ids.len() == 1 {
                *self.lengths.entry(length).or_default() += 1;
            }
        }
        if let Some(why) = end {
            self.leave(id, &why);
        }
    }

    /// Everybody who is subscribed to a beginning of `topic`.
    fn subscribers(&self, topic: &[u8]) -> Vec<usize> {
        let lengths = self.lengths.range(..=topic.len()).map(|(length, _)| *length);
        let subscribed = lengths.filter_map(|length| self.index.get(topic.get(..length)?));
        let mut ids: Vec<usize> = subscribed.flatten().copied().collect();
        ids.sort_unstable();
        ids.dedup();
        ids
    }

    /// Ends a connection. What waited for it is lost.
    fn leave(&mut self, id: usize, why: &dyn std::fmt::Display) {
        let Some(peer) = self.peers.remove(&id) else { return };
        tracing::debug!(listener = %peer.address, %why, "a listener's connection ended");
        for topic in &peer.topics {
            unlist(&mut self.index, &mut self.lengths, topic, id);
            self.heard.push(Heard::Unsubscribed(topic.clone()));
        }
        let lost = |message: &Arc<Message>| message.loss(DropReason::ConnectionLost, peer.address);
        self.losses.extend(peer.outbox.iter().filter(|it| it.of.is_some()).map(lost));
        // Closing it takes it off the poll as well.
    }
}

/// Takes a listener off the index.
fn unlist(
    index: &mut HashMap<Vec<u8>, BTreeSet<usize>>,
    lengths: &mut BTreeMap<usize, usize>,
    topic: &[u8],
    id: usize,
) {
    let Some(ids) = index.get_mut(topic) else { return };
    let was = ids.remove(&id);
    if !ids.is_empty() {
        return;
    }
    index.remove(topic);
    if was && let Some(count) = lengths.get_mut(&topic.len()) {
        *count -= 1;
        if *count == 0 {
            lengths.remove(&topic.len());
        }
    }
}

impl Message {
    fn loss(&self, reason: DropReason, listener: SocketAddr) -> Loss {
        let first = if self.missed.swap(true, Relaxed) { None } else { self.of.clone() };
        Loss { reason, listener, first }
    }
}

/// Something that the broker says itself.
fn control(bytes: Vec<u8>) -> Arc<Message> {
    let wire_bytes = bytes.len();
    let parts = vec![bytes.into()];
    Arc::new(Message { parts, wire_bytes, of: None, missed: AtomicBool::new(true) })
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    Greeting,
    Handshake,
    Open,
}

/// Whether a listener lives.
enum Pulse {
    Fine,
    Ask,
    Dead,
}

/// One listener.
struct Peer {
    stream: TcpStream,
    address: SocketAddr,
    stage: Stage,
    inbox: Vec<u8>,
    /// Within a message of several frames, which is no subscription.
    inside: bool,
    topics: BTreeSet<Vec<u8>>,
    /// Subscriptions that came and went, not yet in the index.
    news: Vec<(Vec<u8>, bool)>,
    outbox: VecDeque<Arc<Message>>,
    /// Messages in it that are counted against the high-water mark.
    waiting: usize,
    /// Bytes of the first that are written.
    written: usize,
    /// The connection takes no more until the system says so.
    is_blocked: bool,
    share: Share,
    since: Instant,
    heard_at: Instant,
    asked_at: Option<Instant>,
}

impl Peer {
    fn new(stream: TcpStream, address: SocketAddr, now: Instant) -> Self {
        Self {
            stream,
            address,
            stage: Stage::Greeting,
            inbox: Vec::new(),
            inside: false,
            topics: BTreeSet::new(),
            news: Vec::new(),
            outbox: VecDeque::from([control(zmtp::greeting())]),
            waiting: 0,
            written: 0,
            is_blocked: false,
            share: Share::default(),
            since: now,
            heard_at: now,
            asked_at: None,
        }
    }

    /// Takes a message into its queue.
    ///
    /// # Errors
    /// Why there is no room for it.
    fn queue(&mut self, message: &Arc<Message>, hwm: Option<usize>) -> Result<(), DropReason> {
        if message.of.is_some() {
            if hwm.is_some_and(|hwm| self.waiting >= hwm) {
                return Err(DropReason::Stalled);
            }
            if !self.share.take(message.wire_bytes) {
                return Err(DropReason::OverBudget);
            }
            self.waiting += 1;
        } else if self.outbox.len() > self.waiting + 4 {
            // What the broker says is said again: an old word need not wait beside a newer one.
            return Ok(());
        }
        self.outbox.push_back(Arc::clone(message));
        Ok(())
    }

    fn write(&mut self) -> std::io::Result<()> {
        while !self.outbox.is_empty() && !self.is_blocked {
            let mut skip = self.written;
            let mut slices = Vec::with_capacity(SLICES);
            for part in self.outbox.iter().flat_map(|message| &message.parts) {
                match part.get(skip..) {
                    Some(rest) if !rest.is_empty() => {
                        slices.push(IoSlice::new(rest));
                        skip = 0;
                    }
                    _ => skip -= part.len(),
                }
                if slices.len() == SLICES {
                    break;
                }
            }
            match self.stream.write_vectored(&slices) {
                Ok(0) => return Err(ErrorKind::WriteZero.into()),
                Ok(count) => self.written += count,
                Err(error) if error.kind() == ErrorKind::WouldBlock => self.is_blocked = true,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
            while let Some(first) = self.outbox.front()
                && self.written >= first.wire_bytes
            {
                self.written -= first.wire_bytes;
                if first.of.is_some() {
                    self.share.give(first.wire_bytes);
                    self.waiting -= 1;
                }
                self.outbox.pop_front();
            }
        }
        Ok(())
    }

    /// Reads what has come as far as it is complete.
    fn understand(&mut self, heard: &mut Vec<Heard>) -> Result<(), Breach> {
        if self.stage == Stage::Greeting {
            let Some((greeting, rest)) = self.inbox.split_first_chunk::<{ zmtp::GREETING }>()
            else {
                // Who does not begin so will not send the rest.
                let fits = self.inbox.first().is_none_or(|first| *first == 0xff);
                return if fits { Ok(()) } else { Err(Breach) };
            };
            zmtp::check_greeting(greeting)?;
            self.inbox = rest.to_vec();
            self.stage = Stage::Handshake;
            self.outbox.push_back(control(zmtp::ready("XPUB")));
        }
        let inbox = std::mem::take(&mut self.inbox);
        let mut rest = &inbox[..];
        while let Some((frame, size)) = zmtp::split_frame(rest, MAX_FRAME_BYTES)? {
            match (self.stage, frame.is_command) {
                (Stage::Open, true) => self.obey(frame.body, heard),
                (Stage::Open, false) => {
                    match (self.inside, frame.more) {
                        (false, false) => self.subscribe(frame.body, heard),
                        (false, true) => heard.push(Heard::Ignored),
                        (true, _) => {}
                    }
                    self.inside = frame.more;
                }
                (_, true) => {
                    let (name, properties) = zmtp::split_command(frame.body).ok_or(Breach)?;
                    if name != b"READY"
                        || !matches!(zmtp::socket_type(properties), Some(b"SUB" | b"XSUB"))
                    {
                        return Err(Breach);
                    }
                    self.stage = Stage::Open;
                }
                (_, false) => return Err(Breach),
            }
            rest = rest.get(size..).unwrap_or_default();
        }
        self.inbox = rest.to_vec();
        Ok(())
    }

    fn obey(&mut self, body: &[u8], heard: &mut Vec<Heard>) {
        match zmtp::split_command(body) {
            Some((b"PING", rest)) => {
                // Two bytes of time to live, then a context that is sent back.
                let context = rest.get(2..).unwrap_or_default();
                let pong =
                    [&b"\x04PONG"[..], context.get(..context.len().min(16)).unwrap_or_default()];
                if self.outbox.len() <= self.waiting + 4 {
                    self.outbox.push_back(control(zmtp::command(&pong.concat())));
                }
            }
            Some((b"SUBSCRIBE", topic)) => self.subscribe(&[&[1][..], topic].concat(), heard),
            Some((b"CANCEL", topic)) => self.subscribe(&[&[0][..], topic].concat(), heard),
            _ => {}
        }
    }

    fn subscribe(&mut self, word: &[u8], heard: &mut Vec<Heard>) {
        let (topic, on) = match word.split_first() {
            Some((1, topic)) if self.topics.len() < MAX_SUBSCRIPTIONS => (topic.to_vec(), true),
            Some((0, topic)) => (topic.to_vec(), false),
            _ => return heard.push(Heard::Ignored),
        };
        let changed =
            if on { self.topics.insert(topic.clone()) } else { self.topics.remove(&topic) };
        if changed {
            self.news.push((topic.clone(), on));
            heard.push(if on { Heard::Subscribed(topic) } else { Heard::Unsubscribed(topic) });
        }
    }

    fn pulse(&mut self, now: Instant) -> Pulse {
        if self.stage != Stage::Open {
            let late = now.saturating_duration_since(self.since) >= options::HANDSHAKE;
            return if late { Pulse::Dead } else { Pulse::Fine };
        }
        if now.saturating_duration_since(self.heard_at) < options::HEARTBEAT {
            self.asked_at = None;
            return Pulse::Fine;
        }
        match self.asked_at {
            // A listener that does not read cannot have heard the question.
            _ if !self.outbox.is_empty() => {
                self.asked_at = None;
                Pulse::Fine
            }
            None => {
                self.asked_at = Some(now);
                Pulse::Ask
            }
            Some(at) if now.saturating_duration_since(at) >= options::HEARTBEAT_TIMEOUT => {
                Pulse::Dead
            }
            Some(_) => Pulse::Fine,
        }
    }
}

impl std::fmt::Debug for Front {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Front").field("peers", &self.peers.len()).finish_non_exhaustive()
    }
}
