//! Services of any type whose definition is known, with requests and replies as named fields.
//!
//! ```text
//!   DynamicMessage ─ TypePlan ─ CDR ─▶ Ros2Client ═══ DDS ═══▶ Ros2Server ─ CDR ─ TypePlan ─▶ DynamicMessage
//! ```

use std::time::Instant;

use wrapyfi_interfaces::dynamic::{DynamicMessage, TypePlan};

use super::client::Ros2Client;
use super::server::Ros2Server;
use super::{ServiceOptions, codec};
use crate::graph::Peers;
use crate::ros2::Ros2;
use wrapyfi_data::types::{Payload, RosMessage, RosService};
use wrapyfi_data::{DecodeError, EncodeError};
use wrapyfi_endpoint::codec::ros;
use wrapyfi_endpoint::wire_client::WireClient;
use wrapyfi_endpoint::wire_server::WireServer;
use wrapyfi_endpoint::{
    CallError, Client, Context, CountersSnapshot, DropReason, OpenResult, Reply, Request,
    RequestId, ServeError, Server, Ticket, Wake,
};

/// Calls one service.
///
/// ```no_run
/// use wrapyfi_endpoint::Wake;
/// use wrapyfi_ros2::{AnyClient, Ros2, ServiceOptions};
/// use wrapyfi_data::types::RosService;
/// # fn example(ros2: &Ros2, resolved: &wrapyfi_interfaces::store::ResolvedType)
/// # -> Result<(), Box<dyn std::error::Error>> {
/// let add = RosService::new(resolved)?; // example_interfaces/srv/AddTwoInts
/// let mut client = AnyClient::open(ros2, "add", add, &ServiceOptions::default(), &Wake::new())?;
/// let mut request = client.request();
/// request.set("a", 2_i64)?;
/// request.set("b", 3_i64)?;
/// let reply = client.call_and_wait(&request)?;
/// assert_eq!(reply.get("sum").and_then(|sum| sum.as_integer()), Some(5));
/// # Ok(())
/// # }
/// ```
pub struct AnyClient {
    raw: WireClient<Ros2Client>,
    name: String,
    service: RosService,
    options: ServiceOptions,
    context: Context,
}

impl AnyClient {
    /// A client of `name`, which is expanded and remapped as the node's names are. `wake` is rung
    /// when a reply arrives or a server comes or goes.
    ///
    /// # Errors
    /// When the name cannot be used, or DDS refuses.
    pub fn open(
        ros2: &Ros2,
        name: &str,
        service: RosService,
        options: &ServiceOptions,
        wake: &Wake,
    ) -> OpenResult<Self> {
        let context = Context { wake: wake.clone(), ..Context::default() };
        let raw = Ros2Client::open(ros2, &options.spec(name, service), options.depth, &context)?;
        let (name, options) = (ros2.resolve(name)?, options.clone());
        Ok(Self { raw, name, service, options, context })
    }

    /// Absolute name of the service.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// A request with the default values of its definition.
    #[must_use]
    pub fn request(&self) -> DynamicMessage {
        self.request_plan().default_message()
    }

