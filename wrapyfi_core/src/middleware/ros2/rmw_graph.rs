//! [`Graph`] on the rmw of an installed ROS 2: the middleware that `RMW_IMPLEMENTATION` names, as every node has it.
//!
//! ```text
//!   RmwGraph ── wrapyfi_rmw::Node ── librmw_implementation ── rmw_fastrtps_cpp, rmw_zenoh_cpp, …
//!      │           topics, services: rmw_endpoints
//!      └── discovery: what rmw knows of the graph, asked again when it has changed
//! ```
//!
//! rmw shows no USER_DATA: marks of bridges are not seen there, and none is left.

use std::collections::HashMap;
use std::fmt::Write as _;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError};

use wrapyfi_rmw::{Durability, Fault, Gid, Liveliness, Node, NodeOptions, Side, TypeHash};

use super::config::CycloneConfig;
use super::environment::DiscoveryRange;
use super::graph::{
    CdrClient, CdrReader, CdrServer, CdrWriter, DiscoveredEndpoint, Graph, GraphError, NodeWatch,
    Notify, PeerWatch, ServiceDescription, ServiceMapping, TopicDescription,
};
use super::names;
use super::rmw_endpoints::{RmwClient, RmwReader, RmwServer, RmwWriter};
use crate::endpoint::{
    AnnouncedDurability, AnnouncedQos, History, Liveliness as RosLiveliness, Qos, Reliability,
};
use crate::node::NodeName;

/// A node on the rmw that is loaded.
#[derive(Clone)]
pub struct RmwGraph(Arc<Shared>);

/// What the endpoints of a node share.
pub(super) struct Shared {
    name: NodeName,
    pub(super) node: Node,
    mapping: ServiceMapping,
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
        let mut known = self.0.lock().unwrap_or_else(PoisonError::into_inner);
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
        self.0.lock().unwrap_or_else(PoisonError::into_inner).1.get(&number).copied()
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
            range: match config.discovery.range {
                DiscoveryRange::Subnet => wrapyfi_rmw::DiscoveryRange::Subnet,
                DiscoveryRange::Localhost => wrapyfi_rmw::DiscoveryRange::Localhost,
                DiscoveryRange::Off => wrapyfi_rmw::DiscoveryRange::Off,
                DiscoveryRange::SystemDefault => wrapyfi_rmw::DiscoveryRange::SystemDefault,
            },
            static_peers: config.discovery.static_peers.clone(),
        };
        let node = Node::new(&options)?;
        let mapping = match implementation.as_str() {
            "rmw_cyclonedds_cpp" => ServiceMapping::Cyclone,
            _ => ServiceMapping::FastDds,
        };
        let publishers = Publishers::default();
        Ok(Self(Arc::new(Shared { name: config.node.clone(), node, mapping, publishers })))
    }
}

impl Graph for RmwGraph {
    fn node(&self) -> &NodeName {
        &self.0.name
    }

    fn advertise(
        &self,
        topic: &TopicDescription,
        on_match: Notify,
    ) -> Result<Box<dyn CdrWriter>, GraphError> {
        let hash = topic.type_hash.as_deref().and_then(hash_from_text);
        let qos = to_rmw(&topic.qos);
        let made =
            self.0.node.publisher(&topic.name, &topic.type_name, hash.as_ref(), &qos, on_match);
        let publisher = made.map_err(|fault| stack("creating a writer", &topic.name, &fault))?;
        Ok(Box::new(RmwWriter::new(publisher, &topic.name)))
    }

    fn subscribe(
        &self,
        topic: &TopicDescription,
        on_data: Notify,
    ) -> Result<Box<dyn CdrReader>, GraphError> {
        let hash = topic.type_hash.as_deref().and_then(hash_from_text);
        let qos = to_rmw(&topic.qos);
        let made =
            self.0.node.subscription(&topic.name, &topic.type_name, hash.as_ref(), &qos, &on_data);
        let subscription = made.map_err(|fault| stack("creating a reader", &topic.name, &fault))?;
        Ok(Box::new(RmwReader::new(subscription, topic, Arc::clone(&self.0))))
    }

    fn service_mapping(&self) -> ServiceMapping {
        self.0.mapping
    }

    fn shows_marks(&self) -> bool {
        false
    }

    fn client(
        &self,
        service: &ServiceDescription,
        on_event: Notify,
    ) -> Result<Box<dyn CdrClient>, GraphError> {
        Ok(Box::new(RmwClient::new(&self.0.node, service, &on_event)?))
    }

    fn server(
        &self,
        service: &ServiceDescription,
        on_event: Notify,
    ) -> Result<Box<dyn CdrServer>, GraphError> {
        Ok(Box::new(RmwServer::new(&self.0.node, service, &on_event)?))
    }

    fn endpoints(&self) -> Result<Vec<DiscoveredEndpoint>, GraphError> {
        let found = self.0.all();
        let found = found.map_err(|fault| stack("listing endpoints", &self.0.name.fqn(), &fault));
        Ok(found?.into_iter().map(|(_, found)| found).collect())
    }

