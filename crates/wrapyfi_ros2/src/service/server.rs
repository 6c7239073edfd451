//! Serves a service by the bytes of its requests and replies.
//!
//! ```text
//!   CdrServer ─ CDR ─▶ Requests ─ ServiceCodec ─▶ take
//!   CdrServer ◀─ the client hears ◀─ kept ◀─ CDR ◀─ ServiceCodec ◀─ reply
//! ```
//!
//! A reply is not sent before its client's half of the match is there: discovery may bring a request
//! first, and a reply that no client hears is lost.

use std::sync::Arc;
use std::time::{Duration, Instant};

use bytes::Bytes;

use super::codec::{ServiceCodec, drop_reason};
use super::introspection::{self, Events};
use super::replies::{Replies, Reply, Unsent};
use crate::graph::{GraphError, Peers, RequestId, ringing};
use crate::ros2::{Ros2, no_service};
use wrapyfi_data::types::Payload;
use wrapyfi_data::{DecodeError, EncodeError};
use wrapyfi_endpoint::calls::ends;
use wrapyfi_endpoint::requests::Requests;
use wrapyfi_endpoint::wire_server::{Sent, ServerWire, WireServer};
use wrapyfi_endpoint::{
    Context, DropReason, Link, OpenResult, Request, ServeError, ServeResult, ServiceSpec,
};

/// Time within which a client must have become able to hear an answer, whatever time its request had.
const HEARS_WITHIN: Duration = Duration::from_secs(30);

/// Serves one service.
pub(in super::super) struct Ros2Server {
    replies: Replies,
    codec: ServiceCodec,
    context: Context,
    /// Replies that were not heard, as far as they are counted.
    unheard: u64,
}

/// A request, and until when it may be answered.
pub(in super::super) struct Ask {
    id: RequestId,
    cdr: Bytes,
    until: Instant,
}

impl Ros2Server {
    /// A server of `spec.service`, which is expanded and remapped as the node's names are. DDS keeps
    /// `depth` requests and replies.
    pub(in super::super) fn open(
        ros2: &Ros2,
        spec: &ServiceSpec,
        depth: u32,
        context: &Context,
    ) -> OpenResult<WireServer<Self>> {
        let codec = ServiceCodec::new(&ServiceSpec {
            service: ros2.resolve(&spec.service)?,
            ..spec.clone()
        })?;
        let (mark, bell) = (spec.mark.as_ref(), ringing(&context.wake));
        let cdr = ros2.graph().server_marked(&codec.describe(depth), mark, bell);
        let cdr = cdr.map_err(|error| no_service(spec, &error))?;
        let cdr = introspection::server(cdr, Events::of(ros2, &codec, context)?);
        let replies = Replies::new(cdr, &codec.spec.service, spec.pending, &context.clock);
        let spec = codec.spec.clone();
        let requests = Arc::new(Requests::new(&spec, context));
        let wire = Self { replies, codec, context: context.clone(), unheard: 0 };
        Ok(WireServer::new(wire, requests, &spec))
    }

    /// Counts what was lost since the last look.
    fn count_losses(&mut self) {
        let unheard = self.replies.unheard();
        let counters = &self.context.counters;
        counters.dropped_many(DropReason::NoConsumer, unheard.saturating_sub(self.unheard));
        counters.dropped_many(DropReason::LostUpstream, self.replies.lost());
        self.unheard = unheard;
    }

    /// Tells a client why it has no reply, where its type has room for it.
    fn tell(&mut self, id: RequestId, why: &str) -> Result<Option<usize>, GraphError> {
        let Some(cdr) = self.codec.error_reply(why) else { return Ok(None) };
        let bytes = cdr.len();
        let until = ends(self.context.clock.now(), self.codec.spec.timeout);
        self.replies.send(Reply { id, cdr, until })?;
        Ok(Some(bytes))
    }

