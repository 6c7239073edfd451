//! [`Graph`] on CycloneDDS: one participant, one node.
//!
//! ```text
//!   CycloneGraph ──▶ Node { discovery info, participant, domain lease }
//!                      ▲ kept alive by its endpoints: cyclone_endpoints, cyclone_service
//! ```

use std::ffi::CStr;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
use std::sync::{Arc, MutexGuard};

use super::both_mappings;
use super::config::CycloneConfig;
use super::cyclone::{self, EndpointQos, Entity, Events, RawReader, RawWriter, ReturnCode};
use super::cyclone_endpoints::{CycloneReader, CycloneWriter, Listed};
use super::cyclone_service::{CycloneClient, CycloneServer, Ends};
use super::dds_terms::{ENCLAVE, discovered, end_user_data, marked, to_dds, user_data};
use super::discovery_info::{Announcing, DiscoveryInfo, EndpointKind, Gid};
use super::domain::{DomainError, DomainLease};
use super::graph::{
    CdrClient, CdrReader, CdrServer, CdrWriter, Created, DiscoveredEndpoint, Graph, GraphError,
    GraphResult, NodeWatch, Notify, PeerWatch, Replay, ServiceDescription, ServiceMapping,
    TopicDescription, WriterTraits,
};
use super::names;
use super::owners::Owners;
use super::pacing::{MAX_BLOCKING, Pacing};
use super::peer_index::PeerIndex;
use super::services::Services;
use wrapyfi_endpoint::{BridgeMark, History, Mutex, Qos, Reliability};
use wrapyfi_node::NodeName;

/// Partition of the endpoints of a service that no program uses yet: others find them, and do not match.
const ANNOUNCED: &CStr = c"announced";

/// Error of creating a node on CycloneDDS.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CycloneError {
    /// The node's domain cannot be joined.
    #[error(transparent)]
    Domain(#[from] DomainError),
    /// Cyclone refused the participant or its announcement.
    #[error("CycloneDDS could not create the node: {0}")]
    Participant(String),
}

/// A node on CycloneDDS.
#[derive(Clone)]
pub struct CycloneGraph {
    node: Arc<Node>,
    /// Node of another middleware, for which its endpoints stand.
    other: Option<Arc<NodeName>>,
}

/// Fields drop in this order: announcement, what watches discovery, participant, domain.
struct Node {
    name: NodeName,
    peers: Mutex<Option<Arc<PeerIndex>>>,
    info: Mutex<DiscoveryInfo>,
    participant: Entity,
    gid: Gid,
    /// Clients and servers created so far, which are numbered.
    service_ends: AtomicU32,
    services: Services,
    _domain: DomainLease,
}

impl CycloneGraph {
    /// Joins the domain and announces the node.
    ///
    /// # Errors
    /// When another node of this process uses the domain with another configuration, or Cyclone
    /// refuses.
    pub fn new(config: &CycloneConfig) -> Result<Self, CycloneError> {
        let domain = DomainLease::acquire(config)?;
        let fault = |code: ReturnCode| CycloneError::Participant(code.to_string());
        let participant = Entity::participant(config.domain_id, ENCLAVE).map_err(fault)?;
        let gid = participant.guid().map_err(fault)?;
        let info = DiscoveryInfo::new(&participant, &config.node).map_err(fault)?;
        info.publish();
        tracing::info!(
            node = config.node.fqn(),
            domain = config.domain_id,
            range = ?config.discovery_range,
            "ROS 2 node on CycloneDDS"
        );
        let node = Arc::new(Node {
            name: config.node.clone(),
            peers: Mutex::new(None),
            info: Mutex::new(info),
            participant,
            gid,
            service_ends: AtomicU32::new(1),
            services: Services::new(config),
            _domain: domain,
        });
        let announcing: Arc<dyn Announcing> = node.clone();
        node.services.announce(&announcing);
        Ok(Self { node, other: None })
    }

    /// GUID of the participant, as `ros_discovery_info` carries it.
    pub fn gid(&self) -> [u8; 16] {
        self.node.gid
    }

    /// Like [`Graph::subscribe`], with the names of DDS: for topics that are no ROS topics, such as
    /// `ros_discovery_info`.
    ///
    /// # Errors
    /// When Cyclone refuses.
    pub fn subscribe_dds(
        &self,
        topic: &TopicDescription,
        on_data: Notify,
    ) -> Created<dyn CdrReader> {
        let fault = |code: ReturnCode| GraphError::stack("creating a reader", &topic.name, &code);
        let events = Events::new(&topic.name, topic.qos.reliability, on_data);
        let user_data = user_data(topic);
        let names = (topic.name.as_str(), topic.type_name.as_str());
        let raw = RawReader::new(&self.node.participant, names, &qos(topic, &user_data), events)
            .map_err(fault)?;
        let gid = raw.guid().map_err(fault)?;
        let listed = self.list(EndpointKind::Reader, gid);
        let (topic, max_bytes) = (topic.name.clone(), topic.max_bytes);
        Ok(Box::new(CycloneReader { raw, topic, max_bytes, _listed: listed }))
    }

