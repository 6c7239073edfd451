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

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::io::ErrorKind;
use std::net::{IpAddr, TcpListener};
use std::os::fd::{AsRawFd as _, RawFd};
use std::sync::Arc;
use std::time::{Duration, Instant};

use bytes::Bytes;
use mio::unix::SourceFd;
use mio::{Events, Interest, Poll, Token};

use super::options;
use super::peer::{Heard, Loss, Message, Peer};
use super::zmtp::Owned;
use wrapyfi_endpoint::DropReason;

/// The token of the port; listeners are counted from 0.
const PORT: Token = Token(usize::MAX);
/// Events taken at once.
const EVENTS: usize = 256;
/// Listeners at once. What is beyond is refused.
const MAX_PEERS: usize = 4096;
/// Bytes read at once.
const READ_BYTES: usize = 64 * 1024;

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

    /// Takes the subscriptions that came since the last call.
    pub(super) fn heard(&mut self) -> Vec<Heard> {
        std::mem::take(&mut self.heard)
    }

    /// Takes the losses that were noticed since the last call.
    pub(super) fn losses(&mut self) -> Vec<Loss> {
        std::mem::take(&mut self.losses)
    }

    /// Handles what happened to the sockets, without waiting.
    pub(super) fn turn(&mut self, now: Instant) -> std::io::Result<()> {
        let mut events = self.take_events();
        let polled = self.poll.poll(&mut events, Some(Duration::ZERO));
        // Those that are read until nothing is left: what else comes is an event again.
        let mut readable: BTreeMap<usize, bool> =
            std::mem::take(&mut self.unread).into_iter().map(|id| (id, true)).collect();
        for event in &events {
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
        self.events = Some(events);
        for (id, to_the_end) in readable {
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
                self.dirty.insert(id);
            } else {
                self.leave(id, &"it does not answer");
            }
        }
        // The process may have files again after it had run out of them.
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
        let message = Message::new(frames.into_iter().map(Owned).collect(), of, None);
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

    /// Reads what a listener has said; without `to_the_end` as far as one look shows that nothing is left.
    fn read(&mut self, id: usize, to_the_end: bool, now: Instant) {
        let Some(peer) = self.peers.get_mut(&id) else { return };
        let mut heard = Vec::new();
        let read = peer.read(&mut self.scratch, &mut heard, to_the_end, now);
        self.dirty.insert(id);
        for one in &heard {
            match one {
                Heard::Subscribed(topic) => {
                    let ids = self.index.entry(topic.clone()).or_default();
                    if ids.insert(id) && ids.len() == 1 {
                        *self.lengths.entry(topic.len()).or_default() += 1;
                    }
                }
                Heard::Unsubscribed(topic) => {
                    unlist(&mut self.index, &mut self.lengths, topic, id);
                }
                Heard::Ignored => {}
            }
        }
        self.heard.append(&mut heard);
        match read {
            Ok(true) => _ = self.unread.insert(id),
            Ok(false) => {}
            Err(why) => self.leave(id, &why),
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
