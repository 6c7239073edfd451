//! Services on `rmw_cyclonedds_cpp`, whose own functions for them carry only types whose members are known: a publisher
//! and a subscription carry any.
//!
//! ```text
//!   PairedClient   publisher rq/…Request ──▶ subscription   PairedServer, or a node of rclcpp
//!                  subscription rr/…Reply ◀── publisher
//!                  identity in front of every body: service_header
//! ```
//!
//! On the wire and in the graph this is what the middleware makes itself, but for the ids in USER_DATA, without which
//! it takes the ends of one participant for one client or server.

use std::cell::Cell;
use std::collections::HashSet;
use std::sync::Arc;

use wrapyfi_rmw::{EndpointType, Fault, Message, Node, Publisher, Subscription, Taken};

use super::graph::{
    CdrClient, CdrReply, CdrRequest, CdrServer, DiscoveredEndpoint, GraphError, GraphResult,
    Notify, Peers, RequestId, ServiceDescription,
};
use super::names;
use super::rmw_endpoints::{service_qos, uncreated, unsent};
use super::rmw_graph::RmwState;
use super::rmw_hashes::type_info;
use super::rmw_marks::Marked;
use super::service_header::{self, HEADER, Identified, LEAST};

/// A topic of DDS, its type as ROS 2 names it, and the type's hash.
type Half<'a> = (&'a str, String, Option<&'a str>);

/// Both topics of a client or a server.
struct Ends {
    publisher: Publisher,
    subscription: Subscription,
    service: ServiceDescription,
    lost: u64,
}

impl Ends {
    fn new(
        node: &Node,
        service: &ServiceDescription,
        [sends, takes]: [Half<'_>; 2],
        on_event: &Notify,
    ) -> GraphResult<Self> {
        let qos = service_qos(service);
        let (topic, kind, kind_hash) = takes;
        let made = node.subscription(topic, &type_info(&kind, kind_hash), &qos, false, on_event);
        let subscription = made.map_err(uncreated(service))?;
        let (topic, kind, kind_hash) = sends;
        let on_event = Arc::clone(on_event);
        let made = node.publisher(topic, &type_info(&kind, kind_hash), &qos, on_event);
        let publisher = made.map_err(uncreated(service))?;
        Ok(Self { publisher, subscription, service: service.clone(), lost: 0 })
    }

    fn send(&mut self, client: u64, sequence: i64, parts: &[&[u8]]) -> GraphResult<()> {
        let mut room = [0; HEADER];
        let joined = service_header::join(client, sequence, parts, &mut room);
        let joined = joined.ok_or_else(|| {
            GraphError::stack(
                "writing",
                &self.service.name,
                &"the message has no encapsulation header",
            )
        })?;
        self.publisher.publish(&joined).map_err(|fault| unsent(&self.service.name, fault))
    }

    /// The next message, its identity taken off; `what` names it.
    fn take(&self, what: &'static str) -> GraphResult<Option<(Message, Identified)>> {
        let (service, limit) = (&self.service.name, self.service.max_bytes);
        match self.subscription.take(limit.saturating_add(HEADER)) {
            Ok(Taken::Nothing) => Ok(None),
            Ok(Taken::Message(message)) => match service_header::split(&message.bytes) {
                Some(identified) => Ok(Some((message, identified))),
                None => Err(GraphError::NoIdentity {
                    what,
                    service: service.clone(),
                    actual: message.bytes.len(),
                    least: LEAST,
                }),
            },
            Ok(Taken::TooLarge(actual)) => Err(GraphError::TooLarge {
                topic: service.clone(),
                actual: actual.saturating_sub(HEADER),
                limit,
            }),
            Err(fault) => Err(GraphError::stack("taking", service, &fault)),
        }
    }

    fn peers(&self) -> Peers {
        match (self.publisher.matched(), self.subscription.matched()) {
            (0, 0) => Peers::None,
            (0, _) | (_, 0) => Peers::Half,
            (readers, writers) => Peers::Ready(readers.min(writers)),
        }
    }

    fn lost(&mut self) -> u64 {
        let lost = self.subscription.events().lost;
        lost.saturating_sub(std::mem::replace(&mut self.lost, lost))
    }
}

/// The topics of requests and of replies.
fn halves<'a>(names: &'a names::ServiceNames, service: &'a ServiceDescription) -> [Half<'a>; 2] {
    let kind = &service.type_name;
    [
        (&names.requests.0, format!("{kind}_Request"), service.request_hash.as_deref()),
        (&names.replies.0, format!("{kind}_Response"), service.response_hash.as_deref()),
    ]
}

