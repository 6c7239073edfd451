//! The connection of a listener to the broker: an XSUB of one topic, from TCP into the listener's inbox.
//!
//! ```text
//!   broker's XPUB ─▶ TCP ─▶ exact topic? ── size? ── ours? ──▶ inbox ──▶ Listener::take
//!                             │ wrong_topic  │ oversize │ own_publication
//!                             ▼              ▼          ▼    counted, dropped
//! ```
//!
//! The I/O thread reads it, or the thread that waits for a message does so itself: then no thread is woken that only
//! passes messages on (see [`Pollable`]).
//!
//! A message of more bytes than a broker of ours takes, which another broker passes on, is passed over and counted by its
//! topic. One of many times that many ends the connection, which is made anew; messages in between are lost at the broker.
//!
//! Every listener has a connection of its own, so a slow route fills its own queue only. Under policy `block` a message
//! that finds no room is held here, then as many as the queue holds, and then nothing more is read; TCP holds what comes
//! meanwhile, and after that the broker drops for this listener.

use std::collections::VecDeque;
use std::net::TcpStream;
use std::os::fd::{AsFd, AsRawFd as _};
use std::sync::Arc;
use std::task::Waker;
use std::time::Instant;

use bytes::Bytes;
use mio::unix::SourceFd;
use mio::{Interest, Registry};

use super::assembly::NotTaken;
use super::connection::{self, Connection, Turn};
use super::heard::{ConnectionEnd, Heard};
use super::io::{Command, Handle, IoEndpoint, IoProgress, token};
use super::link::{self, BrokerLink, Watch};
use super::own_messages::Listening;
use super::peer::Peer;
use super::shared::ZeroMqState;
use super::traffic::DENIED;
use super::zmtp::Kind;
use wrapyfi_data::types::Stamp;
use wrapyfi_endpoint::{
    Context, DropReason, Mutex, Pollable, Receiver, Sender, Share, Throttle, TopicSpec, Waits,
    inbox,
};

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

/// The connection of one listener, used by the I/O thread and by threads that wait for a message, in turn.
pub(super) struct ListenerConnection {
    pub(super) id: u64,
    pub(super) link: Arc<BrokerLink>,
    io: Arc<Handle>,
    context: Context,
    /// Bytes of a message that is read at all.
    most_bytes: usize,
    subscribes: Vec<String>,
    state: Mutex<ListenerState>,
}

struct ListenerState {
    connection: Connection,
    reception: Reception,
    /// A second descriptor of the connection, for threads that wait for it by themselves.
    stream: Option<Arc<TcpStream>>,
    /// True while such a thread watches the connection, and the I/O thread does not.
    is_lent: bool,
}

/// From messages into the inbox.
struct Reception {
    link: Arc<BrokerLink>,
    topic: Bytes,
    /// Bytes of a message, all frames.
    limit: usize,
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

impl ListenerConnection {
    /// A connection that the I/O thread makes, and the inbox that it fills.
    pub(super) fn new(
        shared: &ZeroMqState,
        spec: &TopicSpec,
        context: &Context,
    ) -> (Arc<Self>, Receiver<Arrival>) {
        let io = Arc::clone(&shared.io.handle);
        let id = io.next_id();
        let connection = Connection::new(shared, id, shared.pub_address, &spec.topic);
        let (sender, receiver) = inbox(spec.queue, context);
        let mut subscribes = vec![spec.topic.clone()];
        if shared.keys.is_some() {
            subscribes.push(format!("{DENIED}{}", spec.topic));
        }
        let reception = Reception {
            link: Arc::clone(&connection.link),
            topic: Bytes::copy_from_slice(spec.topic.as_bytes()),
            limit: spec.limits.message_bytes,
            inbox: sender,
            listening: Listening::new(shared.own_messages.of(&spec.topic)),
            room: Waker::from(Arc::new(LookWaker(id, Arc::clone(&io)))),
            pending: VecDeque::new(),
            share: Share::default(),
            held: None,
        };
        let connection = Arc::new(Self {
            id,
            link: Arc::clone(&connection.link),
            io,
            context: context.clone(),
            // What a broker of ours passes on never ends the connection, however small the limit of this topic.
            most_bytes: spec.limits.message_bytes.max(shared.max_frame_bytes),
            subscribes,
            state: Mutex::new(ListenerState {
                connection,
                reception,
                stream: None,
                is_lent: false,
            }),
        });
        (connection, receiver)
    }
}

impl ListenerState {
    /// Reads what has come and writes what waits, on a connection that is there.
    fn use_open(&mut self, now: Instant) -> Turn {
        let Self { connection, reception, .. } = self;
        let turn = connection.use_open(now, |peer| reception.read(peer, now));
        self.after(turn, now)
    }

