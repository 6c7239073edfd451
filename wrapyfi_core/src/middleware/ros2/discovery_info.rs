//! `ros_discovery_info`: which node owns which endpoints, as `ros2 node list` and `info` show it.
//!
//! ```text
//!   endpoint created / destroyed ─▶ DiscoveryInfo { participant, node, readers, writers }
//!                                        │ whole message, every time
//!                                        ▼
//!                       ros_discovery_info (reliable, transient local, keep-last 1)
//! ```
//!
//! The last message of a process names no node.

use std::sync::Arc;
use std::time::Duration;

use super::cyclone::{EndpointQos, Entity, Events, RawWriter, ReturnCode, WriteFault};
use super::graph::NodeIdentity;
use crate::endpoint::{Durability, History, Qos, Reliability};

/// DDS topic; it has no ROS prefix.
const TOPIC: &str = "ros_discovery_info";
/// DDS type.
const TYPE: &str = "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_";
/// Hash of `rmw_dds_common/msg/ParticipantEntitiesInfo`.
const TYPE_HASH: &str = "RIHS01_91a0593bacdcc50ea9bdcf849a938b128412cc1ea821245c663bcd26f83c295e";

/// A DDS GUID as ROS writes it.
pub(super) type Gid = [u8; 16];

/// Which list of the node an endpoint is in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum EndpointKind {
    Reader,
    Writer,
}

/// The node's entry, and the writer that announces it.
pub(super) struct DiscoveryInfo {
    writer: RawWriter,
    participant: Gid,
    node: NodeIdentity,
    readers: Vec<Gid>,
    writers: Vec<Gid>,
}

impl DiscoveryInfo {
    /// Creates the writer; nothing is announced yet.
    pub(super) fn new(participant: &Entity, node: NodeIdentity) -> Result<Self, ReturnCode> {
        let user_data = format!("typehash={TYPE_HASH};");
        let qos = EndpointQos {
            qos: Qos {
                reliability: Reliability::Reliable,
                durability: Durability::TransientLocal,
                history: History::KeepLast(1),
            },
            max_samples: None,
            max_blocking: Duration::from_millis(100),
            user_data: &user_data,
        };
        let events = Events::new(TOPIC, Reliability::Reliable, Arc::new(|| {}));
        let writer = RawWriter::new(participant, (TOPIC, TYPE), &qos, events)?;
        let participant = participant.guid()?;
        Ok(Self { writer, participant, node, readers: Vec::new(), writers: Vec::new() })
    }

    /// Adds an endpoint and announces.
    pub(super) fn add(&mut self, kind: EndpointKind, gid: Gid) {
        self.list(kind).push(gid);
        self.publish();
    }

    /// Removes an endpoint and announces.
    pub(super) fn remove(&mut self, kind: EndpointKind, gid: &Gid) {
        self.list(kind).retain(|known| known != gid);
        self.publish();
    }

    /// Announces the node as it is.
    pub(super) fn publish(&self) {
        self.write(&encode(&self.participant, Some((&self.node, &self.readers, &self.writers))));
    }

    /// Announces that the node is gone and gives readers a moment to hear it.
    pub(super) fn retire(&self) {
        self.write(&encode(&self.participant, None));
        if let Err(error) = self.writer.wait_for_acks(50_000_000) {
            tracing::debug!(%error, "{TOPIC}: the end was not acknowledged by all");
        }
    }

    fn list(&mut self, kind: EndpointKind) -> &mut Vec<Gid> {
        match kind {
            EndpointKind::Reader => &mut self.readers,
            EndpointKind::Writer => &mut self.writers,
        }
    }

    fn write(&self, message: &[u8]) {
        // The next announcement repeats everything, so that a lost one is no reason to fail.
        match self.writer.write(&[message]) {
            Ok(()) => {}
            Err(WriteFault::Code(error)) => tracing::warn!(%error, "{TOPIC} was not sent"),
            Err(WriteFault::Message(error)) => tracing::warn!(error, "{TOPIC} was not sent"),
        }
    }
}

/// `rmw_dds_common/msg/ParticipantEntitiesInfo`.
fn encode(participant: &Gid, node: Option<(&NodeIdentity, &[Gid], &[Gid])>) -> Vec<u8> {
    let mut out = vec![0, 1, 0, 0];
    out.extend_from_slice(participant);
    put_length(&mut out, usize::from(node.is_some()));
    if let Some((node, readers, writers)) = node {
        for text in [&node.namespace, &node.name] {
            put_length(&mut out, text.len() + 1);
            out.extend_from_slice(text.as_bytes());
            out.push(0);
        }
        for gids in [readers, writers] {
            put_length(&mut out, gids.len());
            out.extend_from_slice(gids.as_flattened());
        }
    }
    out
}

/// A length, aligned to its size; the header counts as four bytes and does not disturb it.
fn put_length(out: &mut Vec<u8>, length: usize) {
    out.resize(out.len().next_multiple_of(4), 0);
    // Names are bounded by their rules and endpoints by memory: the length always fits.
    out.extend_from_slice(&u32::try_from(length).unwrap_or(u32::MAX).to_le_bytes());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bytes_are_those_of_a_jazzy_listener() {
        let mut participant =
            [0x01, 0x10, 0x6e, 0x5b, 0x4c, 0xbe, 0x47, 0xbf, 0xc9, 0xa8, 0xc3, 0xe6, 0, 0, 1, 0xc1];
        let node = NodeIdentity { name: "listener".into(), namespace: "/".into() };
        let mut rosout = participant;
        rosout[12..].copy_from_slice(&[0, 0, 6, 3]);
        let bytes = encode(&participant, Some((&node, &[], &[rosout])));
        let expected = [
            &[0, 1, 0, 0][..],
            &participant,
            &[1, 0, 0, 0, 2, 0, 0, 0, b'/', 0, 0, 0, 9, 0, 0, 0],
            b"listener\0\0\0\0",
            &[0, 0, 0, 0, 1, 0, 0, 0],
            &rosout,
        ]
        .concat();
        assert_eq!(bytes, expected);
        participant[15] = 0xc1;
        assert_eq!(encode(&participant, None).len(), 4 + 16 + 4);
    }
}
