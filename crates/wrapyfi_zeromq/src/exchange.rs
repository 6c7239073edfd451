//! The part of a client or a server at its connection to the broker: a DEALER.
//!
//! ```text
//!   owner ── post ──▶ outgoing ──▶ TCP ──▶ broker
//!   client ◀── take ── incoming ◀─ TCP ◀── broker
//!   server ◀───────── Requests ◀── TCP ◀── broker    beyond what there is room for, its client is told
//! ```
//!
//! A DEALER on either side, where Wrapyfi has REQ and REP: those are in lock-step, and one reply
//! that never comes blocks them for ever. On the wire it is the same, envelope for envelope.
//!
//! One message at a time is given to the connection: what waits behind it is not lost where the connection ends.

use std::collections::VecDeque;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Instant;

use bytes::Bytes;

use super::connection::{self, SocketRole};
use super::envelope::{self, ServiceMessage};
use super::heard::{ConnectionEnd, Heard};
use super::message::Message;
use super::options::FRAME_SLACK;
use super::peer::Peer;
use super::shared::ZeroMqState;
use super::socket::Socket;
use super::zmtp::Kind;
use wrapyfi_data::DecodeError;
use wrapyfi_endpoint::requests::Requests;
use wrapyfi_endpoint::{Context, DropReason, Outbox, Overflow, ServiceSpec, Share, Waits};

/// End of a service that a socket is.
#[derive(Debug)]
pub(super) enum ServiceRole {
    Client,
    /// Server with the queue of its requests.
    Server(Arc<Requests<Delivery>>),
}

/// A message that came.
#[derive(Debug)]
pub(super) struct Delivery {
    pub(super) envelope: Vec<Bytes>,
    /// The body, or the size of one that is too large, or the number of frames that it has.
    pub(super) body: Result<Bytes, Unusable>,
    pub(super) wire_bytes: usize,
    pub(super) received_at: Instant,
}

/// Reason why a body was not kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Unusable {
    TooLarge(usize),
    Frames(usize),
}

impl Unusable {
    /// The fault, where one frame of at most `limit` bytes was wanted.
    pub(super) fn fault(self, wanted: &str, limit: usize) -> DecodeError {
        match self {
            Self::TooLarge(size) => DecodeError::too_large(size, limit),
            Self::Frames(frames) => DecodeError::mismatch(
                format!("a {wanted} of one frame"),
                format!("{frames} frames"),
            ),
        }
    }
}

/// A message that waits to be sent.
struct Waiting {
    message: ServiceMessage,
    /// Instant after which no caller waits for it any more.
    until: Option<Instant>,
    /// Bytes that its server counts as sent already.
    sent_bytes: Option<usize>,
    /// Bytes that count while it waits: those of a request count until its call has ended.
    bytes: usize,
}

impl Waits for Waiting {
    fn bytes(&self) -> usize {
        self.bytes
    }
}

/// A client or a server of one pair of ports.
pub(super) struct Exchange {
    service: String,
    end: ServiceRole,
    /// Deliveries that may wait at a client.
    limit: usize,
    /// Bytes of one body.
    message_bytes: usize,
    outgoing: Outbox<Waiting>,
    incoming: VecDeque<Delivery>,
    /// Bytes that came and were not taken.
    received: Share,
    context: Context,
    /// True where the connection has CURVE, which seals each message for itself.
    is_sealed: bool,
}

impl Exchange {
    /// A socket of a client or a server, which the I/O thread connects to `broker`.
    pub(super) fn open(
        shared: &ZeroMqState,
        broker: SocketAddr,
        end: ServiceRole,
        spec: &ServiceSpec,
        context: &Context,
    ) -> Arc<Socket<Self>> {
        let exchange = Self {
            service: spec.service.clone(),
            end,
            limit: spec.pending.saturating_mul(2),
            message_bytes: spec.limits.message_bytes,
            outgoing: Outbox::default(),
            incoming: VecDeque::new(),
            received: Share::default(),
            context: context.clone(),
            is_sealed: shared.keys.is_some(),
        };
        let connection = shared.unlisted(broker, &spec.service);
        let socket = Socket::open(&shared.io.handle, connection, exchange, context);
        socket.read_by_waiters();
        socket
    }

    fn is_server(&self) -> bool {
        matches!(self.end, ServiceRole::Server(_))
    }

    fn queue(
        &mut self,
        message: ServiceMessage,
        until: Option<Instant>,
        sent_bytes: Option<usize>,
    ) -> Result<(), ServiceMessage> {
        let bytes = if self.is_server() { message.size() } else { 0 };
        let waiting = Waiting { message, until, sent_bytes, bytes };
        let queued = self.outgoing.push(waiting, usize::MAX, Overflow::DropNewest, drop);
        queued.map_err(|(waiting, _)| waiting.message)
    }

