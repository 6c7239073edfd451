//! The part of a client or a server that lives on the I/O thread: its socket.
//!
//! ```text
//!   owner ── send ──▶ outgoing ──▶ DEALER ──▶ broker
//!   owner ◀── take ── incoming ◀── DEALER ◀── broker
//!                        └─ a server's are bounded: beyond, the client is told at once
//! ```
//!
//! A DEALER on either side, where Wrapyfi has REQ and REP: those are in lock-step, and one reply
//! that never comes blocks them for ever. On the wire it is the same, envelope for envelope.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use bytes::Bytes;

use super::envelope::{self, Misfit, Parcel};
use super::io::Handle;
use super::link::{self, BrokerLink, Watch};
use super::options;
use super::{Shared, config::FRAME_SLACK};
use crate::endpoint::{Context, DropReason, ServeError, ServiceSpec};

/// Messages read from one socket before the others have their turn.
const BATCH: usize = 64;

/// Which end of a service a line is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum End {
    Client,
    Server,
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

/// Why a body was not kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Unusable {
    TooLarge(usize),
    Frames(usize),
}

/// What the owner of a line and the I/O thread share.
pub(super) struct Post {
    id: u64,
    service: String,
    end: End,
    /// Requests that may be at a server at once, deliveries that may wait at a client.
    limit: usize,
    outgoing: Mutex<VecDeque<(Parcel, Option<Instant>)>>,
    incoming: Mutex<VecDeque<Delivery>>,
    /// Requests that the server has taken.
    open: AtomicUsize,
    link: Arc<BrokerLink>,
    context: Context,
    io: Arc<Handle>,
}

impl Post {
    pub(super) fn link(&self) -> &BrokerLink {
        &self.link
    }

    pub(super) fn context(&self) -> &Context {
        &self.context
    }

    /// Sends as soon as there is a way; not after `until`.
    pub(super) fn send(&self, parcel: Parcel, until: Option<Instant>) {
        lock(&self.outgoing).push_back((parcel, until));
        self.io.send(super::io::Command::Look(self.id));
    }

    pub(super) fn take(&self) -> Option<Delivery> {
        lock(&self.incoming).pop_front()
    }

    /// Tells how many requests the server has taken and not answered.
    pub(super) fn set_open(&self, open: usize) {
        self.open.store(open, Relaxed);
    }

    fn is_full(&self) -> bool {
        lock(&self.incoming).len() + self.open.load(Relaxed) >= self.limit
    }

    /// Ends the line.
    pub(super) fn close(&self) {
        self.io.send(super::io::Command::Close(self.id));
    }
}

fn lock<T>(queue: &Mutex<T>) -> MutexGuard<'_, T> {
    queue.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The socket and what it feeds.
pub(super) struct Line {
    post: Arc<Post>,
    pub(super) socket: zmq::Socket,
    pub(super) watch: Watch,
    message_bytes: usize,
}

impl Line {
    /// Connects to `endpoint` of the broker and hands the socket to the I/O thread.
    pub(super) fn open(
        shared: &Shared,
        endpoint: &str,
        end: End,
        spec: &ServiceSpec,
        context: &Context,
    ) -> zmq::Result<Arc<Post>> {
        let link = BrokerLink::new(endpoint);
        let (socket, watch) = shared.contexts.open(|context| {
            let socket = context.socket(zmq::DEALER)?;
            options::set_common(&socket, shared.ip)?;
            let depth = i32::try_from(spec.pending.clamp(1, 1000)).unwrap_or(1000);
            socket.set_rcvhwm(depth)?;
            socket.set_sndhwm(depth)?;
            // What a lost broker had been given is lost with it; what it had not goes to the next one.
            socket.set_immediate(true)?;
            // Beyond this libzmq cuts the connection: as for listeners.
            let guard = spec.limits.message_bytes.saturating_mul(2).saturating_add(FRAME_SLACK);
            socket.set_maxmsgsize(options::frame_limit(guard))?;
            link::connect(context, socket, &link)
        })?;
        let io = Arc::clone(shared.io.handle());
        let post = Arc::new(Post {
            id: io.next_id(),
            service: spec.service.clone(),
            end,
            limit: match end {
                End::Client => spec.pending.saturating_mul(2),
                End::Server => spec.pending,
            },
            outgoing: Mutex::default(),
            incoming: Mutex::default(),
            open: AtomicUsize::new(0),
            link,
            context: context.clone(),
            io: Arc::clone(&io),
        });
        let message_bytes = spec.limits.message_bytes;
        let line = Self { post: Arc::clone(&post), socket, watch, message_bytes };
        io.send(super::io::Command::Line(line));
        Ok(post)
    }

