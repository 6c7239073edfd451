//! One server for all middlewares: each adds the reading of a request, and the writing and sending
//! of its answer.
//!
//! ```text
//!   take ◀─ ServerWire::read ◀─ Requests ◀── the wire
//!   reply ─▶ with the user? ─▶ ServerWire::write, send ══▶ the wire
//!                └─ too long: its client is told
//! ```

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::calls::ends;
use super::requests::{Asked, Requests};
use super::{
    Clock, Context, DropReason, IncomingRequest, Link, Refusal, Request, RequestId, ServeError,
    ServeResult, Server, ServiceSpec,
};
use wrapyfi_data::types::Payload;
use wrapyfi_data::{DecodeError, EncodeError};

/// Result of sending an answer: its size in bytes, `None` where its client has gone.
pub type Sent = ServeResult<Option<usize>>;

/// The part of a server that differs from one middleware to the next.
pub trait ServerWire: Send {
    /// Form in which a request comes, with the way back to its client.
    type Ask: Send;
    /// Form in which an answer is sent.
    type Answer;
    /// True where clients are told when the server ends before it answered them.
    const TELLS_END: bool = true;

    /// Fetches a request, where the transport has no thread that does.
    ///
    /// # Errors
    /// When the request cannot be served; it is counted, and its client was told.
    fn fetch(&mut self, _requests: &Requests<Self::Ask>) -> ServeResult<()> {
        Ok(())
    }

    /// True for a request whose client does not wait any more.
    fn is_given_up(&self, _asked: &Asked<Self::Ask>) -> bool {
        false
    }

    /// Reads a request.
    fn read(&self, ask: &Self::Ask) -> Result<Request, DecodeError>;

    /// Writes the value that the function returned.
    fn write(&self, ask: &Self::Ask, payload: &Payload) -> Result<Self::Answer, EncodeError>;

    /// Sends an answer, or the reason that there is none; size of the answer in bytes, or `None`
    /// where its client has gone.
    ///
    /// # Errors
    /// When it was not sent.
    fn send(&mut self, ask: Self::Ask, answer: Result<Self::Answer, &str>) -> Sent;

    /// Connection of the server now; its peers are clients.
    fn link(&self) -> Link;

    /// As [`Server::kept`].
    fn kept(&self) -> usize {
        0
    }

    /// As [`Server::flush`].
    fn flush(&mut self) {}

    /// Instant at which to flush though nothing rang.
    fn deadline(&self) -> Option<Instant> {
        None
    }
}

/// A request that the user has taken and not answered.
struct Open<A> {
    asked: Asked<A>,
    until: Instant,
}

/// A server over the wire of one middleware.
pub struct WireServer<W: ServerWire> {
    wire: W,
    requests: Arc<Requests<W::Ask>>,
    service: String,
    timeout: Duration,
    open: BTreeMap<RequestId, Open<W::Ask>>,
    next: u64,
}

impl<W: ServerWire> WireServer<W> {
    /// Server of `spec` that takes requests from `requests` and answers over `wire`.
    pub fn new(wire: W, requests: Arc<Requests<W::Ask>>, spec: &ServiceSpec) -> Self {
        let (service, timeout) = (spec.service.clone(), spec.timeout);
        Self { wire, requests, service, timeout, open: BTreeMap::new(), next: 0 }
    }

    fn clock(&self) -> &Clock {
        &self.requests.context().clock
    }

    fn dropped(&self, reason: DropReason) {
        self.requests.context().counters.dropped(reason);
    }

    fn timeout_ms(&self) -> u64 {
        u64::try_from(self.timeout.as_millis()).unwrap_or(u64::MAX)
    }

    fn close(&mut self, id: RequestId) -> Option<Asked<W::Ask>> {
        let Open { asked, .. } = self.open.remove(&id)?;
        self.requests.ended(asked.bytes);
        Some(asked)
    }

    /// Tells a client the reason that it is not answered, where the wire has room for it.
    fn refuse(&mut self, ask: W::Ask, why: &str) {
        if let Err(error) = self.wire.send(ask, Err(why)) {
            tracing::debug!(service = self.service, %error, "a refusal was not sent");
        }
    }

