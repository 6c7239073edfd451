//! Requests and replies: the seam for functions that run elsewhere.
//!
//! ```text
//!   engine, command line, communicator
//!        │ send()      ▲ take()                  take() ▲      │ reply()
//!   ┌────▼─────────────┴───┐                    ┌───────┴──────▼───┐
//!   │ Client: calls under  │ ── Request ──────▶ │ Server: requests │
//!   │ way, their deadlines │ ◀─ Payload, error ─│ under way        │
//!   └──────────────────────┘                    └──────────────────┘
//! ```
//!
//! A request is a call as Wrapyfi makes it: positional and keyword arguments. A reply is a payload
//! of the kind that the service returns, or the server's word that there is none.
//!
//! Nothing here waits but [`Client::call`]: [`Context::wake`](super::Context::wake) rings when there
//! is something to take, and `deadline` tells when to look though nobody rang.

use std::time::{Duration, Instant};

use super::calls::Ticket;
use super::service_error::{CallError, ServeError};
use super::{BridgeMark, Link, Wake};
use crate::Limits;
use crate::plugin::Plugins;
use crate::types::{Encoding, Map, Payload, ServiceKind, Value};

/// A call of a function: what Wrapyfi's `request(*args, **kwargs)` is given.
///
/// ```
/// use wrapyfi_core::endpoint::Request;
/// use wrapyfi_core::types::Map;
/// let request = Request::new([1.into(), "a".into()]).with(Map::from([("scale", 0.5)]));
/// assert_eq!(request.args.len(), 2);
/// assert_eq!(request.kwargs.get("scale").and_then(|scale| scale.as_f64()), Some(0.5));
/// ```
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Request {
    /// Positional arguments.
    pub args: Vec<Value>,
    /// Keyword arguments; the keys are text.
    pub kwargs: Map,
}

impl Request {
    /// A call with positional arguments only.
    #[must_use]
    pub fn new(args: impl Into<Vec<Value>>) -> Self {
        Self { args: args.into(), kwargs: Map::new() }
    }

    /// The same call with these keyword arguments.
    #[must_use]
    pub fn with(self, kwargs: Map) -> Self {
        Self { kwargs, ..self }
    }
}

/// What came back from a call.
#[derive(Debug, Clone, PartialEq)]
pub struct Reply {
    /// What the function returned.
    pub payload: Payload,
    /// Size on the wire in bytes, all frames.
    pub wire_bytes: usize,
    /// When its last byte was here.
    pub received_at: Instant,
}

/// Names a request among those that one server has taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct RequestId(pub(crate) u64);

/// A request as its server takes it.
#[derive(Debug, Clone, PartialEq)]
pub struct IncomingRequest {
    /// What [`Server::reply`] wants to know.
    pub id: RequestId,
    /// The call.
    pub request: Request,
    /// Size on the wire in bytes, all frames.
    pub wire_bytes: usize,
    /// When its last byte was here.
    pub received_at: Instant,
}

/// Which service to call or to offer, and how its calls are treated.
#[derive(Debug, Clone, PartialEq)]
pub struct ServiceSpec {
    /// Name in that middleware, for instance `/light`. On ZeroMQ it names nothing but log lines.
    pub service: String,
    /// What the function returns.
    pub kind: ServiceKind,
    /// Time that a request has at its server, from its arrival to its answer: 5 s. Calls are given
    /// theirs one by one.
    pub timeout: Duration,
    /// Calls of a client, or requests at a server, that may be under way at once: 64.
    pub pending: usize,
    /// Channel order of three-channel images on Wrapyfi's side; [`Encoding::Bgr8`] by custom.
    pub color_order: Encoding,
    /// Bounds on every request and reply.
    pub limits: Limits,
    /// What reads and writes plug-in objects inside native objects.
    pub plugins: Plugins,
    /// Settings that only some middlewares have, by name, such as `carrier`.
    pub options: Map,
    /// What a server announces where there is room for it: that a bridge made it by pattern.
    pub mark: Option<BridgeMark>,
}