    /// Like [`Graph::advertise_with`], with the names of DDS.
    ///
    /// # Errors
    /// When Cyclone refuses.
    pub fn advertise_dds(
        &self,
        topic: &TopicDescription,
        WriterTraits { replay, mark }: WriterTraits<'_>,
        on_match: Notify,
    ) -> Created<dyn CdrWriter> {
        let fault = |code: ReturnCode| GraphError::stack("creating a writer", &topic.name, &code);
        let events = Events::new(&topic.name, topic.qos.reliability, on_match);
        let user_data = marked(user_data(topic), mark);
        let names = (topic.name.as_str(), topic.type_name.as_str());
        // It is for its readers to say whom they hear.
        let qos = EndpointQos { replay, ignore_local: false, ..qos(topic, &user_data) };
        let raw = RawWriter::new(&self.node.participant, names, &qos, events).map_err(fault)?;
        let gid = raw.guid().map_err(fault)?;
        let listed = self.list(EndpointKind::Writer, gid);
        let graph = self.clone();
        let pacing = Pacing::new(move || graph.nodes().ok(), topic);
        Ok(Box::new(CycloneWriter { pacing, raw, topic: topic.name.clone(), _listed: listed }))
    }

    /// Lists an endpoint in its node as long as the returned value lives.
    fn list(&self, kind: EndpointKind, gid: Gid) -> Listed {
        Listed::new(self.node.clone(), self.other.clone(), kind, gid)
    }

    /// Like [`Graph::watch`], with the name of DDS.
    fn watch_dds(
        &self,
        topic: String,
        publishers: bool,
        on_change: Notify,
    ) -> Created<dyn PeerWatch> {
        let index =
            self.node.peer_index().map_err(|code| GraphError::stack("watching", &topic, &code))?;
        Ok(Box::new(index.watch(self.node.clone(), topic, publishers, on_change)))
    }

    /// The two endpoints of a client (`clientid`) or a server (`serviceid`), the GUID of the writer,
    /// and their entries in the node.
    fn ends(
        &self,
        service: &ServiceDescription,
        id_key: &'static str,
        (mark, partition): (Option<&BridgeMark>, Option<&'static CStr>),
        on_event: &Notify,
    ) -> GraphResult<(Ends, Gid, [Listed; 2])> {
        let fault = |reason: String| {
            GraphError::stack("creating a service's endpoints", &service.name, &reason)
        };
        let code = |code: ReturnCode| fault(code.to_string());
        let names = names::service_to_dds(&service.name, &service.type_name)
            .map_err(|error| fault(error.to_string()))?;
        let node = &self.node;
        let id = names::end_id(&node.gid, node.service_ends.fetch_add(1, Relaxed));
        let data = |hash: &Option<String>| {
            let own = service.type_hash.as_deref();
            marked(end_user_data(id_key, &id, hash.as_deref(), own), mark)
        };
        let requests = (names.requests, data(&service.request_hash));
        let replies = (names.replies, data(&service.response_hash));
        let ((written, written_data), (read, read_data)) =
            if id_key == "clientid" { (requests, replies) } else { (replies, requests) };
        let qos = |user_data| EndpointQos {
            qos: Qos { history: History::KeepLast(service.depth), ..Qos::default() },
            max_blocking: MAX_BLOCKING,
            user_data,
            // A node may call its own services.
            ignore_local: false,
            replay: Replay::History,
            partition,
        };
        let events = || Events::new(&service.name, Reliability::Reliable, Arc::clone(on_event));
        // As ROS 2 does: the reader first, so that each reply finds its reader.
        let reader =
            RawReader::new(&node.participant, (&read.0, &read.1), &qos(&read_data), events());
        let reader = reader.map_err(code)?;
        let names = (written.0.as_str(), written.1.as_str());
        let writer = RawWriter::new(&node.participant, names, &qos(&written_data), events());
        let writer = writer.map_err(code)?;
        let gid = writer.guid().map_err(code)?;
        let listed = [
            self.list(EndpointKind::Reader, reader.guid().map_err(code)?),
            self.list(EndpointKind::Writer, gid),
        ];
        let is_beside = node.services.mapping().is_none();
        let ends = Ends::new(&service.name, writer, reader, service.max_bytes, is_beside);
        Ok((ends, gid, listed))
    }
}

impl Graph for CycloneGraph {
    fn node(&self) -> &NodeName {
        self.other.as_deref().unwrap_or(&self.node.name)
    }

    fn for_other(&self, node: &NodeName) -> GraphResult<Arc<dyn Graph>> {
        Ok(Arc::new(Self { other: Some(Arc::new(node.clone())), ..self.clone() }))
    }

    fn advertise_with(
        &self,
        topic: &TopicDescription,
        traits: WriterTraits<'_>,
        on_match: Notify,
    ) -> Created<dyn CdrWriter> {
        self.advertise_dds(&to_dds(topic)?, traits, on_match)
    }

    fn subscribe(&self, topic: &TopicDescription, on_data: Notify) -> Created<dyn CdrReader> {
        self.subscribe_dds(&to_dds(topic)?, on_data)
    }