    /// Drops a request that was taken; its client is told why.
    fn refuse_taken(&mut self, asked: Asked<W::Ask>, reason: DropReason, why: &str) {
        self.requests.ended(asked.bytes);
        self.dropped(reason);
        self.refuse(asked.ask, why);
    }

    fn end_expired(&mut self) {
        let now = self.clock().now();
        let over = self.open.iter().filter(|(_, open)| open.until <= now);
        for id in over.map(|(&id, _)| id).collect::<Vec<_>>() {
            let Some(Open { asked, .. }) = self.open.remove(&id) else { break };
            let text = format!("{:?} did not answer within {} ms", self.service, self.timeout_ms());
            self.refuse_taken(asked, DropReason::Expired, &text);
        }
    }
}

impl<W: ServerWire> Server for WireServer<W> {
    fn take(&mut self) -> ServeResult<Option<IncomingRequest>> {
        self.wire.flush();
        self.end_expired();
        loop {
            self.wire.fetch(&self.requests)?;
            let Some(asked) = self.requests.next() else { return Ok(None) };
            if self.wire.is_given_up(&asked) {
                // The function must not run after its client has given up.
                self.requests.ended(asked.bytes);
                self.dropped(DropReason::Expired);
                continue;
            }
            match self.wire.read(&asked.ask) {
                Ok(request) => {
                    self.next += 1;
                    let id = RequestId(self.next);
                    let until = ends(self.clock().now(), self.timeout);
                    let Asked { bytes: wire_bytes, received_at, .. } = asked;
                    self.open.insert(id, Open { asked, until });
                    return Ok(Some(IncomingRequest { id, request, wire_bytes, received_at }));
                }
                Err(fault) => {
                    let reason = DropReason::from(&fault);
                    let (service, fault) = (self.service.clone(), fault.to_string());
                    let error = ServeError::Request { service, fault, reason };
                    self.refuse_taken(asked, reason, &error.to_string());
                    return Err(error);
                }
            }
        }
    }

    fn reply(&mut self, id: RequestId, answer: Result<Payload, Refusal>) -> ServeResult<usize> {
        let (service, timeout_ms) = (self.service.clone(), self.timeout_ms());
        let asked = self.close(id).ok_or(ServeError::NotWaiting { service, timeout_ms })?;
        let written = match &answer {
            Err(Refusal { text, reason }) => {
                self.dropped(*reason);
                Err(text.as_str())
            }
            Ok(payload) => match self.wire.write(&asked.ask, payload) {
                Ok(written) => Ok(written),
                Err(fault) => {
                    self.dropped(DropReason::Unencodable);
                    let error = ServeError::Reply { service: self.service.clone(), fault };
                    self.refuse(asked.ask, &error.to_string());
                    return Err(error);
                }
            },
        };
        match self.wire.send(asked.ask, written)? {
            bytes if answer.is_err() => Ok(bytes.unwrap_or(0)),
            Some(bytes) => {
                let Context { counters, clock, .. } = self.requests.context();
                counters.sent(bytes, clock.age(asked.received_at));
                Ok(bytes)
            }
            None => {
                self.dropped(DropReason::Late);
                Ok(0)
            }
        }
    }

    fn deadline(&self) -> Option<Instant> {
        self.open.values().map(|open| open.until).chain(self.wire.deadline()).min()
    }

    fn link(&self) -> Link {
        self.wire.link()
    }

    fn kept(&self) -> usize {
        self.wire.kept()
    }

    fn flush(&mut self) {
        self.wire.flush();
    }
}

impl<W: ServerWire> Drop for WireServer<W> {
    fn drop(&mut self) {
        let waiting = self.requests.close();
        let unanswered = (waiting.len() + self.open.len()) as u64;
        let counters = &self.requests.context().counters;
        counters.dropped_many(DropReason::Closed, unanswered);
        if !W::TELLS_END {
            return;
        }
        // Clients that wait learn at once that no answer will come.
        for Open { asked, .. } in std::mem::take(&mut self.open).into_values() {
            let text = format!("{:?} ended before it answered", self.service);
            self.refuse(asked.ask, &text);
        }
        for ask in waiting {
            let text = format!("{:?} ended before it took the request", self.service);
            self.refuse(ask, &text);
        }
    }
}
