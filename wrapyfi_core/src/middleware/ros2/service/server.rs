//! Serves a service of any type.
//!
//! ```text
//!   CdrServer ─ CDR ─▶ Plan ─▶ take ─ AnyRequest ─▶ user
//!   CdrServer ◀─ the client hears ◀─ kept ◀─ Plan ◀─ reply ─ DynamicMessage ─ user
//! ```
//!
//! A reply is not sent before its client's half of the match is there: discovery may bring a request
//! first, and a reply that nobody hears is lost.

use std::collections::HashMap;
use std::time::Instant;

use wrapyfi_interfaces::dynamic::{DynamicMessage, Plan, ValueError};

use super::replies::{Replies, Reply, Unsent};
use super::{ServiceOptions, ServiceType, encode, ends};
use crate::endpoint::Wake;
use crate::middleware::ros2::any::ringing;
use crate::middleware::ros2::graph::{GraphError, Peers, RequestId};
use crate::middleware::ros2::{AnyError, Ros2};

/// A request as it is taken.
#[derive(Debug, Clone, PartialEq)]
pub struct AnyRequest {
    /// What [`AnyServer::reply`] wants to know.
    pub id: RequestId,
    /// Its fields.
    pub fields: DynamicMessage,
    /// When its client sent it, in nanoseconds since 1970.
    pub source_timestamp_ns: i64,
}

/// Why a request was not served, or a reply not given.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ServeError {
    /// The request is none of this service: it never reaches the user.
    #[error("a request to {service:?} is no {type_name}: {fault}")]
    Malformed {
        /// Service.
        service: String,
        /// Its type.
        type_name: String,
        /// What is wrong, and where.
        fault: String,
    },
    /// Too many requests wait for their replies.
    #[error("{limit} requests to {service:?} wait for their replies, which is the limit")]
    Overloaded {
        /// Service.
        service: String,
        /// Most requests at once.
        limit: usize,
    },
    /// The reply is none of this service.
    #[error("the reply does not fit {service:?}: {fault}")]
    Reply {
        /// Service.
        service: String,
        /// What is wrong, and where.
        fault: Box<ValueError>,
    },
    /// The request is not waiting: it was answered, or took too long.
    #[error("no such request to {service:?} waits: it was answered, or took over {timeout_ms} ms")]
    NotWaiting {
        /// Service.
        service: String,
        /// Time a request has.
        timeout_ms: u64,
    },
    /// DDS refused.
    #[error(transparent)]
    Graph(#[from] GraphError),
}

/// What a server did not serve, by reason, since it was opened.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ServerDrops {
    /// Requests of another type or without identity.
    pub malformed: u64,
    /// Requests of another vendor's clients.
    pub foreign: u64,
    /// Requests over the size limit.
    pub too_large: u64,
    /// Requests beyond the limit of those under way.
    pub overloaded: u64,
    /// Requests that were not answered in time.
    pub expired: u64,
    /// Replies that their clients could not hear, or that DDS refused.
    pub unheard: u64,
    /// Requests that DDS lost.
    pub lost: u64,
}

impl std::fmt::Display for ServerDrops {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { malformed, foreign, too_large, overloaded, expired, unheard, lost } = *self;
        let reasons = [
            (malformed, "malformed"),
            (foreign, "of another vendor's clients"),
            (too_large, "too large"),
            (overloaded, "beyond the limit of those under way"),
            (expired, "not answered in time"),
            (unheard, "whose clients did not hear the reply"),
            (lost, "lost by DDS"),
        ];
        let some = reasons.iter().filter(|(count, _)| *count > 0);
        let texts: Vec<_> = some.map(|(count, reason)| format!("{count} {reason}")).collect();
        if texts.is_empty() { f.write_str("nothing") } else { f.write_str(&texts.join(", ")) }
    }
}

