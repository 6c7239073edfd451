//! One client for all middlewares: each adds the writing of a request and its transport.
//!
//! ```text
//!   send ─▶ ClientWire::write ─▶ Calls ◀──▶ ClientWire::turn ══ the wire
//!   take ◀───────────────────── Calls ◀── their time is over
//! ```

use std::time::{Duration, Instant};

use super::calls::{Calls, Stage, Ticket, ends};
use super::{CallError, Client, Clock, Context, Link, Reply, Request, Wake};
use wrapyfi_data::EncodeResult;

/// The part of a client that differs from one middleware to the next.
pub trait ClientWire: Send {
    /// Form in which a request waits to be sent.
    type Written: Send;
    /// Largest number of requests that a server keeps: as many are with it at once, the others wait here.
    const AT_ONCE: usize = usize::MAX;

    /// Writes a request that may be sent until `deadline`; also returns its size in bytes.
    fn write(&self, request: &Request, deadline: Instant) -> EncodeResult<(Self::Written, usize)>;

    /// Sends the requests that can be sent, and hands in the replies that have come.
    fn turn(&mut self, calls: &mut Calls<Self::Written>);

    /// Cause and remedy, in words, for a call whose time was over in this stage.
    fn missing(&self, stage: Stage) -> String;

    /// Connection of the client now; its peers are servers.
    fn link(&self) -> Link;

    /// Time after which [`ClientWire::turn`] is called again while a request waits to be sent;
    /// `None` where the transport rings for everything that can change.
    fn look_again(&self) -> Option<Duration> {
        None
    }
}

/// A client over the wire of one middleware.
pub struct WireClient<W: ClientWire> {
    wire: W,
    calls: Calls<W::Written>,
}

impl<W: ClientWire> WireClient<W> {
    /// A client without calls, which refuses to have more than `limit` under way.
    pub fn new(wire: W, service: &str, limit: usize, context: &Context) -> Self {
        Self { wire, calls: Calls::new(service, limit, context).at_once(W::AT_ONCE) }
    }
    /// The part of the middleware.
    pub fn wire(&self) -> &W {
        &self.wire
    }

    fn turn(&mut self) {
        let Self { wire, calls, .. } = self;
        wire.turn(calls);
        calls.expire(calls.clock().now(), |stage| wire.missing(stage));
    }
}

impl<W: ClientWire> Client for WireClient<W> {
    fn send(&mut self, request: &Request, timeout: Duration) -> Result<Ticket, CallError> {
        let now = self.calls.clock().now();
        let written = self.wire.write(request, ends(now, timeout));
        let service = || self.calls.service().to_owned();
        let written = written.map_err(|fault| CallError::Request { service: service(), fault })?;
        let ticket = self.calls.begin(written, now, timeout)?;
        self.turn();
        Ok(ticket)
    }

    fn take(&mut self) -> Option<(Ticket, Result<Reply, CallError>)> {
        self.turn();
        self.calls.take()
    }

    fn take_only(&mut self, ticket: Ticket) -> Option<Result<Reply, CallError>> {
        self.turn();
        self.calls.take_only(ticket)
    }

    fn cancel(&mut self, ticket: Ticket) {
        self.calls.cancel(ticket);
    }

    fn deadline(&self) -> Option<Instant> {
        let deadline = self.calls.deadline()?;
        let look_again = self.calls.next_to_send().and_then(|_| self.wire.look_again());
        Some(look_again.map_or(deadline, |wait| deadline.min(self.calls.clock().now() + wait)))
    }

    fn link(&self) -> Link {
        self.wire.link()
    }

    fn wake(&self) -> &Wake {
        self.calls.wake()
    }

    fn clock(&self) -> &Clock {
        self.calls.clock()
    }
}
