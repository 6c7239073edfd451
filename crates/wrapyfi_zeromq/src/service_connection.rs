//! The part of a client or a server that lives on the I/O thread: its socket.
//!
//! ```text
//!   owner ── send ──▶ outgoing ──▶ DEALER ──▶ broker
//!   client ◀── take ── incoming ◀─ DEALER ◀── broker
//!   server ◀───────── Requests ◀──── DEALER ◀── broker    beyond what there is room for, its client is told
//! ```
//!
//! A DEALER on either side, where Wrapyfi has REQ and REP: those are in lock-step, and one reply
//! that never comes blocks them for ever. On the wire it is the same, envelope for envelope.

use std::collections::VecDeque;
use std::os::fd::RawFd;
use std::sync::Arc;
use std::time::{Duration, Instant};

use bytes::Bytes;
use mio::Registry;

use super::contexts;
use super::envelope::{self, ServiceMessage};
use super::frames::{Received, receive};
use super::io::{self, Command, Handle, IoProgress};
use super::link::{self, BrokerLink, Watch};
use super::options::{self, SEND_HWM};
use super::shared::ZeroMqState;
use wrapyfi_data::DecodeError;
use wrapyfi_endpoint::requests::Requests;
use wrapyfi_endpoint::{
    Context, DropReason, Mutex, OpenResult, Outbox, Overflow, ServiceSpec, Share, Throttle, Waits,
};

/// Messages read from one socket before the others have their turn.
const BATCH: usize = 64;

/// End of a service that a connection is.
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

/// State that the owner of a connection and the I/O thread share.
pub(super) struct ServiceHandle {
    pub(super) id: u64,
    service: String,
    end: ServiceRole,
    /// Deliveries that may wait at a client.
    limit: usize,
    outgoing: Mutex<Outbox<Waiting>>,
    incoming: Mutex<VecDeque<Delivery>>,
    /// Bytes that came and were not taken.
    received: Share,
    pub(super) link: Arc<BrokerLink>,
    pub(super) context: Context,
    io: Arc<Handle>,
}

impl ServiceHandle {
    /// Sends as soon as there is a way, not after `until`; the message comes back where it finds no room.
    pub(super) fn send(
        &self,
        message: ServiceMessage,
        until: Option<Instant>,
    ) -> Result<(), ServiceMessage> {
        let sent_bytes = matches!(self.end, ServiceRole::Server(_)).then(|| message.size());
        self.queue(message, until, sent_bytes)
    }

    /// Tells the other side why it gets no reply, unless there is no room even for that: then it learns by its
    /// time-out.
    pub(super) fn refuse(&self, envelope: Vec<Bytes>, why: &str) {
        _ = self.queue(ServiceMessage::error(envelope, why), None, None);
    }

    fn queue(
        &self,
        message: ServiceMessage,
        until: Option<Instant>,
        sent_bytes: Option<usize>,
    ) -> Result<(), ServiceMessage> {
        let bytes = if matches!(self.end, ServiceRole::Server(_)) { message.size() } else { 0 };
        let waiting = Waiting { message, until, sent_bytes, bytes };
        let queued = self.outgoing.lock().push(waiting, usize::MAX, Overflow::DropNewest, drop);
        queued.map_err(|(waiting, _)| waiting.message)?;
        self.io.send(Command::Look(self.id));
        Ok(())
    }

    pub(super) fn take(&self) -> Option<Delivery> {
        let next = self.incoming.lock().pop_front()?;
        self.received.give(next.wire_bytes);
        Some(next)
    }

    /// Ends the connection.
    pub(super) fn close(&self) {
        self.io.send(Command::Close(self.id));
    }
}

/// The socket and what it feeds.
pub(super) struct ServiceConnection {
    handle: Arc<ServiceHandle>,
    socket: zmq::Socket,
    watch: Watch,
    message_bytes: usize,
    /// Instant until which replies are still sent, because the server is closed.
    closes: Option<Instant>,
}

impl io::IoEndpoint for ServiceConnection {
    fn descriptors(&self) -> Vec<RawFd> {
        self.socket.get_fd().ok().into_iter().chain(self.watch.fd()).collect()
    }

    fn look(&mut self, now: Instant, _: &Registry, _: &mut Throttle) -> zmq::Result<IoProgress> {
        // Connecting again may take the signal of what waits to be read.
        let mut more = self.watch.time_left(now) == Some(Duration::ZERO);
        if self.watch.take() {
            self.handle.context.wake.ring();
        }
        self.write()?;
        self.read()?;
        // Last: reading or writing may have taken the signal of what the other could not do before.
        more |= self.has_more()?;
        let lingers = self.lingers(now);
        let timeout = self.revive(now).into_iter().chain(lingers).min();
        Ok(IoProgress { more, timeout, over: lingers == Some(Duration::ZERO) })
    }

    /// Has the socket closed once what waits is sent, or some time has passed.
    fn close(&mut self, now: Instant) {
        self.closes.get_or_insert(now + options::LINGER);
    }

    /// Closes the socket, which still sends what was given to it.
    fn end(self: Box<Self>) -> Option<Watch> {
        // What the broker had no room for until now is lost with the socket.
        for bytes in self.handle.outgoing.lock().drain().filter_map(|left| left.sent_bytes) {
            self.handle.context.counters.undelivered(DropReason::Closed, bytes);
        }
        self.handle.link.note(link::ENDED);
        drop(self.socket);
        Some(self.watch)
    }
}