/// Serves one service.
///
/// ```no_run
/// use std::time::Duration;
/// use wrapyfi_core::endpoint::Wake;
/// use wrapyfi_core::middleware::ros2::{AnyServer, Ros2, ServiceOptions, ServiceType};
/// # fn example(ros2: &Ros2, resolved: &wrapyfi_interfaces::store::ResolvedType)
/// # -> Result<(), Box<dyn std::error::Error>> {
/// let (add, wake) = (ServiceType::new(resolved)?, Wake::new());
/// let mut server = AnyServer::open(ros2, "add", add, &ServiceOptions::default(), &wake)?;
/// loop {
///     while let Some(request) = server.take()? {
///         let sum = |name| request.fields.get(name).and_then(|field| field.as_integer());
///         let mut reply = server.response();
///         reply.set("sum", (sum("a").unwrap_or(0) + sum("b").unwrap_or(0)) as i64)?;
///         server.reply(&request.id, &reply)?;
///     }
///     wake.wait(Duration::from_millis(100));
/// }
/// # }
/// ```
pub struct AnyServer {
    replies: Replies,
    name: String,
    service: ServiceType,
    options: ServiceOptions,
    /// Requests with the user, and until when.
    pending: HashMap<RequestId, Instant>,
    drops: ServerDrops,
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
        service: ServiceType,
        options: &ServiceOptions,
        wake: &Wake,
    ) -> Result<Self, AnyError> {
        let description = service.describe(ros2, name, options)?;
        let mark = options.mark.as_ref();
        let cdr = ros2.graph().server_marked(&description, mark, ringing(wake))?;
        Ok(Self {
            replies: Replies::new(cdr, &description.name, options.pending),
            name: description.name,
            service,
            options: options.clone(),
            pending: HashMap::new(),
            drops: ServerDrops::default(),
        })
    }

    /// Absolute name of the service.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// A reply with the default values of its definition.
    #[must_use]
    pub fn response(&self) -> DynamicMessage {
        self.service.response().default_message()
    }

    /// How replies are read and written, for instance from JSON.
    #[must_use]
    pub fn response_plan(&self) -> &Plan {
        self.service.response()
    }

    /// A reply that says what went wrong, where the type has room for it: see
    /// [`ServiceType::error_reply`].
    #[must_use]
    pub fn error_reply(&self, text: &str) -> Option<DynamicMessage> {
        self.service.error_reply(text)
    }

    /// Clients there are now.
    #[must_use]
    pub fn clients(&self) -> Peers {
        self.replies.clients()
    }

    /// What was not served so far.
    pub fn drops(&mut self) -> ServerDrops {
        self.drops.lost += self.replies.lost();
        self.drops.unheard = self.replies.unheard();
        self.drops
    }

    /// The next request, if one waits. It also sends replies that were kept, and ends requests that
    /// took too long, so it is to be called whenever `wake` rang, and at [`AnyServer::deadline`].
    ///
    /// # Errors
    /// The next request was unusable, and why. It is gone and counted; where its type has room for
    /// it, its client was told. The one after it can be taken.
    pub fn take(&mut self) -> Result<Option<AnyRequest>, ServeError> {
        self.flush();
        self.end_expired();
        let request = match self.replies.take() {
            Ok(None) => return Ok(None),
            Ok(Some(request)) => request,
            Err(error) => {
                match error {
                    GraphError::TooLarge { .. } => self.drops.too_large += 1,
                    GraphError::NoIdentity { .. } => self.drops.malformed += 1,
                    GraphError::ForeignMapping { .. } => self.drops.foreign += 1,
                    _ => {}
                }
                return Err(error.into());
            }
        };
        let decoded = self.service.request().decode_exact(&request.cdr, self.options.max_bytes);
        let fields = match decoded {
            Ok(fields) => fields,
            Err(fault) => {
                self.drops.malformed += 1;
                let error = ServeError::Malformed {
                    service: self.name.clone(),
                    type_name: self.service.name().to_owned(),
                    fault: fault.to_string(),
                };
                self.refuse(&request.id, &error.to_string());
                return Err(error);
            }
        };
        if self.pending.len() >= self.options.pending {
            self.drops.overloaded += 1;
            let error =
                ServeError::Overloaded { service: self.name.clone(), limit: self.options.pending };
            self.refuse(&request.id, &error.to_string());
            return Err(error);
        }
        self.pending.insert(request.id, ends(Instant::now(), self.options.timeout));
        let source_timestamp_ns = request.source_timestamp_ns;
        Ok(Some(AnyRequest { id: request.id, fields, source_timestamp_ns }))
    }

    /// Answers a request. Where its client does not hear yet, the reply is kept until it does, or
    /// until the request has taken too long.
    ///
    /// # Errors
    /// When the reply is none of this service, the request is not waiting any more, or DDS refuses:
    /// then the client is told, where its type has room for it.
    pub fn reply(&mut self, id: &RequestId, reply: &DynamicMessage) -> Result<(), ServeError> {
        let cdr = encode(self.service.response(), reply).map_err(|fault| ServeError::Reply {
            service: self.name.clone(),
            fault: Box::new(fault),
        })?;
        let until = self.pending.remove(id).ok_or_else(|| ServeError::NotWaiting {
            service: self.name.clone(),
            timeout_ms: u64::try_from(self.options.timeout.as_millis()).unwrap_or(u64::MAX),
        })?;
        self.replies.send(Reply { id: *id, cdr, until }).map_err(|error| {
            self.tell(id, &error);
            error.into()
        })
    }

    /// When [`AnyServer::take`] should be called again though nothing rang.
    #[must_use]
    pub fn deadline(&self) -> Option<Instant> {
        self.pending.values().copied().chain(self.replies.deadline()).min()
    }

    /// Tells a client why it does not get its reply.
    fn tell(&mut self, id: &RequestId, error: &GraphError) {
        // One that does not keep up would hold up the refusal as well.
        if !matches!(error, GraphError::Timeout { .. }) {
            self.refuse(id, &error.to_string());
        }
    }

    /// Tells a client that its request is not served, where its type has room for it.
    fn refuse(&mut self, id: &RequestId, text: &str) {
        let Some(reply) = self.service.error_reply(text) else { return };
        let Ok(cdr) = encode(self.service.response(), &reply) else { return };
        let until = ends(Instant::now(), self.options.timeout);
        if let Err(error) = self.replies.send(Reply { id: *id, cdr, until }) {
            tracing::debug!(service = self.name, %error, "a refusal was not sent");
        }
    }

    /// Replies whose clients do not hear yet.
    #[must_use]
    pub fn kept(&self) -> usize {
        self.replies.kept()
    }

    /// Sends the replies that were kept and whose clients hear now, without taking a request. A
    /// client whose reply DDS refuses is told, where its type has room for it.
    pub fn flush(&mut self) {
        for Unsent { id, error } in self.replies.flush() {
            self.tell(&id, &error);
        }
    }

    fn end_expired(&mut self) {
        let now = Instant::now();
        let over: Vec<RequestId> =
            self.pending.iter().filter(|(_, until)| **until <= now).map(|(id, _)| *id).collect();
        for id in over {
            self.pending.remove(&id);
            self.drops.expired += 1;
            let timeout_ms = self.options.timeout.as_millis();
            self.refuse(&id, &format!("{} did not answer within {timeout_ms} ms", self.name));
        }
    }
}
