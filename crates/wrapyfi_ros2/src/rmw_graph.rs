//! [`Graph`] on the rmw of an installed ROS 2: the middleware that `RMW_IMPLEMENTATION` names, as every node has it.
//!
//! ```text
//!   RmwGraph ── wrapyfi_rmw::Node ── librmw_implementation ── rmw_fastrtps_cpp, rmw_zenoh_cpp, …
//!      │           topics, services: rmw_endpoints; services of rmw_cyclonedds_cpp: rmw_paired
//!      └── discovery: what rmw knows of the graph, asked again when it has changed
//! ```
//!
//! rmw shows no USER_DATA. The mark of a bridge is the name of a child of its node, which has the marked endpoints:
//! `/bridge/_mark/ros/yarp/_0196a3b2c4d5e6f7` of the node `/bridge`. Tools hide such nodes, and here the endpoints are
//! the parent's.

use std::cell::Cell;
use std::collections::HashMap;
use std::fmt::Write as _;
use std::hash::{DefaultHasher, Hash, Hasher as _};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::{Duration, Instant};

use wrapyfi_rmw::{EndpointType, Fault, Gid, Node, NodeOptions, TypeHash};

use super::config::CycloneConfig;
use super::environment::DiscoveryRange;
use super::graph::{
    CdrClient, CdrReader, CdrServer, CdrWriter, Created, DiscoveredEndpoint, Graph, GraphError,
    GraphResult, NodeWatch, Notify, PeerWatch, ServiceDescription, ServiceMapping,
    TopicDescription, WriterTraits,
};
use super::names;
use super::rmw_endpoints::{RmwClient, RmwReader, RmwServer, RmwWriter};
use super::rmw_paired::{PairedClient, PairedServer};
use wrapyfi_endpoint::{BridgeMark, Mutex, Qos};
use wrapyfi_node::NodeName;

/// A node on the rmw that is loaded.
#[derive(Clone)]
pub struct RmwGraph(Arc<Shared>);

/// State that the endpoints of a node share.
pub(super) struct Shared {
    name: NodeName,
    pub(super) node: Node,
    /// Endpoints whose nodes are not known yet, and since when they are.
    nameless: Mutex<HashMap<Gid, Instant>>,
    /// Children of the node, by the marks that they are.
    marks: Mutex<HashMap<BridgeMark, Node>>,
    mapping: ServiceMapping,
    is_dds: bool,
    pub(super) publishers: Publishers,
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
        let publishers = Publishers::default();
        let (name, marks, nameless) = (config.node.clone(), Mutex::default(), Mutex::default());
        Ok(Self(Arc::new(Shared { name, node, nameless, marks, mapping, is_dds, publishers })))
    }
}

impl Graph for RmwGraph {
    fn node(&self) -> &NodeName {
        &self.0.name
    }

    fn advertise_with(
        &self,
        topic: &TopicDescription,
        traits: WriterTraits<'_>,
        on_match: Notify,
    ) -> Created<dyn CdrWriter> {
        let hash = topic.type_hash.as_deref().and_then(hash_from_text);
        let node = self.0.marked(traits.mark);
        let made =
            node.publisher(&topic.name, &topic.type_name, hash.as_ref(), &topic.qos, on_match);
        let publisher =
            made.map_err(|fault| GraphError::stack("creating a writer", &topic.name, &fault))?;
        let (topic, returned) = (topic.name.clone(), Cell::default());
        Ok(Box::new(RmwWriter { publisher, topic, returned }))
    }

