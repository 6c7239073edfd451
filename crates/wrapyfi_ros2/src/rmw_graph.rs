//! [`Graph`] on the rmw of an installed ROS 2: the middleware that `RMW_IMPLEMENTATION` names, as every node has it.
//!
//! ```text
//!   RmwGraph ── wrapyfi_rmw::Node ── librmw_implementation ── rmw_fastrtps_cpp, rmw_zenoh_cpp, …
//!      │           topics, services: rmw_endpoints; services of rmw_cyclonedds_cpp: rmw_paired
//!      └── discovery: what rmw knows of the graph, asked again when it has changed
//! ```
//!
//! rmw shows no USER_DATA, where the marks of bridges are on DDS: bridges tell each other (`rmw_marks`).

use std::cell::Cell;
use std::collections::{HashMap, HashSet};
use std::hash::{DefaultHasher, Hash, Hasher as _};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::{Duration, Instant};

use wrapyfi_rmw::{EndpointType, Fault, Gid, Node, NodeOptions};

use super::config::CycloneConfig;
use super::environment::DiscoveryRange;
use super::graph::{
    CdrClient, CdrReader, CdrServer, CdrWriter, Created, DiscoveredEndpoint, Graph, GraphError,
    GraphResult, NodeWatch, Notify, PeerWatch, ServiceDescription, ServiceMapping,
    TopicDescription, WriterTraits,
};
use super::names;
use super::rmw_endpoints::{RmwClient, RmwReader, RmwServer, RmwWriter};
use super::rmw_hashes::{hash_to_text, type_info};
use super::rmw_marks::{self, Marked, Marks};
use super::rmw_paired::{PairedClient, PairedServer};
use wrapyfi_endpoint::{BridgeMark, Mutex, Qos};
use wrapyfi_node::NodeName;

/// A node on the rmw that is loaded.
#[derive(Clone)]
pub struct RmwGraph(Arc<RmwState>);

/// State that the endpoints of a node share.
pub(super) struct RmwState {
    name: NodeName,
    pub(super) node: Node,
    /// Endpoints whose nodes or marks are not known yet, and since when they are.
    nameless: Mutex<HashMap<Gid, Instant>>,
    marks: Arc<Marks>,
    mapping: ServiceMapping,
    is_dds: bool,
    pub(super) publishers: Arc<Publishers>,
    /// Full names of the nodes of this program, those of other middlewares among them.
    own: Arc<Mutex<HashSet<String>>>,
}

/// Numbers that stand for the identities of publishers.
#[derive(Default)]
pub(super) struct Publishers(Mutex<(HashMap<Gid, u64>, HashMap<u64, Gid>)>);

/// Publishers that are numbered: strangers announce them.
const MAX_PUBLISHERS: usize = 65_536;

impl Publishers {
    /// The publisher's number; 0 where there are too many.
    pub(super) fn number(&self, gid: &Gid) -> u64 {
        let mut known = self.0.lock();
        let (by_gid, by_number) = &mut *known;
        if let Some(&number) = by_gid.get(gid) {
            return number;
        }
        if by_gid.len() >= MAX_PUBLISHERS {
            return 0;
        }
        let number = by_gid.len() as u64 + 1;
        by_gid.insert(*gid, number);
        by_number.insert(number, *gid);
        number
    }

    pub(super) fn gid(&self, number: u64) -> Option<Gid> {
        self.0.lock().1.get(&number).copied()
    }
}

impl RmwGraph {
    /// Joins the graph of the middleware that is loaded. Of `config`, what concerns CycloneDDS alone has no effect.
    ///
    /// # Errors
    /// When the middleware cannot be loaded or refuses; the reason is its own.
    pub fn new(config: &CycloneConfig, enclave: &str) -> Result<Self, Fault> {
        let implementation = wrapyfi_rmw::implementation()?;
        let options = NodeOptions {
            name: config.node.name().to_owned(),
            namespace: config.node.namespace().to_owned(),
            enclave: enclave.to_owned(),
            domain_id: config.domain_id,
            range: match config.discovery_range {
                DiscoveryRange::Subnet => wrapyfi_rmw::DiscoveryRange::Subnet,
                DiscoveryRange::Localhost => wrapyfi_rmw::DiscoveryRange::Localhost,
                DiscoveryRange::Off => wrapyfi_rmw::DiscoveryRange::Off,
                DiscoveryRange::SystemDefault => wrapyfi_rmw::DiscoveryRange::SystemDefault,
            },
            static_peers: config.static_peers.clone(),
        };
        let node = Node::new(&options)?;
        let mapping = match implementation.as_str() {
            "rmw_cyclonedds_cpp" => ServiceMapping::Cyclone,
            _ => ServiceMapping::FastDds,
        };
        let is_dds = implementation != "rmw_zenoh_cpp";
        let (name, marks, nameless) = (config.node.clone(), Arc::default(), Mutex::default());
        let own = Arc::new(Mutex::new(HashSet::from([name.fqn()])));
        let publishers = Arc::default();
        let state = RmwState { name, node, nameless, marks, mapping, is_dds, publishers, own };
        Ok(Self(Arc::new(state)))
    }
}

