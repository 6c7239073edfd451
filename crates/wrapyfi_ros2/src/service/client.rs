//! Calls a service by the bytes of its requests and replies.
//!
//! ```text
//!   Request ─ ServiceCodec ─ CDR ─▶ Calls ─ a server is there ─▶ CdrClient
//!   Reply ◀─ ServiceCodec ◀─ CDR ─────────────────────────────── CdrClient
//! ```
//!
//! A call made before a server is found waits for it: no request is sent before both halves of the
//! match are there, because neither would be repeated. No more are with the server than it keeps: it overwrites the
//! oldest for one more, without a word.

use std::sync::Arc;
use std::time::{Duration, Instant};

use bytes::Bytes;

use super::USUAL_DEPTH;
use super::codec::{ServiceCodec, drop_reason};
use super::introspection::{self, Events};
use crate::graph::{CdrClient, Graph, GraphError, LOOK_AGAIN, Peers, ServiceMapping, ringing};
use crate::names::service_type_from_dds;
use crate::ros2::{NAME, Ros2, no_service};
use wrapyfi_data::EncodeError;
use wrapyfi_endpoint::calls::{Calls, Stage};
use wrapyfi_endpoint::wire_client::{ClientWire, WireClient};
use wrapyfi_endpoint::{
    Absent, CallError, Cause, Context, Link, Mutex, OpenResult, Request, Role, ServiceSpec,
    Throttle,
};

/// Time after which the types of the servers are looked at again, where nothing has changed.
const TYPES: Duration = Duration::from_secs(5);

/// Servers that were matched when their types were looked at, the time of that, and the type that all of them have
/// where it is another.
type Looked = (Peers, Instant, Option<String>);

/// Calls one service.
pub(in super::super) struct Ros2Client {
    cdr: Box<dyn CdrClient>,
    graph: Arc<dyn Graph>,
    codec: ServiceCodec,
    mapping: Option<ServiceMapping>,
    context: Context,
    dropped: Throttle,
    looked: Mutex<Option<Looked>>,
    /// Servers to which the last request was sent.
    sent_to: Peers,
}

impl Ros2Client {
    /// A client of `spec.service`, which is expanded and remapped as the node's names are. DDS keeps
    /// `depth` requests and replies.
    pub(in super::super) fn open(
        ros2: &Ros2,
        spec: &ServiceSpec,
        depth: u32,
        context: &Context,
    ) -> OpenResult<WireClient<Self>> {
        let codec = ServiceCodec::new(&ServiceSpec {
            service: ros2.resolve(&spec.service)?,
            ..spec.clone()
        })?;
        let cdr = ros2.graph().client(&codec.describe(depth), ringing(&context.wake));
        let cdr = cdr.map_err(|error| no_service(spec, &error))?;
        let cdr = introspection::client(cdr, Events::of(ros2, &codec, context)?);
        let (mapping, context) = (ros2.graph().service_mapping(), context.clone());
        let (service, pending) = (codec.spec.service.clone(), spec.pending);
        let wire = Self {
            cdr,
            graph: Arc::clone(ros2.graph()),
            codec,
            mapping,
            context: context.clone(),
            dropped: Throttle::default(),
            looked: Mutex::default(),
            sent_to: Peers::None,
        };
        Ok(WireClient::new(wire, &service, pending, &context))
    }

    /// Servers there are now.
    pub(in super::super) fn servers(&self) -> Peers {
        self.cdr.servers()
    }

    /// Type that the servers have, where it is another than ours. DDS matches no endpoints of two types, and RustDDS
    /// all.
    fn other_type(&self, servers: &Peers) -> Option<String> {
        if self.mapping == Some(ServiceMapping::Cyclone) && matches!(servers, Peers::Ready(_)) {
            return None;
        }
        let mut looked = self.looked.lock();
        if let Some((known, at, other)) = &*looked
            && known == servers
            && at.elapsed() < TYPES
        {
            return other.clone();
        }
        let requests = format!("rq{}Request", self.codec.spec.service);
        let all = self.graph.endpoints().unwrap_or_default();
        let found = all.iter().filter(|it| !it.is_publisher && it.dds_topic == requests);
        let mut types: Vec<_> =
            found.filter_map(|server| service_type_from_dds(&server.dds_type)).collect();
        let has_ours = types.iter().any(|theirs| *theirs == self.codec.type_name());
        let other = types.pop().filter(|_| !has_ours);
        *looked = Some((servers.clone(), Instant::now(), other.clone()));
        other
    }