    fn subscribe(&self, topic: &TopicDescription, on_data: Notify) -> Created<dyn CdrReader> {
        let hash = topic.type_hash.as_deref().and_then(hash_from_text);
        let made = self.0.node.subscription(
            &topic.name,
            &topic.type_name,
            hash.as_ref(),
            &topic.qos,
            topic.hears_own,
            &on_data,
        );
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

    fn service_mapping(&self) -> ServiceMapping {
        self.0.mapping
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
        let node = self.0.marked(mark);
        Ok(match self.0.mapping {
            ServiceMapping::Cyclone => {
                Box::new(PairedServer::new(&self.0, &node, service, &on_event)?)
            }
            ServiceMapping::FastDds => Box::new(RmwServer::new(&node, service, &on_event)?),
        })
    }

    fn endpoints(&self) -> GraphResult<Vec<DiscoveredEndpoint>> {
        let found = self.0.all();
        let found = found
            .map_err(|fault| GraphError::stack("listing endpoints", &self.0.name.fqn(), &fault))?;
        let mut nameless = self.0.nameless.lock();
        let before = std::mem::take(&mut *nameless);
        let now = Instant::now();
        let named = found.into_iter().filter(|(node, found)| {
            if !node.ends_with(NAMELESS) {
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

impl Shared {
    /// A topic as the middleware spells it: only DDS has prefixes.
    pub(super) fn spelled(&self, topic: &str) -> String {
        if self.is_dds { names::topic_to_dds(topic) } else { topic.to_owned() }
    }

    /// True when messages carry the identities that the graph has for their publishers:
    /// `rmw_cyclonedds_cpp` has others for each process.
    pub(super) fn names_publishers(&self) -> bool {
        self.mapping != ServiceMapping::Cyclone
    }

    /// The node that has endpoints with this mark.
    fn marked(&self, mark: Option<&BridgeMark>) -> Node {
        let Some(mark) = mark else { return self.node.clone() };
        let mut marks = self.marks.lock();
        if let Some(node) = marks.get(mark) {
            return node.clone();
        }
        let (name, namespace) = child(&self.name.fqn(), mark);
        match self.node.child(&name, &namespace) {
            Ok(node) => marks.entry(mark.clone()).or_insert(node).clone(),
            Err(fault) => {
                tracing::warn!(%fault, %mark, "other bridges will not know what this one makes");
                self.node.clone()
            }
        }
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
            let (node, mark) = parent(&fqn);
            for clients in [false, true] {
                // A node that went in between has none.
                let found = self.node.services_of((&name, &namespace), clients);
                for (service, types) in found.unwrap_or_default() {
                    for ros_type in types {
                        let Ok(dds) = names::service_to_dds(&service, &ros_type) else { continue };
                        let (dds_topic, dds_type) = dds.requests;
                        let gid = gid_of(&(&fqn, &service, clients));
                        let found = DiscoveredEndpoint {
                            is_publisher: clients,
                            topic: dds_topic.clone(),
                            dds_topic,
                            type_name: dds_type.clone(),
                            dds_type,
                            type_hash: None,
                            gid,
                            qos: Qos::default().into(),
                            is_own: node == self.name.fqn(),
                            mark: mark.clone(),
                            service_mapping: None,
                        };
                        all.push((node.to_owned(), found));
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
            let (node, mark) = parent(&endpoint.node);
            let is_own = node == self.name.fqn() || self.node.owns(&endpoint.gid);
            let found = DiscoveredEndpoint {
                is_publisher: side == EndpointType::Publishers,
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
            (node.to_owned(), found)
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
/// Time within which nodes say their names, which come after their endpoints. An endpoint whose node says none is not
/// of ROS.
const NAMES_COME: Duration = Duration::from_millis(500);

/// Separator between a node's name and the middlewares of the mark that its child is.
const MARK: &str = "/_mark/";

/// Name and namespace of the child of `node` that is a mark.
fn child(node: &str, mark: &BridgeMark) -> (String, String) {
    (format!("_{:016x}", mark.bridge), format!("{node}{MARK}{}", mark.path.join("/")))
}

/// The node that endpoints of `node` are said to have, and their mark.
fn parent(node: &str) -> (&str, Option<BridgeMark>) {
    let mark = || {
        let (parent, mark) = node.rsplit_once(MARK)?;
        let (path, number) = mark.rsplit_once("/_")?;
        Some((parent, format!("{number}:{}", path.replace('/', ",")).parse().ok()?))
    };
    mark().map_or((node, None), |(parent, mark)| (parent, Some(mark)))
}

/// Endpoints that are known of one side of a topic.
struct Watched {
    shared: Arc<Shared>,
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
    shared: Arc<Shared>,
    seen: u64,
    owners: HashMap<Gid, String>,
}

impl NodeWatch for Nodes {
    fn update(&mut self) {
        let changes = self.shared.node.graph_changes();
        if self.seen == changes {
            return;
        }
        match self.shared.all() {
            Ok(all) => {
                self.owners = all.into_iter().map(|(node, found)| (found.gid, node)).collect();
                self.seen = changes;
            }
            Err(fault) => tracing::warn!(%fault, "cannot read whose endpoints there are"),
        }
    }

    fn owner(&self, gid: &Gid) -> Option<&str> {
        self.owners.get(gid).map(String::as_str)
    }
}

/// Prefix of a hash of version 1, by REP-2016.
const HASH_BEGINS: &str = "RIHS01_";

pub(super) fn hash_from_text(text: &str) -> Option<TypeHash> {
    let digits = text.strip_prefix(HASH_BEGINS).filter(|digits| digits.len() == 64)?;
    let mut hash = [0; 32];
    for (byte, pair) in hash.iter_mut().zip(digits.as_bytes().chunks_exact(2)) {
        *byte = u8::from_str_radix(std::str::from_utf8(pair).ok()?, 16).ok()?;
    }
    Some(hash)
}

fn hash_to_text(hash: &TypeHash) -> String {
    let mut text = HASH_BEGINS.to_owned();
    for byte in hash {
        // Writing to a string does not fail.
        _ = write!(text, "{byte:02x}");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hashes_are_texts_and_bytes() {
        let text = format!("RIHS01_{}", "0f".repeat(32));
        assert_eq!(hash_from_text(&text).as_ref().map(hash_to_text), Some(text));
        for wrong in ["", "RIHS01_", "RIHS02_00", &format!("RIHS01_{}", "zz".repeat(32))] {
            assert_eq!(hash_from_text(wrong), None);
        }
    }

    #[test]
    fn a_child_is_its_parent_with_a_mark() {
        let mark = BridgeMark { bridge: 7, path: vec!["ros".into(), "yarp".into()] };
        let (name, namespace) = child("/lab/bridge", &mark);
        let full = format!("{namespace}/{name}");
        assert_eq!(full, "/lab/bridge/_mark/ros/yarp/_0000000000000007");
        assert_eq!(parent(&full), ("/lab/bridge", Some(mark)));
        for other in ["/bridge", "/a/_mark/ros/_7", "/a/_mark/_0000000000000007", "/_mark/"] {
            assert_eq!(parent(other), (other, None));
        }
    }

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
