//! The part of a listener at its connection to the broker: an XSUB of one topic, from TCP into the listener's inbox.
//!
//! ```text
//!   broker's XPUB ─▶ TCP ─▶ exact topic? ── size? ── ours? ──▶ inbox ──▶ Listener::take
//!                             │ wrong_topic  │ oversize │ own_publication
//!                             ▼              ▼          ▼    counted, dropped
//! ```
//!
//! The I/O thread reads it, or the thread that waits for a message does so itself: then no thread is woken that only
//! passes messages on (see `Socket`).
//!
//! A message of more bytes than a broker of ours takes, which another broker passes on, is passed over and counted by its
//! topic. One of many times that many ends the connection, which is made anew; messages in between are lost at the broker.
//!
//! Every listener has a connection of its own, so a slow route fills its own queue only. Under policy `block` a message
//! that finds no room is held here, then as many as the queue holds, and then nothing more is read; TCP holds what comes
//! meanwhile, and after that the broker drops for this listener.

use std::collections::VecDeque;
use std::sync::Arc;
use std::task::Waker;
use std::time::Instant;

use bytes::Bytes;

use super::assembly::NotTaken;
use super::connection::{self, SocketRole};
use super::heard::{ConnectionEnd, Heard};
use super::link::{self, BrokerLink};
use super::own_messages::Listening;
use super::peer::Peer;
use super::shared::ZeroMqState;
use super::socket::{LookWaker, Socket};
use super::traffic::DENIED;
use super::zmtp::Kind;
use wrapyfi_data::types::Stamp;
use wrapyfi_endpoint::{Context, DropReason, Receiver, Sender, Share, TopicSpec, Waits, inbox};

/// Frames of the longest known message (three), with room for what may come.
const MAX_FRAMES: usize = 16;
/// Messages that may wait here for room in an inbox.
const MOST_PENDING: usize = 1000;

/// A message as it came, all frames.
pub(super) struct Arrival {
    pub(super) frames: Vec<Bytes>,
    pub(super) wire_bytes: usize,
    pub(super) received_at: Instant,
    pub(super) stamp: Stamp,
}

impl Waits for Arrival {
    fn bytes(&self) -> usize {
        self.wire_bytes
    }
}

/// A listener of one topic.
pub(super) struct Reception {
    link: Arc<BrokerLink>,
    topic: Bytes,
    subscribes: Vec<String>,
    /// Bytes of a message, all frames.
    limit: usize,
    /// Bytes of a message that is read at all.
    most_bytes: usize,
    inbox: Sender<Arrival>,
    listening: Listening,
    /// Has the I/O thread look at this listener when there is room.
    room: Waker,
    /// Messages that came behind one that is held, with their bytes.
    pending: VecDeque<Vec<Bytes>>,
    share: Share,
    /// Message that found no room, and the end of the time that it may wait for some.
    held: Option<(Arrival, Instant)>,
}

impl Reception {
    /// A listener's socket, which the I/O thread connects, and the inbox that it fills.
    pub(super) fn open(
        shared: &ZeroMqState,
        spec: &TopicSpec,
        context: &Context,
    ) -> (Arc<Socket<Self>>, Receiver<Arrival>) {
        let connection = shared.connection(shared.pub_address, &spec.topic);
        let (sender, receiver) = inbox(spec.queue, context);
        let mut subscribes = vec![spec.topic.clone()];
        if shared.keys.is_some() {
            subscribes.push(format!("{DENIED}{}", spec.topic));
        }
        let io = &shared.io.handle;
        let reception = Self {
            link: Arc::clone(&connection.link),
            topic: Bytes::copy_from_slice(spec.topic.as_bytes()),
            subscribes,
            limit: spec.limits.message_bytes,
            // What a broker of ours passes on never ends the connection, however small the limit of this topic.
            most_bytes: spec.limits.message_bytes.max(shared.max_frame_bytes),
            inbox: sender,
            listening: Listening::new(shared.own_messages.of(&spec.topic)),
            room: Waker::from(Arc::new(LookWaker(connection.id, Arc::clone(io)))),
            pending: VecDeque::new(),
            share: Share::default(),
            held: None,
        };
        let socket = Socket::open(io, connection, reception, context);
        socket.read_by_waiters();
        (socket, receiver)
    }
}

impl SocketRole for Reception {
    const IS_SENT_ON: bool = false;