    pub(super) fn id(&self) -> u64 {
        self.post.id
    }

    pub(super) fn ring(&self) {
        self.post.context.wake.ring();
    }

    /// Connects again if libzmq has given up on the broker. The time until it may have is returned.
    pub(super) fn revive(&mut self, now: Instant) -> Option<Duration> {
        let post = &self.post;
        if self.watch.revive(&self.socket, &post.context.wake, now) {
            post.context.counters.dropped(DropReason::Oversize);
            tracing::warn!(
                service = post.service,
                limit_mib = self.message_bytes / crate::Limits::MIB,
                "a message far above the limit cut the connection to the broker, which is opened again"
            );
        }
        self.watch.patience(now)
    }

    /// Closes the socket, which still sends what was given to it; the watch must be kept until it
    /// is over.
    pub(super) fn close(self) -> Watch {
        if let Err(error) = self.write() {
            tracing::debug!(%error, "the last messages of a service");
        }
        self.post.link.end();
        drop(self.socket);
        self.watch
    }

    /// Sends what waits and has room.
    pub(super) fn write(&self) -> zmq::Result<()> {
        let mut outgoing = lock(&self.post.outgoing);
        let now = Instant::now();
        while let Some((parcel, until)) = outgoing.front() {
            let in_time = until.is_none_or(|until| until > now);
            if in_time && !parcel.send(&self.socket)? {
                break;
            }
            outgoing.pop_front();
        }
        Ok(())
    }

    /// True when there is something to read, or room for what waits to be sent.
    pub(super) fn has_more(&self) -> zmq::Result<bool> {
        let events = self.socket.get_events()?;
        let waits = || !lock(&self.post.outgoing).is_empty();
        Ok(events.contains(zmq::POLLIN) || (events.contains(zmq::POLLOUT) && waits()))
    }

    /// Reads what the socket has, one batch at most.
    pub(super) fn read(&self) -> zmq::Result<()> {
        for _ in 0..BATCH {
            let Some((parcel, size)) = envelope::receive(&self.socket, self.message_bytes)? else {
                break;
            };
            let counters = &self.post.context.counters;
            if self.post.end == End::Server {
                counters.received(size);
            }
            let (envelope, body) = match parcel {
                Ok(Parcel { envelope, body }) => (envelope, Ok(body)),
                Err(Misfit::TooLarge(envelope, size)) => (envelope, Err(Unusable::TooLarge(size))),
                Err(Misfit::Frames(envelope, frames)) => (envelope, Err(Unusable::Frames(frames))),
                Err(Misfit::NoEnvelope) => {
                    if self.post.end == End::Client {
                        counters.received(size);
                    }
                    counters.dropped(DropReason::Malformed);
                    continue;
                }
            };
            if self.post.is_full() {
                self.refuse(envelope, size);
                continue;
            }
            let received_at = Instant::now();
            let delivery = Delivery { envelope, body, wire_bytes: size, received_at };
            lock(&self.post.incoming).push_back(delivery);
            self.ring();
        }
        Ok(())
    }

    /// Drops a message that there is no room for, and says so to a client that waits for it.
    fn refuse(&self, envelope: Vec<Bytes>, size: usize) {
        let post = &self.post;
        if post.end == End::Client {
            // Nobody asked for so many.
            post.context.counters.received(size);
            post.context.counters.dropped(DropReason::QueueFull);
            return;
        }
        post.context.counters.dropped(DropReason::Overloaded);
        let (service, limit) = (post.service.clone(), post.limit);
        let text = ServeError::Overloaded { service, limit }.to_string();
        lock(&post.outgoing).push_back((Parcel::error(envelope, &text), None));
    }
}
