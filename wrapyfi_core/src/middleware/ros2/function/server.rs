//! Offers a function of Wrapyfi as a ROS 2 service.

use std::collections::HashMap;
use std::time::Instant;

use super::{Function, check_name, refused};
use crate::EncodeError;
use crate::endpoint::calls::ends;
use crate::endpoint::{
    Context, DropReason, IncomingRequest, Link, OpenError, RequestId, ServeError, Server,
    ServiceSpec,
};
use crate::middleware::ros2::graph::{self, GraphError, Peers};
use crate::middleware::ros2::service::{self, ServerDrops};
use crate::middleware::ros2::{AnyServer, Ros2};
use crate::types::Payload;

/// [`AnyServer`] with the data model's requests and replies.
pub(in super::super) struct FunctionServer {
    any: AnyServer,
    function: Function,
    context: Context,
    /// Requests with the user; those that took too long are forgotten by the server underneath.
    open: HashMap<RequestId, Open>,
    next: u64,
    counted: ServerDrops,
}

struct Open {
    id: graph::RequestId,
    received_at: Instant,
    until: Instant,
}

impl FunctionServer {
    pub(in super::super) fn open(
        ros2: &Ros2,
        spec: &ServiceSpec,
        context: &Context,
    ) -> Result<Self, OpenError> {
        check_name(ros2, spec)?;
        let function = Function::new(spec)?;
        let (service, options) = (function.service.clone(), function.options());
        let any = AnyServer::open(ros2, &spec.service, service, &options, &context.wake)
            .map_err(|error| refused(spec, &error))?;
        Ok(Self {
            any,
            function,
            context: context.clone(),
            open: HashMap::new(),
            next: 0,
            counted: ServerDrops::default(),
        })
    }

    /// Counts what the server underneath has dropped since the last look.
    fn count_drops(&mut self) {
        let (now, before) = (self.any.drops(), self.counted);
        self.counted = now;
        for (now, before, reason) in [
            (now.malformed, before.malformed, DropReason::Malformed),
            (now.foreign, before.foreign, DropReason::Mismatch),
            (now.too_large, before.too_large, DropReason::Oversize),
            (now.overloaded, before.overloaded, DropReason::Overloaded),
            (now.expired, before.expired, DropReason::Expired),
            (now.unheard, before.unheard, DropReason::NoConsumer),
            (now.lost, before.lost, DropReason::LostUpstream),
        ] {
            self.context.counters.dropped_many(reason, now.saturating_sub(before));
        }
    }

    fn failed(&self, error: service::ServeError) -> ServeError {
        let service = self.any.name().to_owned();
        let request =
            |reason, fault: String| ServeError::Request { service: service.clone(), fault, reason };
        match error {
            service::ServeError::Malformed { fault, .. } => request(DropReason::Malformed, fault),
            service::ServeError::Overloaded { limit, .. } => {
                ServeError::Overloaded { service, limit }
            }
            service::ServeError::NotWaiting { timeout_ms, .. } => {
                ServeError::NotWaiting { service, timeout_ms }
            }
            service::ServeError::Reply { fault, .. } => {
                ServeError::Reply { service, fault: super::unwritable(&fault) }
            }
            service::ServeError::Graph(error) => match error {
                GraphError::TooLarge { .. } => request(DropReason::Oversize, error.to_string()),
                GraphError::NoIdentity { .. } => request(DropReason::Malformed, error.to_string()),
                GraphError::ForeignMapping { .. } => {
                    request(DropReason::Mismatch, error.to_string())
                }
                _ => ServeError::Transport { service, reason: error.to_string() },
            },
        }
    }

    /// Tells a client that there is no reply, and why; false where its type has no room for it.
    fn tell(&mut self, id: &graph::RequestId, text: &str) -> Result<bool, ServeError> {
        let Some(reply) = self.any.error_reply(text) else { return Ok(false) };
        self.any.reply(id, &reply).map_err(|error| self.failed(error))?;
        Ok(true)
    }

