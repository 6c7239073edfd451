//! `ros_discovery_info`: which node owns which endpoints, as `ros2 node list` and `info` show it.
//!
//! ```text
//!   endpoint created / destroyed ─▶ DiscoveryInfo { participant, nodes: readers, writers }
//!                                        │ whole message, every time
//!                                        ▼
//!                       ros_discovery_info (reliable, transient local, keep-last 1)
//! ```
//!
//! A node of another middleware has its own entry while endpoints stand for it. The last message of a process names no
//! node.

use std::collections::BTreeMap;
use std::sync::{Arc, MutexGuard};
use std::time::Duration;

use wrapyfi_interfaces::Message;
use wrapyfi_interfaces::rmw_dds_common::msg::{self, NodeEntitiesInfo, ParticipantEntitiesInfo};

use super::cyclone::{EndpointQos, Entity, Events, RawWriter, ReturnCode, WriteFault};
use super::graph::Replay;
use wrapyfi_endpoint::{Durability, History, Qos, Reliability};
use wrapyfi_node::NodeName;

/// DDS topic; it has no ROS prefix.
pub(super) const TOPIC: &str = "ros_discovery_info";

/// A DDS GUID as ROS writes it.
pub(super) type Gid = [u8; 16];

/// List of the node that an endpoint is in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum EndpointKind {
    Reader,
    Writer,
}

/// A node that announces its endpoints, and is kept alive by them.
pub(super) trait Announcing: Send + Sync {
    fn info(&self) -> MutexGuard<'_, DiscoveryInfo>;
}

/// The node's entry, and the writer that announces it.
pub(super) struct DiscoveryInfo {
    writer: RawWriter,
    participant: Gid,
    node: NodeEntitiesInfo,
    /// Nodes of other middlewares, by their full names.
    others: BTreeMap<String, NodeEntitiesInfo>,
    /// Endpoints of the node on two other participants: readers, writers.
    elsewhere: [(Vec<Gid>, Vec<Gid>); 2],
}

impl DiscoveryInfo {
    /// Creates the writer; nothing is announced yet.
    pub(super) fn new(participant: &Entity, node: &NodeName) -> Result<Self, ReturnCode> {
        let user_data = format!("typehash={};", ParticipantEntitiesInfo::TYPE_HASH);
        let qos = EndpointQos {
            qos: Qos {
                reliability: Reliability::Reliable,
                durability: Durability::TransientLocal,
                history: History::KeepLast(1),
                ..Qos::default()
            },
            max_blocking: Duration::from_millis(100),
            user_data: &user_data,
            ignore_local: true,
            replay: Replay::History,
            partition: None,
        };
        let events = Events::new(TOPIC, Reliability::Reliable, Arc::new(|| {}));
        let names = (TOPIC, ParticipantEntitiesInfo::DDS_TYPE);
        let writer = RawWriter::new(participant, names, &qos, events)?;
        let participant = participant.guid()?;
        let (node, others) = (entry(node), BTreeMap::new());
        Ok(Self { writer, participant, node, others, elsewhere: Default::default() })
    }

    /// Adds an endpoint to the node, or to another one, and announces.
    pub(super) fn add(&mut self, other: Option<&NodeName>, kind: EndpointKind, gid: Gid) {
        let node = match other {
            None => &mut self.node,
            Some(other) => self.others.entry(other.fqn()).or_insert_with(|| entry(other)),
        };
        list(node, kind).push(msg::Gid { data: gid });
        self.publish();
    }

    /// Removes an endpoint and announces.
    pub(super) fn remove(&mut self, other: Option<&NodeName>, kind: EndpointKind, gid: &Gid) {
        let node = match other {
            None => Some(&mut self.node),
            Some(other) => self.others.get_mut(&other.fqn()),
        };
        if let Some(node) = node {
            list(node, kind).retain(|known| known.data != *gid);
        }
        self.others.retain(|_, it| !it.reader_gid_seq.is_empty() || !it.writer_gid_seq.is_empty());
        self.publish();
    }

    #[cfg_attr(not(feature = "fastdds-services"), allow(dead_code))]
    /// Replaces what the node has on one of two other participants, and announces.
    pub(super) fn set_elsewhere(&mut self, place: usize, readers: &[Gid], writers: &[Gid]) {
        let ends = (readers.to_vec(), writers.to_vec());
        if let Some(known) = self.elsewhere.get_mut(place).filter(|known| **known != ends) {
            *known = ends;
            self.publish();
        }
    }

    /// Announces the node as it is.
    pub(super) fn publish(&self) {
        let mut node = self.node.clone();
        let gids = |gids: &[Gid]| gids.iter().map(|&data| msg::Gid { data }).collect::<Vec<_>>();
        for (readers, writers) in &self.elsewhere {
            node.reader_gid_seq.extend(gids(readers));
            node.writer_gid_seq.extend(gids(writers));
        }
        self.write([node].into_iter().chain(self.others.values().cloned()).collect());
    }

    /// Announces that the node is gone and gives readers a moment to hear it.
    pub(super) fn retire(&self) {
        self.write(Vec::new());
        if let Err(error) = self.writer.wait_for_acks(50_000_000) {
            tracing::debug!(%error, "{TOPIC}: the end was not acknowledged by all");
        }
    }

    fn write(&self, nodes: Vec<NodeEntitiesInfo>) {
        let gid = msg::Gid { data: self.participant };
        let cdr = ParticipantEntitiesInfo { gid, node_entities_info_seq: nodes }.encode();
        let parts: Vec<&[u8]> = cdr.pieces().iter().map(AsRef::as_ref).collect();
        // The next announcement repeats everything, so that a lost one is no reason to fail.
        match self.writer.write(&parts) {
            Ok(()) => {}
            Err(WriteFault::Code(error)) => tracing::warn!(%error, "{TOPIC} was not sent"),
            Err(WriteFault::Message(error)) => tracing::warn!(error, "{TOPIC} was not sent"),
        }
    }
}

/// A node without endpoints.
fn entry(node: &NodeName) -> NodeEntitiesInfo {
    NodeEntitiesInfo {
        node_namespace: node.namespace().to_owned(),
        node_name: node.name().to_owned(),
        ..NodeEntitiesInfo::default()
    }
}

fn list(node: &mut NodeEntitiesInfo, kind: EndpointKind) -> &mut Vec<msg::Gid> {
    match kind {
        EndpointKind::Reader => &mut node.reader_gid_seq,
        EndpointKind::Writer => &mut node.writer_gid_seq,
    }
}
