//! Requests and replies: the interface for functions that run in other programs.
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
//! A request is a call as Wrapyfi makes it, with positional and keyword arguments, or the message
//! of a ROS service as bytes. A reply is a payload of the kind that the service returns, such a
//! message, or an error of the server.
//!
//! Only [`Client::call`] waits. Otherwise [`Context::wake`](super::Context::wake) rings when a
//! request or reply can be taken, and `deadline` is the time to look without a ring.

use std::borrow::Cow;
use std::time::{Duration, Instant};

use super::calls::Ticket;
use super::service_error::{CallError, ServeResult};
use super::{BridgeMark, Clock, DropReason, Link, Wake};
use crate::codec;
use wrapyfi_data::codec::Conversion;
use wrapyfi_data::plugin::Plugins;
use wrapyfi_data::types::{Encoding, Map, Payload, RosMessage, ServiceKind, Value};
use wrapyfi_data::{DecodeError, Limits};

/// A request: the call of a function, or a message of a service of ROS.
///
/// ```
/// # mod wrapyfi_core { pub use {wrapyfi_endpoint as endpoint, wrapyfi_data::types}; }
/// use wrapyfi_core::endpoint::Request;
/// use wrapyfi_core::types::Map;
/// let request = Request::new([1.into(), "a".into()]).with(Map::from([("scale", 0.5)]));
/// let call = request.call()?;
/// assert_eq!(call.args.len(), 2);
/// assert_eq!(call.kwargs.get("scale").and_then(|scale| scale.as_f64()), Some(0.5));
/// # Ok::<(), wrapyfi_data::DecodeError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub enum Request {
    /// A call with arguments.
    Call(Call),
    /// The request of a [`ServiceKind::Ros`] as bytes, the form of ROS 1 and ROS 2. Any middleware
    /// sends either form.
    Message(RosMessage),
}

/// A call of a function with the arguments of Wrapyfi's `request(*args, **kwargs)`.
///
/// ```
/// # mod wrapyfi_core { pub use {wrapyfi_endpoint as endpoint, wrapyfi_data::types}; }
/// use wrapyfi_core::endpoint::{Call, Request};
/// use wrapyfi_core::types::Map;
/// let call = Call { args: vec![2.into(), 3.into()], kwargs: Map::from([("scale", 0.5)]) };
/// assert_eq!(Request::from(call.clone()).into_call()?, call);
/// # Ok::<(), wrapyfi_data::DecodeError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Call {
    /// Positional arguments.
    pub args: Vec<Value>,
    /// Keyword arguments; the keys are text.
    pub kwargs: Map,
}

impl Request {
    /// A call with positional arguments only.
    pub fn new(args: impl Into<Vec<Value>>) -> Self {
        Self::Call(Call { args: args.into(), kwargs: Map::new() })
    }

    /// Sets the keyword arguments of a call; a message has none, and stays as it is.
    #[must_use]
    pub fn with(self, kwargs: Map) -> Self {
        match self {
            Self::Call(Call { args, .. }) => Self::Call(Call { args, kwargs }),
            message @ Self::Message(_) => message,
        }
    }

    /// The request as a call; the fields of a message are keyword arguments.
    ///
    /// # Errors
    /// When the bytes are no message of their type.
    pub fn call(&self) -> Result<Cow<'_, Call>, DecodeError> {
        match self {
            Self::Call(call) => Ok(Cow::Borrowed(call)),
            Self::Message(message) => match message.to_value(message.cdr.len()) {
                Ok(Value::Map(kwargs)) => Ok(Cow::Owned(Call { args: Vec::new(), kwargs })),
                Ok(_) => Ok(Cow::Owned(Call::default())),
                Err(error) => Err(codec::ros::fault(&error)),
            },
        }
    }

    /// As [`Request::call`], without a copy.
    ///
    /// # Errors
    /// As [`Request::call`].
    pub fn into_call(self) -> Result<Call, DecodeError> {
        match self {
            Self::Call(call) => Ok(call),
            message @ Self::Message(_) => message.call().map(Cow::into_owned),
        }
    }

    /// Size of the arguments or of the message in bytes, near enough to budget for it.
    pub fn size_hint(&self) -> usize {
        match self {
            Self::Call(Call { args, kwargs }) => {
                let values = args.iter().chain(kwargs.iter().map(|(_, value)| value));
                values.map(Value::size_hint).fold(0, usize::saturating_add)
            }
            Self::Message(message) => message.cdr.len(),
        }
    }
}