    fn watch(
        &self,
        topic: &str,
        publishers: bool,
        on_change: Notify,
    ) -> Result<Box<dyn PeerWatch>, GraphError> {
        let side = if publishers { Side::Publishers } else { Side::Subscriptions };
        let watched = Arc::new(Watched {
            shared: Arc::clone(&self.0),
            topic: names::topic_to_dds(topic),
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
        // What was there before.
        watched.look();
        Ok(Box::new(Watch { watched, _kept: kept }))
    }

    fn nodes(&self) -> Result<Box<dyn NodeWatch>, GraphError> {
        Ok(Box::new(Nodes {
            shared: Arc::clone(&self.0),
            seen: u64::MAX,
            owners: HashMap::default(),
        }))
    }
}

impl Shared {
    /// All endpoints, each with its node's name.
    fn all(&self) -> Result<Vec<(String, DiscoveredEndpoint)>, Fault> {
        let mut all = Vec::new();
        for (topic, _) in self.node.topics()? {
            for side in [Side::Publishers, Side::Subscriptions] {
                all.extend(self.on(&topic, side)?);
            }
        }
        Ok(all)
    }

    /// The endpoints on one side of a DDS topic, each with its node's name.
    pub(super) fn on(
        &self,
        topic: &str,
        side: Side,
    ) -> Result<impl Iterator<Item = (String, DiscoveredEndpoint)> + use<'_>, Fault> {
        let found = self.node.endpoints(topic, side)?;
        let topic = topic.to_owned();
        Ok(found.into_iter().map(move |endpoint| {
            let found = DiscoveredEndpoint {
                is_publisher: side == Side::Publishers,
                topic: names::topic_from_dds(&topic).unwrap_or(&topic).to_owned(),
                dds_topic: topic.clone(),
                type_name: names::type_from_dds(&endpoint.type_name)
                    .unwrap_or_else(|| endpoint.type_name.clone()),
                dds_type: endpoint.type_name,
                type_hash: endpoint.type_hash.as_ref().map(hash_to_text),
                gid: endpoint.gid,
                qos: from_rmw(&endpoint.qos),
                is_own: endpoint.node == self.name.fqn() || self.node.owns(&endpoint.gid),
                mark: None,
            };
            (endpoint.node, found)
        }))
    }
}

/// What is known of one side of a topic.
struct Watched {
    shared: Arc<Shared>,
    topic: String,
    side: Side,
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
        let mut peers = self.peers.lock().unwrap_or_else(PoisonError::into_inner);
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
        self.watched.peers.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    fn changes(&self) -> u64 {
        self.watched.changes.load(Relaxed)
    }
}

/// Who owns which endpoint, as of the change of the graph that was seen last.
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

/// What a call of rmw refused.
pub(super) fn stack(operation: &'static str, topic: &str, fault: &Fault) -> GraphError {
    let reason = format!("{fault}");
    GraphError::Stack { operation, topic: topic.to_owned(), reason }
}

pub(super) fn to_rmw(qos: &Qos) -> wrapyfi_rmw::Qos {
    wrapyfi_rmw::Qos {
        reliable: qos.reliability == Reliability::Reliable,
        durability: match qos.durability {
            crate::endpoint::Durability::Volatile => Durability::Volatile,
            crate::endpoint::Durability::TransientLocal => Durability::TransientLocal,
        },
        depth: match qos.history {
            History::KeepLast(depth) => Some(depth),
            History::KeepAll => None,
        },
        deadline: qos.deadline,
        lifespan: qos.lifespan,
        liveliness: match qos.liveliness {
            RosLiveliness::Automatic => Liveliness::Automatic,
            // ROS 2 has no liveliness of whole participants: the publisher's own is what satisfies it.
            RosLiveliness::ManualByParticipant | RosLiveliness::ManualByTopic => {
                Liveliness::ManualByTopic
            }
        },
        lease: qos.lease,
    }
}

fn from_rmw(qos: &wrapyfi_rmw::Qos) -> AnnouncedQos {
    AnnouncedQos {
        reliability: if qos.reliable { Reliability::Reliable } else { Reliability::BestEffort },
        durability: match qos.durability {
            Durability::Volatile => AnnouncedDurability::Volatile,
            Durability::TransientLocal => AnnouncedDurability::TransientLocal,
        },
        history: qos.depth.map(History::KeepLast),
        deadline: qos.deadline,
        lifespan: qos.lifespan,
        liveliness: match qos.liveliness {
            Liveliness::Automatic => RosLiveliness::Automatic,
            Liveliness::ManualByTopic => RosLiveliness::ManualByTopic,
        },
        lease: qos.lease,
    }
}

/// How REP-2016 begins a hash of version 1.
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
    fn a_publisher_has_one_number() {
        let publishers = Publishers::default();
        let number = publishers.number(&[1; 16]);
        assert_ne!(number, 0);
        assert_eq!(number, publishers.number(&[1; 16]));
        assert_eq!(publishers.gid(number), Some([1; 16]));
        assert_ne!(number, publishers.number(&[2; 16]));
    }
}