impl RmwGraph {
    /// Tells other bridges of the mark of endpoints, as long as the returned value lives.
    fn mark(&self, mark: &BridgeMark, ends: Vec<rmw_marks::EndpointKey>) -> Marked {
        self.join_marks();
        self.0.marks.put(mark, ends)
    }

    fn join_marks(&self) {
        let marks = Arc::downgrade(&self.0.marks);
        let hear = move || {
            if let Some(marks) = marks.upgrade() {
                marks.hear();
            }
        };
        let on_news: Notify = Arc::new(hear);
        self.0.marks.join(&self.0.name, &self.0.node, &on_news);
    }
}

impl Graph for RmwGraph {
    fn node(&self) -> &NodeName {
        &self.0.name
    }

    fn for_other(&self, node: &NodeName) -> GraphResult<Arc<dyn Graph>> {
        let child = self.0.node.child(node.name(), node.namespace());
        let child =
            child.map_err(|fault| GraphError::stack("creating a node", &node.fqn(), &fault))?;
        // Others are told of marks under the name of this node.
        self.join_marks();
        self.0.own.lock().insert(node.fqn());
        let RmwState { marks, mapping, is_dds, publishers, own, .. } = &*self.0;
        Ok(Arc::new(Self(Arc::new(RmwState {
            name: node.clone(),
            node: child,
            nameless: Mutex::default(),
            marks: Arc::clone(marks),
            mapping: *mapping,
            is_dds: *is_dds,
            publishers: Arc::clone(publishers),
            own: Arc::clone(own),
        }))))
    }

    fn advertise_with(
        &self,
        topic: &TopicDescription,
        traits: WriterTraits<'_>,
        on_match: Notify,
    ) -> Created<dyn CdrWriter> {
        let of = type_info(&topic.type_name, topic.type_hash.as_deref());
        let ends = || vec![(true, self.0.spelled(&topic.name))];
        let marked = traits.mark.map(|mark| self.mark(mark, ends()));
        let node = &self.0.node;
        let made = node.publisher(&topic.name, &of, &topic.qos, on_match);
        let publisher =
            made.map_err(|fault| GraphError::stack("creating a writer", &topic.name, &fault))?;
        let (topic, returned) = (topic.name.clone(), Cell::default());
        Ok(Box::new(RmwWriter { publisher, topic, returned, _marked: marked }))
    }

    fn subscribe(&self, topic: &TopicDescription, on_data: Notify) -> Created<dyn CdrReader> {
        let of = type_info(&topic.type_name, topic.type_hash.as_deref());
        let made =
            self.0.node.subscription(&topic.name, &of, &topic.qos, topic.hears_own, &on_data);
        let subscription =
            made.map_err(|fault| GraphError::stack("creating a reader", &topic.name, &fault))?;
        Ok(Box::new(RmwReader {
            subscription,
            topic: topic.name.clone(),
            max_bytes: topic.max_bytes,
            lost: 0,
            returned: Cell::default(),
            shared: Arc::clone(&self.0),
        }))
    }

    fn service_mapping(&self) -> Option<ServiceMapping> {
        Some(self.0.mapping)
    }

    fn client(&self, service: &ServiceDescription, on_event: Notify) -> Created<dyn CdrClient> {
        Ok(match self.0.mapping {
            ServiceMapping::Cyclone => Box::new(PairedClient::new(&self.0, service, &on_event)?),
            ServiceMapping::FastDds => Box::new(RmwClient::new(&self.0.node, service, &on_event)?),
        })
    }

    fn server_marked(
        &self,
        service: &ServiceDescription,
        mark: Option<&BridgeMark>,
        on_event: Notify,
    ) -> Created<dyn CdrServer> {
        let names = names::service_to_dds(&service.name, &service.type_name).ok();
        let marked = mark.zip(names).map(|(mark, names)| {
            self.mark(mark, vec![(false, names.requests.0), (true, names.replies.0)])
        });
        Ok(match self.0.mapping {
            ServiceMapping::Cyclone => {
                Box::new(PairedServer::new(&self.0, service, marked, &on_event)?)
            }
            ServiceMapping::FastDds => {
                Box::new(RmwServer::new(&self.0.node, service, marked, &on_event)?)
            }
        })
    }