impl Default for Request {
    /// A call without arguments.
    fn default() -> Self {
        Self::Call(Call::default())
    }
}

impl From<Call> for Request {
    fn from(call: Call) -> Self {
        Self::Call(call)
    }
}

/// The reply to a call.
///
/// See [`Client`].
///
/// ```
/// # use std::time::Duration;
/// # use wrapyfi_data::types::{ServiceKind, Value};
/// # use wrapyfi_endpoint::{Context, Middleware, Request, ServiceSpec, memory::Memory};
/// # let (bus, context) = (Memory::new("memory"), Context::default());
/// # let spec = ServiceSpec::new("/double", ServiceKind::NativeObject);
/// # let mut server = bus.open_server(&spec, &context)?;
/// # let mut client = bus.open_client(&spec, &context)?;
/// let ticket = client.send(&Request::new([21.into()]), Duration::from_secs(5))?;
/// # let asked = server.take()?.unwrap();
/// server.reply(asked.id, Ok(Value::from(42).into()))?;
/// let reply = client.take_only(ticket).unwrap()?;
/// assert_eq!(reply.payload, Value::from(42).into());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Reply {
    /// Value that the function returned.
    pub payload: Payload,
    /// Size on the wire in bytes, all frames.
    pub wire_bytes: usize,
    /// Instant at which the last byte arrived.
    pub received_at: Instant,
}

/// Number of a request among those that one server has taken.
///
/// See [`Server`].
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_endpoint as endpoint; }
/// # use std::time::Duration;
/// # use wrapyfi_data::types::{ServiceKind, Value};
/// # use wrapyfi_endpoint::{Context, Middleware, Request, ServiceSpec, memory::Memory};
/// # let (bus, context) = (Memory::new("memory"), Context::default());
/// # let spec = ServiceSpec::new("/double", ServiceKind::NativeObject);
/// # let mut server = bus.open_server(&spec, &context)?;
/// # let mut client = bus.open_client(&spec, &context)?;
/// use wrapyfi_core::endpoint::RequestId;
/// client.send(&Request::new([1.into()]), Duration::from_secs(5))?;
/// client.send(&Request::new([2.into()]), Duration::from_secs(5))?;
/// let waiting: [RequestId; 2] = [server.take()?.unwrap().id, server.take()?.unwrap().id];
/// for id in waiting.into_iter().rev() {
///     server.reply(id, Ok(Value::from(0).into()))?; // in any order
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct RequestId(pub u64);

/// A request as its server takes it.
///
/// See [`Server`].
///
/// ```
/// # use std::time::Duration;
/// # use wrapyfi_data::types::{ServiceKind, Value};
/// # use wrapyfi_endpoint::{Context, Middleware, Request, ServiceSpec, memory::Memory};
/// # let (bus, context) = (Memory::new("memory"), Context::default());
/// # let spec = ServiceSpec::new("/double", ServiceKind::NativeObject);
/// # let mut server = bus.open_server(&spec, &context)?;
/// # let mut client = bus.open_client(&spec, &context)?;
/// client.send(&Request::new([21.into()]), Duration::from_secs(5))?;
/// let asked = server.take()?.unwrap();
/// let number = asked.request.call()?.args[0].as_i64().unwrap();
/// server.reply(asked.id, Ok(Value::from(2 * number).into()))?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct IncomingRequest {
    /// Number by which [`Server::reply`] answers the request.
    pub id: RequestId,
    /// The call.
    pub request: Request,
    /// Size on the wire in bytes, all frames.
    pub wire_bytes: usize,
    /// Instant at which the last byte arrived.
    pub received_at: Instant,
}