    /// Plan by which requests are read and written, for instance from JSON.
    #[must_use]
    pub fn request_plan(&self) -> &'static TypePlan {
        self.service.request().plan()
    }

    /// Servers there are now.
    #[must_use]
    pub fn servers(&self) -> Peers {
        self.raw.wire().servers()
    }

    /// Replies that came after their time, and were dropped, so far.
    #[must_use]
    pub fn late(&self) -> u64 {
        self.context.counters.snapshot().dropped_for(DropReason::Late)
    }

    /// Begins a call, which [`AnyClient::poll`] will end: with its reply, or with why there is none.
    ///
    /// # Errors
    /// When the request is none of this service, or too many calls are under way.
    pub fn call(&mut self, request: &DynamicMessage) -> Result<Ticket, CallError> {
        let request = Request::Message(self.message(request)?);
        self.raw.send(&request, self.options.timeout)
    }

    /// Forgets a call. Its reply, if it comes, is counted as late.
    pub fn cancel(&mut self, ticket: Ticket) {
        self.raw.cancel(ticket);
    }

    /// A call that has ended, if one has. Does not wait for it; where a request is to be sent and
    /// its readers do not keep up, DDS may hold it up for half a second.
    pub fn poll(&mut self) -> Option<(Ticket, Result<DynamicMessage, CallError>)> {
        let (ticket, reply) = self.raw.take()?;
        Some((ticket, self.fields(reply)))
    }

    /// Time of the next [`AnyClient::poll`] though nothing rang: a call will have taken too long,
    /// or a server may have confirmed that it hears.
    #[must_use]
    pub fn deadline(&self) -> Option<Instant> {
        self.raw.deadline()
    }

    /// Calls and waits for the end, at most as long as the time-out of the options.
    ///
    /// # Errors
    /// Why there is no reply.
    pub fn call_and_wait(&mut self, request: &DynamicMessage) -> Result<DynamicMessage, CallError> {
        let request = Request::Message(self.message(request)?);
        let reply = self.raw.call(&request, self.options.timeout);
        self.fields(reply)
    }

    fn message(&self, fields: &DynamicMessage) -> Result<RosMessage, CallError> {
        RosMessage::from_fields(self.service.request(), fields).map_err(|fault| {
            CallError::Request { service: self.name.clone(), fault: unsuitable(&fault) }
        })
    }

    fn fields(&self, reply: Result<Reply, CallError>) -> Result<DynamicMessage, CallError> {
        let ros_type = self.service.response();
        let fault = match reply?.payload {
            Payload::RosMessage(message) => {
                match ros_type.plan().decode_exact(&message.cdr, self.options.max_bytes) {
                    Ok(fields) => return Ok(fields),
                    Err(fault) => ros::fault(&fault),
                }
            }
            other => DecodeError::mismatch(ros_type.to_string(), other.data_type().to_string()),
        };
        Err(CallError::Reply { service: self.name.clone(), fault })
    }
}

/// A request as it is taken.
#[derive(Debug, Clone, PartialEq)]
pub struct AnyRequest {
    /// Identity of the request, for [`AnyServer::reply`].
    pub id: RequestId,
    /// Fields of the request.
    pub fields: DynamicMessage,
}

/// Serves one service.
///
/// ```no_run
/// use std::time::Duration;
/// use wrapyfi_endpoint::Wake;
/// use wrapyfi_ros2::{AnyServer, Ros2, ServiceOptions};
/// use wrapyfi_data::types::RosService;
/// # fn example(ros2: &Ros2, resolved: &wrapyfi_interfaces::store::ResolvedType)
/// # -> Result<(), Box<dyn std::error::Error>> {
/// let (add, wake) = (RosService::new(resolved)?, Wake::new());
/// let mut server = AnyServer::open(ros2, "add", add, &ServiceOptions::default(), &wake)?;
/// loop {
///     while let Some(request) = server.take()? {
///         let sum = |name| request.fields.get(name).and_then(|field| field.as_integer());
///         let mut reply = server.response();
///         reply.set("sum", (sum("a").unwrap_or(0) + sum("b").unwrap_or(0)) as i64)?;
///         server.reply(request.id, &reply)?;
///     }
///     wake.wait(Duration::from_millis(100));
/// }
/// # }
/// ```
pub struct AnyServer {
    raw: WireServer<Ros2Server>,
    name: String,
    service: RosService,
    context: Context,
    max_bytes: usize,
}

