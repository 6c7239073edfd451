//! The receiving half of a listener: from its socket into its inbox, on the I/O thread.
//!
//! ```text
//!   SUB ──▶ exact topic? ── size? ── ours? ──▶ inbox ──▶ Listener::take
//!             │ wrong_topic  │ oversize │ own_publication
//!             ▼              ▼          ▼    counted, dropped
//! ```
//!
//! A message with a frame of more than twice what a broker of ours takes, which another broker passes on, never gets here:
//! libzmq cuts the connection at its announcement. It is counted as oversize too, once per connection cut, and the
//! connection is made anew; messages in between are lost at the broker.
//!
//! Every listener has a socket of its own, so a slow route fills its own queue only. Under policy
//! `block` a message that finds no room is held here and the socket is left alone; libzmq's queue
//! and then TCP hold what comes meanwhile, and after that the broker drops for this listener.

use std::os::fd::RawFd;
use std::task::Waker;
use std::time::{Duration, Instant};

use bytes::Bytes;
use mio::Registry;

use super::frames::{Received, receive};
use super::io::{IoEndpoint, IoProgress};
use super::link::{self, Watch};
use super::own_messages::Listening;
use super::traffic::DENIED;
use wrapyfi_data::types::Stamp;
use wrapyfi_endpoint::{DropReason, Sender, Throttle, Waits};

/// Frames of the longest known message (three), with room for what may come.
const MAX_FRAMES: usize = 16;
/// Messages read from one socket before the others have their turn.
const BATCH: usize = 64;

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

pub(super) struct Reception {
    pub(super) socket: zmq::Socket,
    pub(super) watch: Watch,
    pub(super) topic: Vec<u8>,
    pub(super) limit: usize,
    pub(super) inbox: Sender<Arrival>,
    pub(super) listening: Listening,
    /// Has the I/O thread look at this listener when there is room.
    pub(super) room: Waker,
    pub(super) held: Option<(Arrival, Instant)>,
    pub(super) is_closed: bool,
}

impl IoEndpoint for Reception {
    fn descriptors(&self) -> Vec<RawFd> {
        self.socket.get_fd().ok().into_iter().chain(self.watch.fd()).collect()
    }

    fn look(&mut self, now: Instant, _: &Registry, _: &mut Throttle) -> zmq::Result<IoProgress> {
        if self.is_closed {
            return Ok(IoProgress::over());
        }
        // Connecting again may take the signal of what waits to be read.
        let mut more = self.watch.time_left(now) == Some(Duration::ZERO);
        if self.watch.take() {
            self.inbox.context().wake.ring();
        }
        let mut held = self.retry(now);
        if held.is_none() {
            more |= self.read()?;
            let stopped = self.held.is_some();
            // Room that was made before the listener could know that it is waited for.
            held = self.retry(now);
            more |= stopped && held.is_none();
        }
        let timeout = held.into_iter().chain(self.revive(now)).min();
        Ok(IoProgress { more, timeout, over: false })
    }

    fn close(&mut self, _now: Instant) {
        self.is_closed = true;
    }

    fn end(self: Box<Self>) -> Option<Watch> {
        self.watch.link.note(link::ENDED);
        if self.held.is_some() {
            self.inbox.counters().dropped(DropReason::Closed);
        }
        drop(self.socket);
        Some(self.watch)
    }
}

impl Reception {
    /// Connects again if libzmq has given up on the broker. The time until it may have is
    /// returned.
    fn revive(&mut self, now: Instant) -> Option<Duration> {
        let (topic, context) = (String::from_utf8_lossy(&self.topic), self.inbox.context());
        self.watch.revive(&self.socket, &topic, self.limit, context, now)
    }

    /// Places a held message if there is room now, or gives it up at its deadline. The time that
    /// is left is returned.
    fn retry(&mut self, now: Instant) -> Option<Duration> {
        let (arrival, deadline) = self.held.take()?;
        let arrival = self.inbox.offer(arrival, &self.room).err()?;
        if deadline > now {
            self.held = Some((arrival, deadline));
            return Some(deadline - now);
        }
        self.inbox.settle(arrival);
        None
    }

    /// Reads what the socket has, one batch at most; true when there may be more.
    fn read(&mut self) -> zmq::Result<bool> {
        for _ in 0..BATCH {
            if self.held.is_some() {
                return Ok(false);
            }
            let Some(received) = receive(&self.socket, MAX_FRAMES)? else { return Ok(false) };
            self.receive(received);
        }
        Ok(true)
    }

    fn receive(&mut self, Received { frames, count, bytes: wire_bytes }: Received) {
        // Subscribed to with keys only, so that nothing else comes under such a name.
        if frames.first().is_some_and(|first| first.starts_with(DENIED.as_bytes())) {
            self.watch.link.note(link::DENIED);
            return self.inbox.context().wake.ring();
        }
        let counters = self.inbox.counters();
        counters.received(wire_bytes);
        if let Some(reason) = self.objection(&frames, count, wire_bytes) {
            return counters.dropped(reason);
        }
        let received_at = self.inbox.context().clock.now();
        let arrival = Arrival { frames, wire_bytes, received_at, stamp: Stamp::now() };
        if let Err(arrival) = self.inbox.push(arrival) {
            self.held = Some((arrival, Instant::now() + self.inbox.max_wait()));
        }
    }

    fn objection(&self, frames: &[Bytes], count: usize, wire_bytes: usize) -> Option<DropReason> {
        if frames.first().is_none_or(|topic| *topic != self.topic) {
            return Some(DropReason::WrongTopic);
        }
        if wire_bytes > self.limit {
            return Some(DropReason::Oversize);
        }
        if count > MAX_FRAMES {
            return Some(DropReason::Malformed);
        }
        let clock = &self.inbox.context().clock;
        self.listening.is_own(frames, clock).then_some(DropReason::OwnPublication)
    }
}