    fn receive(&mut self, calls: &mut Calls<Bytes>) {
        loop {
            match self.cdr.take() {
                Ok(Some(reply)) => {
                    let (codec, service) = (&self.codec, calls.service().to_owned());
                    let (bytes, now) = (reply.cdr.len(), calls.clock().now());
                    calls.answered(reply.sequence, bytes, now, || {
                        match codec.decode_reply(&reply.cdr) {
                            Ok(Ok(payload)) => Ok(payload),
                            Ok(Err(reason)) => Err(CallError::Refused { service, reason }),
                            Err(fault) => Err(CallError::Reply { service, fault }),
                        }
                    });
                }
                Ok(None) => return,
                // A reply that cannot be read names no call: its call will say that it waited.
                Err(error) => {
                    if let Some(unlogged_before) = self.dropped.pass(calls.clock().now()) {
                        let service = &self.codec.spec.service;
                        tracing::warn!(service, unlogged_before, "dropped a reply: {error}");
                    }
                    let Some(reason) = drop_reason(&error) else { return };
                    self.context.counters.received(0);
                    self.context.counters.dropped(reason);
                }
            }
        }
    }

    fn send(&mut self, calls: &mut Calls<Bytes>) {
        if calls.is_held_back() && self.cdr.servers() != self.sent_to {
            calls.server_changed();
        }
        while let Some(request) = calls.next_to_send() {
            let servers = self.cdr.servers();
            if !matches!(servers, Peers::Ready(_)) || self.other_type(&servers).is_some() {
                return;
            }
            match self.cdr.send(&[request]) {
                Ok(sequence) => {
                    self.sent_to = servers;
                    calls.send(sequence);
                }
                // Its readers do not keep up: it stays first in the row.
                Err(GraphError::Timeout { .. }) => return,
                Err(error) => {
                    let (service, reason) = (calls.service().to_owned(), error.to_string());
                    calls.refused(CallError::Transport { service, reason });
                }
            }
        }
    }
}

impl ClientWire for Ros2Client {
    type Written = Bytes;
    const AT_ONCE: usize = USUAL_DEPTH as usize;

    fn write(&self, request: &Request, _: Instant) -> Result<(Bytes, usize), EncodeError> {
        let cdr = self.codec.encode_request(request)?;
        let bytes = cdr.len();
        Ok((cdr, bytes))
    }

    /// Does not wait for a reply; where a request is to be sent and its readers do not keep up, DDS may
    /// hold it up for half a second.
    fn turn(&mut self, calls: &mut Calls<Bytes>) {
        self.receive(calls);
        self.send(calls);
    }

    fn missing(&self, stage: Stage) -> String {
        let servers = self.cdr.servers();
        if let (Stage::Waiting, Some(other)) = (stage, self.other_type(&servers)) {
            return format!("its server is of another type: {other}");
        }
        match (stage, servers) {
            (Stage::Sent, Peers::Ready(_)) => "its server has not answered".to_owned(),
            (Stage::Sent, _) => "its server is gone".to_owned(),
            (Stage::Waiting, Peers::None) => "no node offers it".to_owned(),
            (Stage::Waiting, Peers::Half) => {
                "its server is found by half only, or has not confirmed that it hears".to_owned()
            }
            (Stage::Waiting, Peers::Ready(_)) => format!(
                "its server was found too late, or has not answered the {USUAL_DEPTH} calls before it"
            ),
            (Stage::Waiting, Peers::Foreign(theirs)) => foreign(theirs),
        }
    }

    fn link(&self) -> Link {
        let absent = Absent::new(Role::Server, "a server of", NAME, &self.codec.spec.service);
        let servers = self.cdr.servers();
        let (peers, waiting_for) = match (self.other_type(&servers), servers) {
            (Some(theirs), _) => {
                let ours = self.codec.type_name().to_owned();
                (0, Some(Cause::Type { absent, peer: None, theirs, ours }))
            }
            (None, Peers::Ready(servers)) => (servers, None),
            (None, Peers::None) => (0, Some(Cause::Nobody(absent))),
            (None, Peers::Half) => (0, Some(Cause::FoundByHalf(absent))),
            (None, Peers::Foreign(theirs)) => {
                let (theirs, ours) = (theirs.rmw(), theirs.other().rmw());
                (0, Some(Cause::ServiceMapping { absent, theirs, ours }))
            }
        };
        Link { peers: Some(peers), waiting_for, keeps_last: false }
    }

    fn look_again(&self) -> Option<Duration> {
        match self.cdr.servers() {
            // Since the last turn, or its readers do not keep up.
            Peers::Ready(_) => Some(LOOK_AGAIN),
            _ => self.cdr.look_again(),
        }
    }
}

/// Difference that separates the two ends of a service, and its remedy, in words.
fn foreign(theirs: ServiceMapping) -> String {
    let ours = theirs.other();
    format!(
        "the other end runs {}, whose services do not understand those of {}: set \
         RMW_IMPLEMENTATION={} here, or {} there",
        theirs.rmw(),
        ours.rmw(),
        theirs.rmw(),
        ours.rmw()
    )
}