impl AnyServer {
    /// A server of `name`, which is expanded and remapped as the node's names are. `wake` is rung
    /// when a request arrives or a client comes or goes.
    ///
    /// # Errors
    /// When the name cannot be used, or DDS refuses.
    pub fn open(
        ros2: &Ros2,
        name: &str,
        service: RosService,
        options: &ServiceOptions,
        wake: &Wake,
    ) -> OpenResult<Self> {
        let context = Context { wake: wake.clone(), ..Context::default() };
        let raw = Ros2Server::open(ros2, &options.spec(name, service), options.depth, &context)?;
        let (name, max_bytes) = (ros2.resolve(name)?, options.max_bytes);
        Ok(Self { raw, name, service, context, max_bytes })
    }

    /// Absolute name of the service.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// A reply with the default values of its definition.
    #[must_use]
    pub fn response(&self) -> DynamicMessage {
        self.response_plan().default_message()
    }

    /// Plan by which replies are read and written, for instance from JSON.
    #[must_use]
    pub fn response_plan(&self) -> &'static TypePlan {
        self.service.response().plan()
    }

    /// A reply that says what went wrong, for services whose replies have room for it: a `success`
    /// (or `successful`) that is false, and a text.
    #[must_use]
    pub fn error_reply(&self, text: &str) -> Option<DynamicMessage> {
        codec::error_reply(self.service, text)
    }

    /// Clients there are now.
    #[must_use]
    pub fn clients(&self) -> Peers {
        self.raw.wire().clients()
    }

    /// Number of requests served so far, and of those dropped, by reason.
    #[must_use]
    pub fn counters(&self) -> CountersSnapshot {
        self.context.counters.snapshot()
    }

    /// The next request, if one waits. It also sends replies that were kept, and ends requests that
    /// took too long, so it is to be called whenever `wake` rang, and at [`AnyServer::deadline`].
    ///
    /// # Errors
    /// The next request was unusable, and why. It is gone and counted; where its type has room for
    /// it, its client was told. The one after it can be taken.
    pub fn take(&mut self) -> Result<Option<AnyRequest>, ServeError> {
        let Some(asked) = self.raw.take()? else { return Ok(None) };
        let ros_type = self.service.request();
        let fault = match &asked.request {
            Request::Message(message) => {
                match ros_type.plan().decode_exact(&message.cdr, self.max_bytes) {
                    Ok(fields) => return Ok(Some(AnyRequest { id: asked.id, fields })),
                    Err(fault) => ros::fault(&fault),
                }
            }
            Request::Call(_) => {
                DecodeError::mismatch(ros_type.to_string(), "a call with arguments")
            }
        };
        Err(self.raw.refuse_malformed(asked.id, &fault))
    }

    /// Answers a request. Where its client does not hear yet, the reply is kept until it does, or
    /// until the request has taken too long.
    ///
    /// # Errors
    /// When the reply is none of this service, the request is not waiting any more, or DDS refuses:
    /// then the client is told, where its type has room for it.
    pub fn reply(&mut self, id: RequestId, reply: &DynamicMessage) -> Result<(), ServeError> {
        let reply = RosMessage::from_fields(self.service.response(), reply);
        let reply = reply.map_err(|fault| ServeError::Reply {
            service: self.name.clone(),
            fault: unsuitable(&fault),
        })?;
        self.raw.reply(id, Ok(reply.into())).map(drop)
    }

    /// Time of the next [`AnyServer::take`] though nothing rang.
    #[must_use]
    pub fn deadline(&self) -> Option<Instant> {
        self.raw.deadline()
    }

    /// Replies whose clients do not hear yet.
    #[must_use]
    pub fn kept(&self) -> usize {
        self.raw.kept()
    }

    /// Sends the replies that were kept and whose clients hear now, without taking a request. A
    /// client whose reply DDS refuses is told, where its type has room for it.
    pub fn flush(&mut self) {
        self.raw.flush();
    }
}

fn unsuitable(fault: &wrapyfi_interfaces::dynamic::ValueError) -> EncodeError {
    EncodeError::unrepresentable(
        "a service",
        fault.to_string(),
        "give the fields of its definition",
    )
}