/// A service to call or to offer, with its type and the settings of the endpoint.
///
/// ```
/// # mod wrapyfi_core { pub use {wrapyfi_endpoint as endpoint, wrapyfi_data::types}; }
/// use std::time::Duration;
/// use wrapyfi_core::endpoint::ServiceSpec;
/// use wrapyfi_core::types::ServiceKind;
/// let timeout = Duration::from_secs(30);
/// let spec = ServiceSpec { timeout, ..ServiceSpec::new("/plan", ServiceKind::NativeObject) };
/// assert_eq!((spec.service.as_str(), spec.pending), ("/plan", ServiceSpec::PENDING));
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct ServiceSpec {
    /// Name of the service in that middleware, for instance `/light`; on ZeroMQ for log lines only.
    pub service: String,
    /// Type of the service.
    pub kind: ServiceKind,
    /// Time that a request has at its server, from its arrival to its answer: 5 s. Each call of a
    /// client is given its own.
    pub timeout: Duration,
    /// Largest number of a client's calls, or of a server's requests, under way at once: 64.
    pub pending: usize,
    /// Channel order of three-channel images on Wrapyfi's side; [`Encoding::Bgr8`] by custom.
    pub color_order: Encoding,
    /// Bounds on every request and reply.
    pub limits: Limits,
    /// Plug-ins that read and write objects inside native objects.
    pub plugins: Plugins,
    /// Settings that only some middlewares have, by name, such as `carrier`.
    pub options: Map,
    /// Mark of the bridge that makes the server by pattern; announced where the wire has room for
    /// it.
    #[doc(hidden)]
    pub mark: Option<BridgeMark>,
}

impl ServiceSpec {
    /// Time that a call or a request has unless said otherwise.
    pub const TIMEOUT: Duration = Duration::from_secs(5);
    /// Largest number of calls or requests under way at once unless said otherwise.
    pub const PENDING: usize = 64;

    /// Conversion of what a function returned to the type that its service carries; `None` for a service of ROS, whose
    /// messages stay as they are.
    pub fn conversion(&self) -> Option<Conversion> {
        let is_function = !matches!(self.kind, ServiceKind::Ros(_));
        let (to, color_order) = (self.kind.message_type(), self.color_order);
        is_function.then_some(Conversion { to, color_order, limits: self.limits })
    }

    /// A service with the default time-out and limits.
    pub fn new(service: impl Into<String>, kind: ServiceKind) -> Self {
        Self {
            service: service.into(),
            kind,
            timeout: Self::TIMEOUT,
            pending: Self::PENDING,
            color_order: Encoding::Bgr8,
            limits: Limits::default(),
            plugins: wrapyfi_plugins::standard(),
            options: Map::default(),
            mark: None,
        }
    }
}

/// The calling end of a service.
///
/// ```
/// # mod wrapyfi_core {
/// #     pub use {wrapyfi_endpoint as endpoint, wrapyfi_data::types};
/// #     pub mod middleware { pub use wrapyfi_endpoint::memory; }
/// # }
/// use std::time::Duration;
/// use wrapyfi_core::endpoint::{Context, Middleware, Request, ServiceSpec};
/// use wrapyfi_core::middleware::memory::Memory;
/// use wrapyfi_core::types::{ServiceKind, Value};
///
/// let bus = Memory::new("memory");
/// let spec = ServiceSpec::new("/double", ServiceKind::NativeObject);
/// let mut server = bus.open_server(&spec, &Context::default())?;
/// let mut client = bus.open_client(&spec, &Context::default())?;
/// let ticket = client.send(&Request::new([21.into()]), Duration::from_secs(5))?;
/// let asked = server.take()?.unwrap();
/// server.reply(asked.id, Ok(Value::from(42).into()))?;
/// let (answered, reply) = client.take().unwrap();
/// assert_eq!((answered, reply?.payload), (ticket, Value::from(42).into()));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub trait Client: Send {
    /// Begins a call. Within `timeout`, [`Client::take`] returns its reply, or an error that says
    /// why there is none. A call made before there is a server waits for one.
    ///
    /// # Errors
    /// When the request has no form on this wire, or too many calls are under way: nothing is sent.
    fn send(&mut self, request: &Request, timeout: Duration) -> Result<Ticket, CallError>;

    /// Takes the result of a call that has ended, if one has.
    fn take(&mut self) -> Option<(Ticket, Result<Reply, CallError>)>;

    /// Result of this call, if it has ended; the results of others can be taken later.
    fn take_only(&mut self, ticket: Ticket) -> Option<Result<Reply, CallError>>;

    /// Forgets a call. Its reply, if it comes, is counted as late.
    fn cancel(&mut self, ticket: Ticket);

    /// Instant at which [`Client::take`] should be called again though nothing rang.
    fn deadline(&self) -> Option<Instant>;

    /// Connection of the client now; its peers are servers.
    fn link(&self) -> Link;

    /// Bell of the context with which the client was opened.
    fn wake(&self) -> &Wake;

    /// Clock of that context, by which the calls end.
    fn clock(&self) -> &Clock;

    /// Calls and waits for the reply.
    ///
    /// # Errors
    /// When there is no reply.
    fn call(&mut self, request: &Request, timeout: Duration) -> Result<Reply, CallError> {
        /// Longest time between two looks: a deadline does not ring.
        const LOOK: Duration = Duration::from_millis(100);
        let ticket = self.send(request, timeout)?;
        loop {
            if let Some(result) = self.take_only(ticket) {
                // Rings that this wait has consumed may have been for other endpoints of the bell.
                self.wake().ring();
                return result;
            }
            let now = self.clock().now();
            let left = self.deadline().map_or(LOOK, |at| at.saturating_duration_since(now));
            self.wake().clone().wait(left.min(LOOK));
        }
    }
}