impl ServiceConnection {
    /// Connects to `endpoint` of the broker and hands the socket to the I/O thread.
    pub(super) fn open(
        shared: &ZeroMqState,
        endpoint: &str,
        end: ServiceRole,
        spec: &ServiceSpec,
        context: &Context,
    ) -> OpenResult<Arc<ServiceHandle>> {
        let link = BrokerLink::new(endpoint, &spec.service, shared.keys.as_ref());
        let opened = shared.contexts.open(|context| {
            let socket = context.socket(zmq::DEALER)?;
            options::set_common(&socket, shared.ip)?;
            let depth = i32::try_from(spec.pending.clamp(1, 1000)).unwrap_or(1000);
            socket.set_rcvhwm(depth)?;
            // What a slow broker does not take waits here, where its bytes count.
            socket.set_sndhwm(i32::from(SEND_HWM))?;
            // A server's replies belong to the clients of one broker, and go with it. What a client has received must
            // not: libzmq would throw away a reply that came just before its broker ended.
            socket.set_immediate(matches!(end, ServiceRole::Server(_)))?;
            options::set_message_limit(&socket, spec.limits.message_bytes)?;
            link::connect(context, socket, &link, shared.keys.as_ref())
        });
        let (socket, watch) = opened.map_err(|error| contexts::refused(&spec.service, error))?;
        let io = Arc::clone(&shared.io.handle);
        let handle = Arc::new(ServiceHandle {
            id: io.next_id(),
            service: spec.service.clone(),
            end,
            limit: spec.pending.saturating_mul(2),
            outgoing: Mutex::default(),
            incoming: Mutex::default(),
            received: Share::default(),
            link,
            context: context.clone(),
            io: Arc::clone(&io),
        });
        let message_bytes = spec.limits.message_bytes;
        let connection =
            Self { handle: Arc::clone(&handle), socket, watch, message_bytes, closes: None };
        io.send(Command::Open(handle.id, Box::new(connection)));
        Ok(handle)
    }

    /// Connects again if libzmq has given up on the broker. The time until it may have is returned.
    fn revive(&mut self, now: Instant) -> Option<Duration> {
        let (handle, limit) = (&self.handle, self.message_bytes);
        self.watch.revive(&self.socket, &handle.service, limit, &handle.context, now)
    }

    /// Time for which replies are still waited for to be sent; `None` while the connection is in use.
    fn lingers(&self, now: Instant) -> Option<Duration> {
        let left = self.closes?.saturating_duration_since(now);
        let sends = matches!(self.handle.end, ServiceRole::Server(_)) && self.handle.link.is_up();
        let waits = sends && !self.handle.outgoing.lock().is_empty();
        Some(if waits { left } else { Duration::ZERO })
    }

    /// Sends what waits and has room; a client does so while the broker is there, because libzmq takes requests for
    /// one that is not.
    fn write(&self) -> zmq::Result<()> {
        if !self.may_write() {
            return Ok(());
        }
        let mut outgoing = self.handle.outgoing.lock();
        let now = self.handle.context.clock.now();
        while let Some(Waiting { message, until, .. }) = outgoing.first() {
            let in_time = until.is_none_or(|until| until > now);
            if in_time && !message.send(&self.socket)? {
                break;
            }
            _ = outgoing.pop();
        }
        Ok(())
    }

    fn may_write(&self) -> bool {
        matches!(self.handle.end, ServiceRole::Server(_)) || self.handle.link.is_up()
    }

    /// True when there is something to read, or room for what waits to be sent.
    fn has_more(&self) -> zmq::Result<bool> {
        let events = self.socket.get_events()?;
        let waits = || self.may_write() && !self.handle.outgoing.lock().is_empty();
        Ok(events.contains(zmq::POLLIN) || (events.contains(zmq::POLLOUT) && waits()))
    }

    /// Reads what the socket has, one batch at most.
    fn read(&self) -> zmq::Result<()> {
        for _ in 0..BATCH {
            let Some(Received { frames, count, bytes }) = receive(&self.socket, envelope::KEPT)?
            else {
                break;
            };
            let Context { counters, clock, .. } = &self.handle.context;
            let Some((envelope, body)) = envelope::split(frames, count) else {
                counters.received(bytes);
                counters.dropped(DropReason::Malformed);
                continue;
            };
            let body = match body {
                Ok(body) if body.len() > self.message_bytes => Err(Unusable::TooLarge(body.len())),
                body => body.map_err(Unusable::Frames),
            };
            let delivery = Delivery { envelope, body, wire_bytes: bytes, received_at: clock.now() };
            self.deliver(delivery);
        }
        Ok(())
    }

    /// Hands a message on; where there is no room for a request, its client is told.
    fn deliver(&self, delivery: Delivery) {
        let (handle, size) = (&self.handle, delivery.wire_bytes);
        match &handle.end {
            ServiceRole::Server(requests) => {
                if let Err((Delivery { envelope, .. }, error)) = requests.put(delivery, size) {
                    handle.refuse(envelope, &error.to_string());
                }
            }
            ServiceRole::Client if handle.incoming.lock().len() >= handle.limit => {
                // The client has not asked for so many.
                handle.context.counters.received(size);
                handle.context.counters.dropped(DropReason::QueueFull);
            }
            ServiceRole::Client if !handle.received.take(size) => {
                handle.context.counters.received(size);
                handle.context.counters.dropped(DropReason::OverBudget);
            }
            ServiceRole::Client => {
                handle.incoming.lock().push_back(delivery);
                handle.context.wake.ring();
            }
        }
    }
}