    fn service_mapping(&self) -> Option<ServiceMapping> {
        self.node.services.mapping()
    }

    fn client(&self, service: &ServiceDescription, on_event: Notify) -> Created<dyn CdrClient> {
        let other = self.node.services.elsewhere(service)?;
        if let (Some(_), Some(other)) = (self.service_mapping(), other) {
            return other.client(service, on_event);
        }
        let (ends, guid, listed) = self.ends(service, "clientid", (None, None), &on_event)?;
        let client = Box::new(CycloneClient::new(ends, guid, listed));
        Ok(match in_both(service, other.map(|other| other.client(service, on_event))) {
            Some(fast_dds) => Box::new(both_mappings::Client::new(client, fast_dds)),
            None => client,
        })
    }

    fn server_marked(
        &self,
        service: &ServiceDescription,
        mark: Option<&BridgeMark>,
        on_event: Notify,
    ) -> Created<dyn CdrServer> {
        // There, there is no room for a mark.
        let other = self.node.services.elsewhere(service)?;
        if let (Some(_), Some(other)) = (self.service_mapping(), other) {
            return other.server(service, on_event);
        }
        let fast_dds = other.map(|other| other.server(service, Arc::clone(&on_event)));
        let (graph, of, mark) = (self.clone(), service.clone(), mark.cloned());
        let on_caller = Arc::clone(&on_event);
        let ends =
            move |partition| graph.ends(&of, "serviceid", (mark.as_ref(), partition), &on_event);
        let Some(fast_dds) = in_both(service, fast_dds) else {
            let (ends, _, listed) = ends(None)?;
            return Ok(Box::new(CycloneServer::new(ends, listed)));
        };
        let callers = self.watch_dds(format!("rq{}Request", service.name), true, on_caller)?;
        let announced = ends(Some(ANNOUNCED))?;
        let open = move || -> Created<dyn CdrServer> {
            let (ends, _, listed) = ends(None)?;
            Ok(Box::new(CycloneServer::new(ends, listed)))
        };
        let waiting = both_mappings::Waiting::new(Box::new(open), callers, Box::new(announced));
        Ok(Box::new(both_mappings::Server::new(waiting, fast_dds)))
    }

    fn endpoints(&self) -> GraphResult<Vec<DiscoveredEndpoint>> {
        let found = cyclone::endpoints(&self.node.participant)
            .map_err(|code| GraphError::stack("listing endpoints", &self.node.name.fqn(), &code))?;
        Ok(found
            .into_iter()
            .map(|endpoint| {
                let mut endpoint = discovered(endpoint, &self.node.gid);
                endpoint.is_own |= self.node.services.owns(&endpoint.gid);
                endpoint
            })
            .collect())
    }

    fn changes(&self) -> Option<u64> {
        self.node.peer_index().ok()?.changes()
    }

    fn participants(&self) -> Option<Vec<[u8; 12]>> {
        let own = self.node.gid.first_chunk();
        let all = cyclone::participants(&self.node.participant).ok()?;
        Some(all.into_iter().filter(|one| Some(one) != own).collect())
    }

    fn watch(&self, topic: &str, publishers: bool, on_change: Notify) -> Created<dyn PeerWatch> {
        self.watch_dds(names::topic_to_dds(topic), publishers, on_change)
    }

    fn nodes(&self) -> Created<dyn NodeWatch> {
        let reader = self.subscribe_dds(&Owners::topic(), Arc::new(|| {}))?;
        Ok(Box::new(Owners::new(reader)))
    }
}

impl Announcing for Node {
    fn info(&self) -> MutexGuard<'_, DiscoveryInfo> {
        self.info.lock()
    }
}

impl Node {
    /// Index of the endpoints that discovery has found, by topic; started by the first call.
    fn peer_index(&self) -> Result<Arc<PeerIndex>, ReturnCode> {
        let mut peers = self.peers.lock();
        if let Some(index) = &*peers {
            return Ok(Arc::clone(index));
        }
        let index = PeerIndex::new(&self.participant, self.gid)?;
        *peers = Some(Arc::clone(&index));
        Ok(index)
    }
}

impl Drop for Node {
    fn drop(&mut self) {
        self.info().retire();
        if let Some(index) = self.peers.get_mut() {
            index.close();
        }
    }
}

/// One half of a service in both mappings, where it could be created: without a choice the other one is enough.
fn in_both<T: ?Sized>(service: &ServiceDescription, half: Option<Created<T>>) -> Option<Box<T>> {
    match half.transpose() {
        Ok(half) => half,
        Err(error) => {
            let service = &service.name;
            tracing::warn!(service, "in the mapping of rmw_cyclonedds_cpp alone: {error}");
            None
        }
    }
}

fn qos<'a>(topic: &TopicDescription, user_data: &'a str) -> EndpointQos<'a> {
    // A node does not hear itself, which keeps routes from looping.
    EndpointQos {
        qos: topic.qos,
        max_blocking: MAX_BLOCKING,
        user_data,
        ignore_local: !topic.hears_own,
        replay: Replay::History,
        partition: None,
    }
}