    fn begin(&mut self, peer: Peer) -> Peer {
        peer.of_messages(Kind::Xsub, self.most_bytes).subscribing(self.subscribes.clone())
    }

    /// Reads what has come, unless there is no room.
    fn read(&mut self, peer: &mut Peer, now: Instant) -> Result<bool, ConnectionEnd> {
        // After the listener's end, nothing more is received.
        if self.inbox.is_closed() {
            return Ok(false);
        }
        self.settle(now);
        if self.is_full() {
            // Nobody is heard who is not listened to.
            peer.heard_at = now;
            return Ok(false);
        }
        let read = connection::read(self, peer, now);
        self.settle(now);
        if let Err(ConnectionEnd::TooLarge(why)) = &read {
            let topic = String::from_utf8_lossy(&self.topic);
            tracing::warn!(
                %topic,
                "the broker passed on {why}, many times over: the connection is made again; raise max_message_mib, or \
                 send less"
            );
        }
        read
    }

    fn hear(&mut self, said: Heard) {
        match said {
            Heard::Message(frames) => self.pending.push_back(frames),
            Heard::NotTaken(not_taken) => self.count_not_taken(&not_taken),
            _ => {}
        }
    }

    fn next_look(&self) -> Option<Instant> {
        self.held.as_ref().map(|(_, deadline)| *deadline)
    }

    /// Counts what never found room.
    fn end(&mut self) {
        let counters = self.inbox.counters();
        for frames in self.pending.drain(..) {
            counters.received(frames.iter().map(Bytes::len).sum());
            counters.dropped(DropReason::Closed);
        }
        if self.held.take().is_some() {
            counters.dropped(DropReason::Closed);
        }
    }
}

impl Reception {
    /// Places the message that is held and those behind it, as far as there is room now or their time is over.
    fn settle(&mut self, now: Instant) {
        loop {
            if let Some((arrival, deadline)) = self.held.take()
                && let Err(arrival) = self.inbox.offer(arrival, &self.room)
            {
                if deadline > now {
                    self.held = Some((arrival, deadline));
                    return;
                }
                self.inbox.settle(arrival);
            }
            match self.pending.pop_front() {
                Some(frames) => self.receive(frames),
                None => return,
            }
        }
    }

    /// True where no more may wait here for room in the inbox.
    fn is_full(&mut self) -> bool {
        let bytes = self.pending.iter().flatten().map(Bytes::len).sum();
        let has_room = self.share.hold(bytes);
        self.held.is_some()
            && (!has_room || self.pending.len() >= self.inbox.spec().depth.clamp(1, MOST_PENDING))
    }

    fn receive(&mut self, frames: Vec<Bytes>) {
        // Subscribed to with keys only, so that nothing else comes under such a name.
        if frames.first().is_some_and(|first| first.starts_with(DENIED.as_bytes())) {
            self.link.note(link::DENIED);
            return self.inbox.context().wake.ring();
        }
        let wire_bytes = frames.iter().map(Bytes::len).sum();
        let counters = self.inbox.counters();
        counters.received(wire_bytes);
        if let Some(reason) = self.objection(&frames, wire_bytes) {
            return counters.dropped(reason);
        }
        let received_at = self.inbox.context().clock.now();
        let arrival = Arrival { frames, wire_bytes, received_at, stamp: Stamp::now() };
        if let Err(arrival) = self.inbox.push(arrival) {
            self.held = Some((arrival, Instant::now() + self.inbox.max_wait()));
        }
    }

    fn objection(&self, frames: &[Bytes], wire_bytes: usize) -> Option<DropReason> {
        if frames.first().is_none_or(|topic| *topic != self.topic) {
            return Some(DropReason::WrongTopic);
        }
        if wire_bytes > self.limit {
            return Some(DropReason::Oversize);
        }
        if frames.len() > MAX_FRAMES {
            return Some(DropReason::Malformed);
        }
        let clock = &self.inbox.context().clock;
        self.listening.is_own(frames, clock).then_some(DropReason::OwnPublication)
    }

    /// Counts a message that was passed over as it came.
    fn count_not_taken(&self, NotTaken { topic, reason }: &NotTaken) {
        let counters = self.inbox.counters();
        counters.received(topic.len());
        let is_ours = *topic == self.topic;
        counters.dropped(if is_ours { *reason } else { DropReason::WrongTopic });
    }
}