    fn next(&mut self) -> Result<Option<IncomingRequest>, ServeError> {
        let Some(asked) = self.any.take().map_err(|error| {
            self.context.counters.received(0);
            self.failed(error)
        })?
        else {
            return Ok(None);
        };
        let received_at = Instant::now();
        match self.function.read_request(&asked.fields) {
            Ok((request, wire_bytes)) => {
                self.context.counters.received(wire_bytes);
                self.next += 1;
                let id = RequestId(self.next);
                let until = ends(received_at, self.function.spec.timeout);
                self.open.insert(id, Open { id: asked.id, received_at, until });
                Ok(Some(IncomingRequest { id, request, wire_bytes, received_at }))
            }
            Err(fault) => {
                let reason = fault.drop_reason();
                self.context.counters.received(0);
                self.context.counters.dropped(reason);
                let (service, fault) = (self.any.name().to_owned(), fault.to_string());
                let error = ServeError::Request { service, fault, reason };
                if let Err(failed) = self.tell(&asked.id, &error.to_string()) {
                    tracing::debug!(%failed, "a refusal was not sent");
                }
                Err(error)
            }
        }
    }
}

impl Server for FunctionServer {
    fn take(&mut self) -> Result<Option<IncomingRequest>, ServeError> {
        let now = Instant::now();
        self.open.retain(|_, open| open.until > now);
        let taken = self.next();
        self.count_drops();
        taken
    }

    fn reply(
        &mut self,
        id: RequestId,
        answer: Result<Payload, String>,
    ) -> Result<usize, ServeError> {
        let service = self.any.name().to_owned();
        let open = self.open.remove(&id).ok_or_else(|| ServeError::NotWaiting {
            service: service.clone(),
            timeout_ms: u64::try_from(self.function.spec.timeout.as_millis()).unwrap_or(u64::MAX),
        })?;
        let payload = match answer {
            Ok(payload) => payload,
            Err(reason) => {
                if self.tell(&open.id, &reason)? {
                    self.context.counters.sent(reason.len(), open.received_at.elapsed());
                    return Ok(reason.len());
                }
                let fault = EncodeError::Unrepresentable {
                    format: self.function.spec.kind.ros_type(),
                    what: format!("an error ({reason})"),
                    path: "$".to_owned(),
                    remedy:
                        "the client waits for its time-out; the types of wrapyfi_msgs/srv have \
                             room for errors"
                            .to_owned(),
                };
                return Err(ServeError::Reply { service, fault });
            }
        };
        let reply = match self.function.write_reply(&payload, self.any.response()) {
            Ok(reply) => reply,
            Err(fault) => {
                self.context.counters.dropped(DropReason::Unencodable);
                let error = ServeError::Reply { service, fault };
                self.tell(&open.id, &error.to_string())?;
                return Err(error);
            }
        };
        self.any.reply(&open.id, &reply).map_err(|error| self.failed(error))?;
        self.count_drops();
        let bytes = size(&payload);
        self.context.counters.sent(bytes, open.received_at.elapsed());
        Ok(bytes)
    }

    fn deadline(&self) -> Option<Instant> {
        self.any.deadline()
    }

    fn link(&self) -> Link {
        let clients = match self.any.clients() {
            Peers::Ready(clients) => clients,
            Peers::None | Peers::Half | Peers::Foreign(_) => 0,
        };
        Link { peers: Some(clients), ..Link::default() }
    }

    fn kept(&self) -> usize {
        self.any.kept()
    }

    fn flush(&mut self) {
        self.any.flush();
    }
}

/// Bytes of what makes a reply large; the fields around them are few.
fn size(payload: &Payload) -> usize {
    use crate::types::Pixels;
    match payload {
        Payload::Image(image) => match &image.pixels {
            Pixels::Raw(raw) => raw.data.len(),
            Pixels::Compressed { data, .. } => data.len(),
        },
        Payload::AudioChunk(sound) => sound.data.len(),
        _ => 0,
    }
}
