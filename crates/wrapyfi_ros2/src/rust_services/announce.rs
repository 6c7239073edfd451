//! Announcement of the services' participant in `ros_discovery_info`.
//!
//! ```text
//!   node /robot/bridge ─▶ { this participant, node /robot/_bridge_services, readers, writers }
//!                         { the second one,   node /robot/_bridge_services1, readers, writers }
//! ```
//!
//! The name begins with an underscore: `ros2 node list` hides it, and the node itself is announced
//! by the participant of its topics. The last message names no node.

use std::time::Duration;

use bytes::Bytes;
use rustdds::policy::{Durability, History, Reliability};
use rustdds::{GUID, Publisher, QosPolicies, QosPolicyBuilder, Topic};
use wrapyfi_interfaces::Message;
use wrapyfi_interfaces::rmw_dds_common::msg::{self, NodeEntitiesInfo, ParticipantEntitiesInfo};

use super::adapter;
use super::outgoing::Writer;
use super::settings::Settings;
use crate::discovery_info::{Gid, TOPIC};

/// Characters of a node's name that ROS allows.
const MAX_NAME: usize = 255;
/// Time that the last announcement has to reach its readers.
const FAREWELL: Duration = Duration::from_millis(50);

/// Readers and writers of the services of a node that exist now, by GUID.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ServiceEndpoints {
    /// Readers: of requests for servers, of replies for clients.
    pub readers: Vec<[u8; 16]>,
    /// Writers: of replies for servers, of requests for clients.
    pub writers: Vec<[u8; 16]>,
}

/// The announcement and its writer.
pub(super) struct Announcement {
    writer: Writer,
    pub(super) participant: Gid,
    namespace: String,
    name: String,
    pub(super) endpoints: ServiceEndpoints,
}

impl Announcement {
    /// Type of the messages, as DDS names it.
    pub(super) const DDS_TYPE: &'static str = ParticipantEntitiesInfo::DDS_TYPE;

    /// Quality of service of the writer.
    pub(super) fn qos() -> QosPolicies {
        QosPolicyBuilder::new()
            .reliability(Reliability::Reliable {
                max_blocking_time: rustdds::Duration::from_millis(100),
            })
            .durability(Durability::TransientLocal)
            .history(History::KeepLast { depth: 1 })
            .build()
    }

    /// Creates the writer; nothing is announced yet.
    pub(super) fn new(
        publisher: &Publisher,
        topic: &Topic,
        participant: GUID,
        Settings { node, place, .. }: &Settings,
    ) -> rustdds::dds::CreateResult<Self> {
        let writer = publisher.create_datawriter_no_key(topic, Some(Self::qos()))?;
        Ok(Self {
            writer,
            participant: participant.to_bytes(),
            namespace: node.namespace().to_owned(),
            name: hidden_name(node.name(), *place),
            endpoints: ServiceEndpoints::default(),
        })
    }

    /// Adds a reader and a writer, and announces.
    pub(super) fn add(&mut self, reader: Gid, writer: Gid) {
        self.endpoints.readers.push(reader);
        self.endpoints.writers.push(writer);
        self.publish();
    }

    /// Removes a reader and a writer, and announces.
    pub(super) fn remove(&mut self, reader: &Gid, writer: &Gid) {
        self.endpoints.readers.retain(|known| known != reader);
        self.endpoints.writers.retain(|known| known != writer);
        self.publish();
    }

    /// Announces that the node is gone and gives readers a moment to hear it.
    pub(super) fn retire(&mut self) {
        self.write(Vec::new());
        match self.writer.wait_for_acknowledgments(FAREWELL) {
            Ok(true) => {}
            Ok(false) => tracing::debug!("{TOPIC}: the end was not acknowledged by all"),
            Err(error) => tracing::debug!(%error, "{TOPIC}: waiting for acknowledgements"),
        }
    }

    fn publish(&self) {
        let gids = |gids: &[Gid]| gids.iter().map(|gid| msg::Gid { data: *gid }).collect();
        self.write(vec![NodeEntitiesInfo {
            node_namespace: self.namespace.clone(),
            node_name: self.name.clone(),
            reader_gid_seq: gids(&self.endpoints.readers),
            writer_gid_seq: gids(&self.endpoints.writers),
        }]);
    }

    fn write(&self, nodes: Vec<NodeEntitiesInfo>) {
        let gid = msg::Gid { data: self.participant };
        let cdr = ParticipantEntitiesInfo { gid, node_entities_info_seq: nodes }.encode();
        let parts: Vec<&[u8]> = cdr.pieces().iter().map(AsRef::as_ref).collect();
        // The next announcement repeats everything, so that a lost one is no reason to fail.
        let body: Bytes = match adapter::body(&parts) {
            Ok(body) => body,
            Err(error) => return tracing::warn!(%error, "{TOPIC} was not sent"),
        };
        if let Err(error) = self.writer.write(body, None) {
            tracing::warn!(%error, "{TOPIC} was not sent");
        }
    }
}

fn hidden_name(node: &str, place: u8) -> String {
    const AROUND: usize = "__services".len();
    let node: String = node.chars().take(MAX_NAME - AROUND - 1).collect();
    let place = if place == 0 { String::new() } else { place.to_string() };
    format!("_{node}_services{place}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_name_is_hidden_and_no_longer_than_allowed() {
        assert_eq!(hidden_name("bridge", 0), "_bridge_services");
        let long = hidden_name(&"n".repeat(MAX_NAME), 1);
        assert_eq!(long.len(), MAX_NAME);
        assert!(long.starts_with("_n") && long.ends_with("n_services1"));
    }
}