    fn endpoints(&self) -> GraphResult<Vec<DiscoveredEndpoint>> {
        let failed = |fault| GraphError::stack("listing endpoints", &self.0.name.fqn(), &fault);
        self.join_marks();
        self.0.marks.hear();
        let found = self.0.all().map_err(failed)?;
        let nodes = self.0.node.nodes().map_err(failed)?;
        let bridges =
            nodes.iter().filter_map(|(name, namespace)| rmw_marks::bridge(name, namespace));
        let bridges: HashSet<&str> = bridges.collect();
        let marks = self.0.spelled(rmw_marks::TOPIC);
        let mut nameless = self.0.nameless.lock();
        let before = std::mem::take(&mut *nameless);
        let now = Instant::now();
        let named = found.into_iter().filter(|(node, found)| {
            if found.dds_topic == marks {
                return false;
            }
            let is_unmarked = !found.is_own && found.mark.is_none() && bridges.contains(&**node);
            if !node.ends_with(NAMELESS) && !is_unmarked {
                return true;
            }
            let since = before.get(&found.gid).copied().unwrap_or(now);
            nameless.insert(found.gid, since);
            now.saturating_duration_since(since) >= NAMES_COME
        });
        Ok(named.map(|(_, found)| found).collect())
    }

    fn watch(&self, topic: &str, publishers: bool, on_change: Notify) -> Created<dyn PeerWatch> {
        let side = if publishers { EndpointType::Publishers } else { EndpointType::Subscriptions };
        let watched = Arc::new(Watched {
            shared: Arc::clone(&self.0),
            topic: self.0.spelled(topic),
            side,
            peers: Mutex::default(),
            changes: AtomicU64::new(1),
        });
        let looks = Arc::clone(&watched);
        let kept = self.0.node.watch_graph(Arc::new(move || {
            if looks.look() {
                on_change();
            }
        }));
        self.join_marks();
        self.0.marks.watch(&kept);
        // Endpoints that were there before are no change, so they are looked up once.
        watched.look();
        Ok(Box::new(Watch { watched, _kept: kept }))
    }

    fn nodes(&self) -> Created<dyn NodeWatch> {
        Ok(Box::new(Nodes {
            shared: Arc::clone(&self.0),
            seen: u64::MAX,
            owners: HashMap::default(),
        }))
    }
}

impl RmwState {
    /// A topic as the middleware spells it: only DDS has prefixes.
    pub(super) fn spelled(&self, topic: &str) -> String {
        if self.is_dds { names::topic_to_dds(topic) } else { topic.to_owned() }
    }

    /// True when messages carry the identities that the graph has for their publishers:
    /// `rmw_cyclonedds_cpp` has others for each process.
    pub(super) fn names_publishers(&self) -> bool {
        self.mapping != ServiceMapping::Cyclone
    }

    /// All endpoints, each with its node's name.
    fn all(&self) -> Result<Vec<(String, DiscoveredEndpoint)>, Fault> {
        let mut all = Vec::new();
        for (topic, _) in self.node.topics()? {
            for side in [EndpointType::Publishers, EndpointType::Subscriptions] {
                all.extend(self.on(&topic, side)?);
            }
        }
        if !self.is_dds {
            self.add_services(&mut all)?;
        }
        Ok(all)
    }

    /// Adds the services of a middleware that has no topics for them, as the half of their requests on DDS.
    fn add_services(&self, all: &mut Vec<(String, DiscoveredEndpoint)>) -> Result<(), Fault> {
        for (name, namespace) in self.node.nodes()? {
            let fqn = format!("{}/{name}", namespace.trim_end_matches('/'));
            for clients in [false, true] {
                // A node that went in between has none.
                let found = self.node.services_of((&name, &namespace), clients);
                for (service, types) in found.unwrap_or_default() {
                    for ros_type in types {
                        let Ok(dds) = names::service_to_dds(&service, &ros_type) else { continue };
                        let (dds_topic, dds_type) = dds.requests;
                        let gid = gid_of(&(&fqn, &service, clients));
                        let mark = self.marks.of(&fqn, &(clients, dds_topic.clone()));
                        let found = DiscoveredEndpoint {
                            is_publisher: clients,
                            topic: dds_topic.clone(),
                            dds_topic,
                            type_name: dds_type.clone(),
                            dds_type,
                            type_hash: None,
                            gid,
                            qos: Qos::default().into(),
                            is_own: self.own.lock().contains(&fqn),
                            mark,
                            service_mapping: None,
                        };
                        all.push((fqn.clone(), found));
                    }
                }
            }
        }
        Ok(())
    }