/// Answer of a server to a request that has no reply.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_endpoint as endpoint; }
/// use wrapyfi_core::endpoint::{DropReason, Refusal};
/// let refusal = Refusal::from("the arm is switched off");
/// assert_eq!(refusal.reason, DropReason::Refused);
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Refusal {
    /// Text that the client is told, where the wire has room for it.
    pub text: String,
    /// Reason under which the request counts as dropped.
    pub reason: DropReason,
}

/// A refusal by the function itself.
impl<T: Into<String>> From<T> for Refusal {
    fn from(text: T) -> Self {
        Self { text: text.into(), reason: DropReason::Refused }
    }
}

/// The serving end of a service.
///
/// Every request ends once, as sent or as dropped under a reason. A server counts each request that it drops in
/// [`Context::counters`](super::Context::counters), also those that [`Server::take`] returns as an error.
///
/// ```
/// # mod wrapyfi_core {
/// #     pub use {wrapyfi_endpoint as endpoint, wrapyfi_data::types};
/// #     pub mod middleware { pub use wrapyfi_endpoint::memory; }
/// # }
/// use std::time::Duration;
/// use wrapyfi_core::endpoint::{
///     CallError, Context, IncomingRequest, Middleware, Request, ServiceSpec,
/// };
/// use wrapyfi_core::middleware::memory::Memory;
/// use wrapyfi_core::types::ServiceKind;
///
/// let bus = Memory::new("memory");
/// let spec = ServiceSpec::new("/move", ServiceKind::NativeObject);
/// let mut server = bus.open_server(&spec, &Context::default())?;
/// let mut client = bus.open_client(&spec, &Context::default())?;
/// client.send(&Request::new(["left".into()]), Duration::from_secs(5))?;
/// let Some(IncomingRequest { id, request, .. }) = server.take()? else { panic!("no request") };
/// assert_eq!(request.call()?.args[0].as_str(), Some("left"));
/// server.reply(id, Err("the arm is switched off".into()))?;
/// let (_, answer) = client.take().unwrap();
/// assert!(matches!(answer, Err(CallError::Refused { reason, .. }) if reason.contains("arm")));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub trait Server: Send {
    /// Takes the next request, if one waits. It also ends requests that took too long, so call it
    /// whenever the bell has rung, and at [`Server::deadline`].
    ///
    /// # Errors
    /// When the next request cannot be used. It is dropped and counted, and its client is told
    /// where the wire has room for it. The one after it can be taken.
    fn take(&mut self) -> ServeResult<Option<IncomingRequest>>;

    /// Answers a request, now or later, in any order: with what the function returned, or with why
    /// it did not, which counts as dropped. The bytes that go on the wire.
    ///
    /// # Errors
    /// The answer was not sent, and why; the client is told where the wire has room for it.
    fn reply(&mut self, id: RequestId, answer: Result<Payload, Refusal>) -> ServeResult<usize>;

    /// Instant at which [`Server::take`] should be called again though nothing rang.
    fn deadline(&self) -> Option<Instant>;

    /// Connection of the server now; its peers are clients.
    fn link(&self) -> Link;

    /// Number of answers that wait for their client to be ready to hear them. Dropping the server
    /// drops them.
    fn kept(&self) -> usize {
        0
    }

    /// Sends kept answers whose clients hear now, without taking a request.
    fn flush(&mut self) {}
}
