//! Writers, readers, clients and servers of a node on rmw.

use std::cell::Cell;
use std::sync::Arc;
use std::time::{Duration, Instant};

use wrapyfi_rmw::{
    Client, EndpointType, EventCounts, Fault, MATCH_SETTLES, Node, Publisher, Received, SendFault,
    Server, Service, Subscription, Taken,
};

use super::graph::{
    CdrClient, CdrReader, CdrReply, CdrRequest, CdrSample, CdrServer, CdrWriter, GraphError,
    GraphResult, Notify, Peers, QosEvents, RequestId, ServiceDescription,
};
use super::rmw_graph::RmwState;
use super::rmw_hashes::hash_from_text;
use super::rmw_marks::Marked;
use wrapyfi_endpoint::{History, Qos};

/// Longest time in milliseconds that rmw waits for reliable readers of which no message may be
/// lost.
const MAX_BLOCKING_MS: u64 = 100;

/// Time for which a server stays after its last reply. The client's reader may not have matched it yet: the reply is sent
/// again when it does, unless the server has gone. rmw does not tell whether a reply has arrived.
const REPLY_LINGER: Duration = Duration::from_millis(500);

pub(super) struct RmwWriter {
    pub(super) publisher: Publisher,
    pub(super) topic: String,
    pub(super) returned: Cell<QosEvents>,
    pub(super) _marked: Option<Marked>,
}

impl CdrWriter for RmwWriter {
    fn write(&mut self, parts: &[&[u8]]) -> GraphResult<()> {
        self.publisher.publish(parts).map_err(|fault| unsent(&self.topic, fault))
    }

    fn matched(&self) -> usize {
        self.publisher.matched()
    }

    fn incompatible(&self) -> Option<&'static str> {
        self.publisher.events().incompatible
    }

    fn qos_events(&self) -> QosEvents {
        since(&self.returned, &self.publisher.events())
    }
}

pub(super) struct RmwReader {
    pub(super) subscription: Subscription,
    pub(super) topic: String,
    pub(super) max_bytes: usize,
    pub(super) lost: u64,
    pub(super) returned: Cell<QosEvents>,
    pub(super) shared: Arc<RmwState>,
}

impl RmwReader {
    /// Publishers of other nodes on the topic.
    fn found(&self) -> Vec<[u8; 16]> {
        let found = self.shared.on(&self.shared.spelled(&self.topic), EndpointType::Publishers);
        let others = found.into_iter().flatten().filter(|(_, found)| !found.is_own);
        others.map(|(_, found)| found.gid).collect()
    }
}

impl CdrReader for RmwReader {
    fn take(&mut self) -> GraphResult<Option<CdrSample>> {
        match self.subscription.take(self.max_bytes) {
            Ok(Taken::Nothing) => Ok(None),
            Ok(Taken::Message(message)) => Ok(Some(CdrSample {
                cdr: message.bytes,
                source_timestamp_ns: message.source_timestamp_ns,
                publisher: self.shared.publishers.number(&message.publisher),
            })),
            Ok(Taken::TooLarge(actual)) => {
                let (topic, limit) = (self.topic.clone(), self.max_bytes);
                Err(GraphError::TooLarge { topic, actual, limit })
            }
            Err(fault) => Err(GraphError::stack("taking", &self.topic, &fault)),
        }
    }

    fn matched(&self) -> usize {
        self.subscription.matched()
    }

    fn publishers(&self) -> Option<Vec<u64>> {
        let number = |gid: &[u8; 16]| self.shared.publishers.number(gid);
        self.shared.names_publishers().then(|| self.found().iter().map(number).collect())
    }

    fn publisher_gid(&self, publisher: u64) -> Option<[u8; 16]> {
        if self.shared.names_publishers() {
            return self.shared.publishers.gid(publisher);
        }
        // Messages carry no identity: the sender is known only where there is one publisher.
        match *self.found() {
            [only] => Some(only),
            _ => None,
        }
    }

    fn lost(&mut self) -> u64 {
        let lost = self.subscription.events().lost;
        let more = lost.saturating_sub(self.lost);
        self.lost = lost;
        more
    }

    fn incompatible(&self) -> Option<&'static str> {
        self.subscription.events().incompatible
    }

    fn qos_events(&self) -> QosEvents {
        since(&self.returned, &self.subscription.events())
    }
}

/// Number of events since `returned`, which is set to the present counts.
fn since(returned: &Cell<QosEvents>, counts: &EventCounts) -> QosEvents {
    let now = QosEvents {
        deadlines_missed: counts.deadlines_missed,
        liveliness_lost: counts.liveliness_lost,
    };
    let before = returned.replace(now);
    QosEvents {
        deadlines_missed: now.deadlines_missed.saturating_sub(before.deadlines_missed),
        liveliness_lost: now.liveliness_lost.saturating_sub(before.liveliness_lost),
    }
}

pub(super) fn unsent(topic: &str, fault: SendFault) -> GraphError {
    match fault {
        SendFault::Refused(fault) => GraphError::stack("writing", topic, &fault),
        _ => GraphError::Timeout { topic: topic.to_owned(), timeout_ms: MAX_BLOCKING_MS },
    }
}

pub(super) fn service_qos(service: &ServiceDescription) -> Qos {
    Qos { history: History::KeepLast(service.depth), ..Qos::default() }
}