    /// Queues the reason why there is no reply, unless there is no room even for that: then the other side learns by
    /// its time-out.
    fn refuse(&mut self, envelope: Vec<Bytes>, why: &str) {
        _ = self.queue(ServiceMessage::error(envelope, why), None, None);
    }

    /// Takes a message that came.
    fn receive(&mut self, frames: Vec<Bytes>) {
        let Context { counters, clock, .. } = &self.context;
        let wire_bytes = frames.iter().map(Bytes::len).sum();
        let Some((envelope, body)) = envelope::split(frames) else {
            counters.received(wire_bytes);
            return counters.dropped(DropReason::Malformed);
        };
        let body = match body {
            Ok(body) if body.len() > self.message_bytes => Err(Unusable::TooLarge(body.len())),
            body => body.map_err(Unusable::Frames),
        };
        self.deliver(Delivery { envelope, body, wire_bytes, received_at: clock.now() });
    }

    /// Hands a message on; where there is no room for a request, its client is told.
    fn deliver(&mut self, delivery: Delivery) {
        let (size, counters) = (delivery.wire_bytes, &self.context.counters);
        match &self.end {
            ServiceRole::Server(requests) => {
                if let Err((Delivery { envelope, .. }, error)) = requests.put(delivery, size) {
                    self.refuse(envelope, &error.to_string());
                }
            }
            ServiceRole::Client if self.incoming.len() >= self.limit => {
                // The client has not asked for so many.
                counters.received(size);
                counters.dropped(DropReason::QueueFull);
            }
            ServiceRole::Client if !self.received.take(size) => {
                counters.received(size);
                counters.dropped(DropReason::OverBudget);
            }
            ServiceRole::Client => {
                self.incoming.push_back(delivery);
                self.context.wake.ring();
            }
        }
    }
}

impl Socket<Exchange> {
    /// Sends as soon as there is a way, not after `until`; the message comes back where it finds no room.
    pub(super) fn post(
        &self,
        message: ServiceMessage,
        until: Option<Instant>,
    ) -> Result<(), ServiceMessage> {
        self.send(|exchange, _| {
            let sent_bytes = exchange.is_server().then(|| message.size());
            exchange.queue(message, until, sent_bytes)
        })
    }

    /// Tells the other side why it gets no reply.
    pub(super) fn refuse(&self, envelope: Vec<Bytes>, why: &str) {
        self.send(|exchange, _| exchange.refuse(envelope, why));
    }

    /// The next reply, of a client.
    pub(super) fn take(&self) -> Option<Delivery> {
        self.with(|exchange, _| {
            let next = exchange.incoming.pop_front()?;
            exchange.received.give(next.wire_bytes);
            Some(next)
        })
    }
}

impl SocketRole for Exchange {
    fn begin(&mut self, peer: Peer) -> Peer {
        // One that is somewhat too large is received, and answered with that.
        let limit = self.message_bytes.saturating_mul(2).saturating_add(FRAME_SLACK);
        peer.of_messages(Kind::Dealer, limit)
    }

    fn read(&mut self, peer: &mut Peer, now: Instant) -> Result<bool, ConnectionEnd> {
        let read = connection::read(self, peer, now);
        if let Err(ConnectionEnd::TooLarge(why)) = &read {
            self.context.counters.dropped(DropReason::Oversize);
            tracing::warn!(
                service = self.service,
                "{why} ended the connection to the broker, which is made again: raise max_message_mib, or send less"
            );
        }
        read
    }

    fn hear(&mut self, said: Heard) {
        if let Heard::Message(frames) = said {
            self.receive(frames);
        }
    }

    fn write(&mut self, peer: &mut Peer) -> bool {
        let now = self.context.clock.now();
        while let Some(Waiting { message, until, sent_bytes, .. }) = self.outgoing.first() {
            if until.is_none_or(|until| until > now) {
                let of = sent_bytes.map(|bytes| (Bytes::new(), bytes));
                let message = Message::new(message.frames(0), self.is_sealed, of, None);
                if peer.queue(&message, None).is_err() {
                    return false;
                }
                _ = self.outgoing.pop();
                return true;
            }
            _ = self.outgoing.pop();
        }
        false
    }

    /// Replies are sent before the socket is closed; nobody waits for the reply to a request.
    fn waits(&self) -> bool {
        self.is_server() && !self.outgoing.is_empty()
    }

    fn ended(&mut self, peer: &Peer, reason: DropReason) {
        for (bytes, _) in peer.outbox.unsent() {
            self.context.counters.undelivered(reason, bytes);
        }
    }

    fn end(&mut self) {
        for bytes in self.outgoing.drain().filter_map(|left| left.sent_bytes) {
            self.context.counters.undelivered(DropReason::Closed, bytes);
        }
    }
}