impl ServiceSpec {
    /// Time that a call or a request has unless said otherwise.
    pub const TIMEOUT: Duration = Duration::from_secs(5);
    /// Calls or requests under way at once unless said otherwise.
    pub const PENDING: usize = 64;

    /// A service with the default time-out and limits.
    #[must_use]
    pub fn new(service: impl Into<String>, kind: ServiceKind) -> Self {
        Self {
            service: service.into(),
            kind,
            timeout: Self::TIMEOUT,
            pending: Self::PENDING,
            color_order: Encoding::Bgr8,
            limits: Limits::default(),
            plugins: Plugins::standard(),
            options: Map::default(),
            mark: None,
        }
    }
}

/// Calls one service.
pub trait Client: Send {
    /// Begins a call, which [`Client::take`] will end within `timeout`: with its reply, or with why
    /// there is none. A call made before there is a server waits for one.
    ///
    /// # Errors
    /// When the request has no form on this wire, or too many calls are under way: nothing is sent.
    fn send(&mut self, request: &Request, timeout: Duration) -> Result<Ticket, CallError>;

    /// A call that has ended, if one has.
    fn take(&mut self) -> Option<(Ticket, Result<Reply, CallError>)>;

    /// How this call ended, if it has; the others can be taken later.
    fn take_only(&mut self, ticket: Ticket) -> Option<Result<Reply, CallError>>;

    /// Forgets a call. Its reply, if it comes, is counted as late.
    fn cancel(&mut self, ticket: Ticket);

    /// When [`Client::take`] should be called again though nothing rang.
    fn deadline(&self) -> Option<Instant>;

    /// What the client is connected to now; its peers are servers.
    fn link(&self) -> Link;

    /// The bell of the context with which it was opened.
    fn wake(&self) -> &Wake;

    /// Calls and waits for the end.
    ///
    /// # Errors
    /// Why there is no reply.
    fn call(&mut self, request: &Request, timeout: Duration) -> Result<Reply, CallError> {
        /// Longest time between two looks: nobody rings at a deadline.
        const LOOK: Duration = Duration::from_millis(100);
        let ticket = self.send(request, timeout)?;
        loop {
            if let Some(result) = self.take_only(ticket) {
                // The rings that were answered here may have been for others.
                self.wake().ring();
                return result;
            }
            let now = Instant::now();
            let left = self.deadline().map_or(LOOK, |at| at.saturating_duration_since(now));
            self.wake().clone().wait(left.min(LOOK));
        }
    }
}

/// Offers one service.
///
/// Whatever it drops is counted in [`Context::counters`](super::Context::counters) by itself, also
/// what [`Server::take`] returns as an error.
pub trait Server: Send {
    /// The next request, if one waits. It also ends requests that took too long, so it is to be
    /// called whenever the bell rang, and at [`Server::deadline`].
    ///
    /// # Errors
    /// The next request was unusable, and why. It is gone and counted, and its client was told where
    /// the wire has room for it. The one after it can be taken.
    fn take(&mut self) -> Result<Option<IncomingRequest>, ServeError>;

    /// Answers a request, now or later, in any order: with what the function returned, or with why
    /// it did not. The bytes that go on the wire.
    ///
    /// # Errors
    /// The answer was not sent, and why; the client is told where the wire has room for it.
    fn reply(
        &mut self,
        id: RequestId,
        answer: Result<Payload, String>,
    ) -> Result<usize, ServeError>;

    /// When [`Server::take`] should be called again though nothing rang.
    fn deadline(&self) -> Option<Instant>;

    /// What the server is connected to now; its peers are clients.
    fn link(&self) -> Link;

    /// Answers that still wait for their client to be ready to hear them. A server that is dropped
    /// takes them along.
    fn kept(&self) -> usize {
        0
    }

    /// Sends kept answers whose clients hear now, without taking a request.
    fn flush(&mut self) {}
}