fn described(service: &ServiceDescription) -> Service<'_> {
    let hash = |text: &Option<String>| text.as_deref().and_then(hash_from_text);
    Service {
        name: &service.name,
        type_name: &service.type_name,
        hashes: [&service.type_hash, &service.request_hash, &service.response_hash].map(hash),
        qos: service_qos(service),
    }
}

pub(super) fn uncreated(service: &ServiceDescription) -> impl FnOnce(Fault) -> GraphError {
    |fault| GraphError::stack("creating a service's endpoints", &service.name, &fault)
}

/// The message that was taken, if one was, or the error of one that was too large.
fn within(
    taken: Result<Option<Received>, Fault>,
    service: &ServiceDescription,
) -> GraphResult<Option<(bytes::Bytes, Received)>> {
    let taken = taken.map_err(|fault| GraphError::stack("taking", &service.name, &fault))?;
    let Some(received) = taken else { return Ok(None) };
    match &received.cdr {
        Ok(cdr) => Ok(Some((cdr.clone(), received))),
        Err(actual) => Err(GraphError::TooLarge {
            topic: service.name.clone(),
            actual: *actual,
            limit: service.max_bytes,
        }),
    }
}

pub(super) struct RmwClient {
    client: Client,
    service: ServiceDescription,
    /// Time since which a server is there, and true when that was too short at the last look.
    there_since: Cell<Option<(Instant, bool)>>,
    /// Servers come and go with the graph.
    _watch: Arc<wrapyfi_rmw::Notify>,
}

impl RmwClient {
    pub(super) fn new(
        node: &Node,
        service: &ServiceDescription,
        on_event: &Notify,
    ) -> GraphResult<Self> {
        let made = node.client(&described(service), Arc::clone(on_event));
        let client = made.map_err(uncreated(service))?;
        let watch = node.watch_graph(Arc::clone(on_event));
        Ok(Self { client, service: service.clone(), there_since: Cell::default(), _watch: watch })
    }
}

impl CdrClient for RmwClient {
    fn send(&mut self, parts: &[&[u8]]) -> GraphResult<i64> {
        self.client.send(parts).map_err(|fault| unsent(&self.service.name, fault))
    }

    fn take(&mut self) -> GraphResult<Option<CdrReply>> {
        let taken = within(self.client.take(self.service.max_bytes), &self.service)?;
        Ok(taken.map(|(cdr, Received { id, source_timestamp_ns, .. })| CdrReply {
            sequence: id.sequence,
            cdr,
            source_timestamp_ns,
        }))
    }

    fn id_of(&self, sequence: i64) -> RequestId {
        RequestId { client: self.client.gid(), sequence }
    }

    fn servers(&self) -> Peers {
        if !self.client.has_server() {
            self.there_since.set(None);
            return Peers::None;
        }
        let since = self.there_since.get().map_or_else(Instant::now, |(since, _)| since);
        let is_new = since.elapsed() < MATCH_SETTLES;
        self.there_since.set(Some((since, is_new)));
        if is_new { Peers::Half } else { Peers::Ready(self.client.servers().max(1)) }
    }

    fn look_again(&self) -> Option<Duration> {
        let (since, was_new) = self.there_since.get()?;
        was_new.then(|| MATCH_SETTLES.saturating_sub(since.elapsed()))
    }
}

pub(super) struct RmwServer {
    server: Server,
    service: ServiceDescription,
    last_reply: Option<Instant>,
    _marked: Option<Marked>,
    /// Clients come and go with the graph.
    _watch: Arc<wrapyfi_rmw::Notify>,
}

impl RmwServer {
    pub(super) fn new(
        node: &Node,
        service: &ServiceDescription,
        marked: Option<Marked>,
        on_event: &Notify,
    ) -> GraphResult<Self> {
        let made = node.server(&described(service), Arc::clone(on_event));
        let server = made.map_err(uncreated(service))?;
        let watch = node.watch_graph(Arc::clone(on_event));
        let service = service.clone();
        Ok(Self { server, service, last_reply: None, _marked: marked, _watch: watch })
    }
}

impl CdrServer for RmwServer {
    fn take(&mut self) -> GraphResult<Option<CdrRequest>> {
        let taken = within(self.server.take(self.service.max_bytes), &self.service)?;
        Ok(taken.map(|(cdr, Received { id, source_timestamp_ns, .. })| {
            let id = RequestId { client: id.client, sequence: id.sequence };
            CdrRequest { id, cdr, source_timestamp_ns, sample: None }
        }))
    }

    /// True: rmw itself waits until the client hears its reply.
    fn reply(&mut self, id: &RequestId, parts: &[&[u8]]) -> GraphResult<()> {
        let id = wrapyfi_rmw::RequestId { client: id.client, sequence: id.sequence };
        let sent = self.server.reply(&id, parts);
        self.last_reply = Some(Instant::now());
        sent.map_err(|fault| unsent(&self.service.name, fault))
    }

    fn clients(&self) -> Peers {
        match self.server.clients() {
            0 => Peers::None,
            clients => Peers::Ready(clients),
        }
    }
}

impl Drop for RmwServer {
    fn drop(&mut self) {
        if let Some(at) = self.last_reply {
            std::thread::sleep(REPLY_LINGER.saturating_sub(at.elapsed()));
        }
    }
}