    /// The endpoints on one side of a DDS topic, each with its node's name.
    pub(super) fn on(
        &self,
        topic: &str,
        side: EndpointType,
    ) -> Result<impl Iterator<Item = (String, DiscoveredEndpoint)> + use<'_>, Fault> {
        let found = self.node.endpoints(topic, side)?;
        let topic = topic.to_owned();
        Ok(found.into_iter().map(move |endpoint| {
            let is_publisher = side == EndpointType::Publishers;
            let is_own = self.own.lock().contains(&endpoint.node) || self.node.owns(&endpoint.gid);
            let mark = self.marks.of(&endpoint.node, &(is_publisher, topic.clone()));
            let found = DiscoveredEndpoint {
                is_publisher,
                topic: names::topic_from_dds(&topic).unwrap_or(&topic).to_owned(),
                dds_topic: topic.clone(),
                type_name: names::type_from_dds(&endpoint.type_name)
                    .unwrap_or_else(|| endpoint.type_name.clone()),
                dds_type: endpoint.type_name,
                type_hash: endpoint.type_hash.as_ref().map(hash_to_text),
                gid: endpoint.gid,
                qos: endpoint.qos,
                is_own,
                mark,
                service_mapping: super::vendor::mapping_of(&endpoint.gid, None),
            };
            (endpoint.node, found)
        }))
    }
}

/// Identity of an endpoint that rmw gives none, the same at every look.
fn gid_of(key: &impl Hash) -> [u8; 16] {
    let half = |salt: u64| {
        let mut hasher = DefaultHasher::new();
        (salt, key).hash(&mut hasher);
        hasher.finish()
    };
    (u128::from(half(0)) << 64 | u128::from(half(1))).to_be_bytes()
}

/// Name that rmw gives a node whose own name has not arrived.
const NAMELESS: &str = "_NODE_NAME_UNKNOWN_";
/// Time within which nodes say their names, which come after their endpoints, and bridges their marks. An endpoint whose
/// node says none is not of ROS.
const NAMES_COME: Duration = Duration::from_millis(500);

/// Endpoints that are known of one side of a topic.
struct Watched {
    shared: Arc<RmwState>,
    topic: String,
    side: EndpointType,
    peers: Mutex<Vec<DiscoveredEndpoint>>,
    changes: AtomicU64,
}

impl Watched {
    /// Asks the graph; whether something is different.
    fn look(&self) -> bool {
        let mut now: Vec<_> = match self.shared.on(&self.topic, self.side) {
            Ok(found) => found.map(|(_, found)| found).filter(|found| !found.is_own).collect(),
            Err(fault) => {
                tracing::warn!(%fault, topic = self.topic, "cannot read what discovery found");
                return false;
            }
        };
        now.sort_by_key(|peer| peer.gid);
        let mut peers = self.peers.lock();
        let is_new = *peers != now;
        if is_new {
            *peers = now;
            self.changes.fetch_add(1, Relaxed);
        }
        is_new
    }
}

/// Watches until it is dropped.
struct Watch {
    watched: Arc<Watched>,
    _kept: Arc<wrapyfi_rmw::Notify>,
}

impl PeerWatch for Watch {
    fn peers(&self) -> Vec<DiscoveredEndpoint> {
        self.watched.peers.lock().clone()
    }

    fn changes(&self) -> u64 {
        self.watched.changes.load(Relaxed)
    }
}

/// Owners of the endpoints, as of the change of the graph that was seen last.
struct Nodes {
    shared: Arc<RmwState>,
    seen: u64,
    owners: HashMap<Gid, String>,
}

impl NodeWatch for Nodes {
    fn update(&mut self) -> bool {
        let changes = self.shared.node.graph_changes();
        if self.seen == changes {
            return false;
        }
        match self.shared.all() {
            Ok(all) => {
                let named = all.into_iter().filter(|(node, _)| !node.ends_with(NAMELESS));
                self.owners = named.map(|(node, found)| (found.gid, node)).collect();
                self.seen = changes;
            }
            Err(fault) => tracing::warn!(%fault, "cannot read whose endpoints there are"),
        }
        true
    }

    fn owner(&self, gid: &Gid) -> Option<&str> {
        self.owners.get(gid).map(String::as_str)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_publisher_has_one_number() {
        let publishers = Publishers::default();
        let number = publishers.number(&[1; 16]);
        assert_ne!(number, 0);
        assert_eq!(number, publishers.number(&[1; 16]));
        assert_eq!(publishers.gid(number), Some([1; 16]));
        assert_ne!(number, publishers.number(&[2; 16]));
    }
}