    /// Tells a client that DDS refused its reply.
    fn tell_unsent(&mut self, id: RequestId, error: &GraphError) {
        // One that does not keep up would hold up the refusal as well.
        if !matches!(error, GraphError::Timeout { .. })
            && let Err(error) = self.tell(id, &error.to_string())
        {
            tracing::debug!(service = self.codec.spec.service, %error, "a refusal was not sent");
        }
    }

    fn transport(&self, error: &GraphError) -> ServeError {
        let (service, reason) = (self.codec.spec.service.clone(), error.to_string());
        ServeError::Transport { service, reason }
    }
}

impl ServerWire for Ros2Server {
    type Ask = Ask;
    type Answer = Bytes;
    // A client that does not keep up would hold up the end.
    const TELLS_END: bool = false;

    fn fetch(&mut self, requests: &Requests<Ask>) -> ServeResult<()> {
        self.count_losses();
        let taken = match self.replies.take() {
            Ok(None) => return Ok(()),
            Ok(Some(taken)) => taken,
            Err(error) => {
                let Some(reason) = drop_reason(&error) else {
                    return Err(self.transport(&error));
                };
                self.context.counters.received(0);
                self.context.counters.dropped(reason);
                let (service, fault) = (self.codec.spec.service.clone(), error.to_string());
                return Err(ServeError::Request { service, fault, reason });
            }
        };
        let until = ends(self.context.clock.now(), self.codec.spec.timeout);
        let bytes = taken.cdr.len();
        let refused = requests.put(Ask { id: taken.id, cdr: taken.cdr, until }, bytes);
        refused.map_err(|(Ask { id, .. }, error)| {
            if let Err(unsent) = self.tell(id, &error.to_string()) {
                tracing::debug!(service = self.codec.spec.service, %unsent, "a refusal was not sent");
            }
            error
        })
    }

    fn read(&self, ask: &Ask) -> Result<Request, DecodeError> {
        self.codec.decode_request(&ask.cdr)
    }

    fn write(&self, _ask: &Ask, payload: &Payload) -> Result<Bytes, EncodeError> {
        self.codec.encode_reply(payload)
    }

    fn send(&mut self, Ask { id, until, .. }: Ask, answer: Result<Bytes, &str>) -> Sent {
        let why = answer.as_ref().err().copied();
        let until = until.min(ends(self.context.clock.now(), HEARS_WITHIN));
        let sent = match answer {
            Ok(cdr) => {
                let bytes = cdr.len();
                self.replies.send(Reply { id, cdr, until }).map(|()| Some(bytes))
            }
            Err(why) => self.tell(id, why),
        };
        self.count_losses();
        let service = || self.codec.spec.service.clone();
        match (sent, why) {
            (Ok(None), Some(why)) => Err(ServeError::Reply {
                service: service(),
                fault: EncodeError::unrepresentable(
                    self.codec.spec.kind.ros_type(),
                    format!("an error ({why})"),
                    "the client waits for its time-out; the types of wrapyfi_msgs/srv have \
                             room for errors"
                        .to_owned(),
                ),
            }),
            (Ok(bytes), _) => Ok(bytes),
            (Err(error), _) => {
                self.tell_unsent(id, &error);
                Err(self.transport(&error))
            }
        }
    }

    fn link(&self) -> Link {
        let clients = match self.replies.clients() {
            Peers::Ready(clients) => clients,
            Peers::None | Peers::Half | Peers::Foreign(_) => 0,
        };
        Link { peers: Some(clients), ..Link::default() }
    }

    fn kept(&self) -> usize {
        self.replies.kept()
    }

    /// A client whose reply DDS refuses is told.
    fn flush(&mut self) {
        for Unsent { id, error } in self.replies.flush() {
            self.tell_unsent(id, &error);
        }
        self.count_losses();
    }

    fn deadline(&self) -> Option<Instant> {
        self.replies.deadline()
    }
}