    /// Takes note of what has become of the connection; the turn, with the time until a message that is held is given up.
    fn after(&mut self, mut turn: Turn, now: Instant) -> Turn {
        if turn.ended.is_some() {
            (self.stream, self.is_lent) = (None, false);
        }
        let held = self.reception.held.as_ref();
        let left = held.map(|(_, deadline)| deadline.saturating_duration_since(now));
        turn.progress.timeout = turn.progress.timeout.into_iter().chain(left).min();
        turn
    }

    /// Has the I/O thread watch the connection again, where a thread that waited did.
    fn take_back(&mut self, id: u64, registry: &Registry) -> std::io::Result<()> {
        if let Some(peer) = self.connection.peer().filter(|_| std::mem::take(&mut self.is_lent)) {
            registry.register(
                &mut SourceFd(&peer.stream.as_raw_fd()),
                token(id),
                Interest::READABLE,
            )?;
        }
        Ok(())
    }
}

impl IoEndpoint for Arc<ListenerConnection> {
    fn look(
        &mut self,
        now: Instant,
        registry: &Registry,
        faults: &mut Throttle,
    ) -> zmq::Result<IoProgress> {
        let mut state = self.state.lock();
        let before = self.link.state();
        let ListenerState { connection, reception, .. } = &mut *state;
        let is_closed = connection.is_closed();
        let begin = |peer: Peer| {
            peer.of_messages(Kind::Xsub, self.most_bytes).subscribing(self.subscribes.clone())
        };
        let turn = connection.turn(now, registry, faults, begin, |peer| match is_closed {
            true => Ok(false),
            false => reception.read(peer, now),
        });
        let turn = state.after(turn, now);
        drop(state);
        if before != self.link.state() {
            self.context.wake.ring();
        }
        Ok(turn.progress)
    }

    fn close(&mut self, now: Instant) {
        self.state.lock().connection.close(now);
    }

    fn end(self: Box<Self>) -> Option<Watch> {
        self.state.lock().reception.give_up();
        None
    }
}

/// A thread that waits for a message reads the connection by itself, in place of the I/O thread.
impl Pollable for ListenerConnection {
    fn lend(&self) -> Option<Arc<dyn AsFd + Send + Sync>> {
        let mut state = self.state.lock();
        let peer = state.connection.peer()?;
        // A message that waits for room has a deadline, and bytes that are not sent yet wait for the I/O thread's event.
        let is_free = peer.is_open() && peer.outbox.is_empty() && state.reception.held.is_none();
        if state.is_lent || !is_free {
            return None;
        }
        self.io.registry.deregister(&mut SourceFd(&peer.stream.as_raw_fd())).ok()?;
        let stream = match &state.stream {
            Some(stream) => Arc::clone(stream),
            None => Arc::new(peer.stream.try_clone().ok()?),
        };
        state.stream = Some(Arc::clone(&stream));
        state.is_lent = true;
        Some(stream)
    }

    fn read(&self) {
        let (now, mut state) = (Instant::now(), self.state.lock());
        if !state.is_lent {
            return;
        }
        let before = self.link.state();
        let turn = state.use_open(now);
        let is_for_io =
            turn.progress.more || turn.ended.is_some() || state.reception.held.is_some();
        drop(state);
        if before != self.link.state() {
            self.context.wake.ring();
        }
        if is_for_io {
            self.io.send(Command::Look(self.id));
        }
    }

    fn give_back(&self) {
        let mut state = self.state.lock();
        if let Err(error) = state.take_back(self.id, &self.io.registry) {
            let now = Instant::now();
            let turn = state.connection.lose(now, &error);
            state.after(turn, now);
            drop(state);
            self.context.wake.ring();
            self.io.send(Command::Look(self.id));
        }
    }
}

impl Reception {
    /// Reads what has come, unless it is full; true where there is more.
    fn read(&mut self, peer: &mut Peer, now: Instant) -> Result<bool, ConnectionEnd> {
        self.settle(now);
        if self.is_full() {
            // Nobody is heard who is not listened to.
            peer.heard_at = now;
            return Ok(false);
        }
        let mut heard = Vec::new();
        let read = connection::read(peer, &mut heard, now);
        for said in heard {
            match said {
                Heard::Message(frames) => self.pending.push_back(frames),
                Heard::NotTaken(not_taken) => self.count_not_taken(&not_taken),
                _ => {}
            }
        }
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

    /// Counts what never found room.
    fn give_up(&mut self) {
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

/// Has the I/O thread look at a listener.
struct LookWaker(u64, Arc<Handle>);

impl std::task::Wake for LookWaker {
    fn wake(self: Arc<Self>) {
        self.1.send(Command::Look(self.0));
    }
}