fn names(service: &ServiceDescription) -> GraphResult<names::ServiceNames> {
    names::service_to_dds(&service.name, &service.type_name)
        .map_err(|error| GraphError::stack("creating a service's endpoints", &service.name, &error))
}

pub(super) struct PairedClient {
    ends: Ends,
    id: u64,
    sequence: i64,
}

impl PairedClient {
    pub(super) fn new(
        shared: &RmwState,
        service: &ServiceDescription,
        on_event: &Notify,
    ) -> GraphResult<Self> {
        let names = names(service)?;
        let [requests, replies] = halves(&names, service);
        let ends = Ends::new(&shared.node, service, [requests, replies], on_event)?;
        let id = service_header::client_id(ends.publisher.gid());
        Ok(Self { ends, id, sequence: 0 })
    }
}

impl CdrClient for PairedClient {
    fn send(&mut self, parts: &[&[u8]]) -> GraphResult<i64> {
        let sequence = self.sequence.saturating_add(1);
        self.ends.send(self.id, sequence, parts)?;
        self.sequence = sequence;
        Ok(sequence)
    }

    fn take(&mut self) -> GraphResult<Option<CdrReply>> {
        while let Some((message, reply)) = self.ends.take("reply")? {
            if reply.client == self.id {
                let (sequence, cdr) = (reply.sequence, reply.cdr);
                let source_timestamp_ns = message.source_timestamp_ns;
                return Ok(Some(CdrReply { sequence, cdr, source_timestamp_ns }));
            }
        }
        Ok(None)
    }

    fn id_of(&self, sequence: i64) -> RequestId {
        service_header::request_id(self.id, sequence)
    }

    fn servers(&self) -> Peers {
        self.ends.peers()
    }
}

pub(super) struct PairedServer {
    ends: Ends,
    shared: Arc<RmwState>,
    /// DDS topics of requests and of replies.
    topics: [String; 2],
    /// True when all clients hear replies, with the change of the graph for which that holds.
    hearing: Cell<(u64, bool)>,
    _marked: Option<Marked>,
    /// Clients come and go with the graph.
    _watch: Arc<wrapyfi_rmw::Notify>,
}

impl PairedServer {
    pub(super) fn new(
        shared: &Arc<RmwState>,
        service: &ServiceDescription,
        marked: Option<Marked>,
        on_event: &Notify,
    ) -> GraphResult<Self> {
        let (names, node) = (names(service)?, &shared.node);
        let [requests, replies] = halves(&names, service);
        let topics = [requests.0.to_owned(), replies.0.to_owned()];
        Ok(Self {
            ends: Ends::new(node, service, [replies, requests], on_event)?,
            shared: Arc::clone(shared),
            topics,
            hearing: Cell::new((u64::MAX, false)),
            _marked: marked,
            _watch: node.watch_graph(Arc::clone(on_event)),
        })
    }
}

impl PairedServer {
    /// True when every participant that sends requests takes replies. The middleware does not tell
    /// whose a request is.
    fn all_hear(&self) -> Result<bool, Fault> {
        let [requests, replies] = &self.topics;
        let participant = |(_, one): (_, DiscoveredEndpoint)| one.gid.first_chunk::<12>().copied();
        let others = |(_, one): &(_, DiscoveredEndpoint)| !one.is_own;
        let hearing = self.shared.on(replies, EndpointType::Subscriptions)?.map(participant);
        let hearing: HashSet<_> = hearing.collect();
        let mut asking = self.shared.on(requests, EndpointType::Publishers)?.filter(others);
        Ok(asking.all(|one| hearing.contains(&participant(one))))
    }
}

impl CdrServer for PairedServer {
    fn take(&mut self) -> GraphResult<Option<CdrRequest>> {
        let taken = self.ends.take("request")?;
        Ok(taken.map(|(message, request)| {
            let source_timestamp_ns = message.source_timestamp_ns;
            let id = service_header::request_id(request.client, request.sequence);
            CdrRequest { id, cdr: request.cdr, source_timestamp_ns, sample: None }
        }))
    }

    fn hears(&self, _: &RequestId) -> bool {
        let changes = self.shared.node.graph_changes();
        let (seen, mut hear) = self.hearing.get();
        if seen != changes || !hear {
            hear = self.all_hear().unwrap_or(true);
            self.hearing.set((changes, hear));
        }
        hear
    }

    fn reply(&mut self, id: &RequestId, parts: &[&[u8]]) -> GraphResult<()> {
        self.ends.send(service_header::client(id), id.sequence, parts)
    }

    fn clients(&self) -> Peers {
        self.ends.peers()
    }

    fn lost(&mut self) -> u64 {
        self.ends.lost()
    }
}
