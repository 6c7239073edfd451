//! Owners of endpoints, from the announcements of all participants.
//!
//! ```text
//!   ros_discovery_info { participant, nodes { name, reader gids, writer gids } } ─▶ gid -> node
//! ```
//!
//! A participant's last message counts: it names all its nodes. Messages come from strangers, so
//! what is kept of them is bounded. Nodes of a distribution before Iron are told once: their
//! endpoints announce no type hash, so nothing says whether their definitions are those known here.

use std::collections::{BTreeMap, HashMap};

use wrapyfi_interfaces::Message;
use wrapyfi_interfaces::rmw_dds_common::msg::{NodeEntitiesInfo, ParticipantEntitiesInfo};

use super::announcement::{self, Announcement};
use super::discovery_info::{Gid, TOPIC};
use super::graph::{CdrReader, GraphError, NodeWatch, TopicDescription};
use wrapyfi_endpoint::{Durability, History, Qos, Reliability};

/// Largest announcement that is read: some ten thousand endpoints.
const MAX_BYTES: usize = 1 << 20;
/// Participants that are kept.
const MAX_PARTICIPANTS: usize = 4096;

/// Nodes that own endpoints, as the participants announced them.
pub(super) struct Owners {
    reader: Box<dyn CdrReader>,
    participants: BTreeMap<Gid, HashMap<Gid, String>>,
    warned_of_older: bool,
}

impl Owners {
    /// Owners as `reader` hears them on [`Owners::topic`].
    pub(super) fn new(reader: Box<dyn CdrReader>) -> Self {
        Self { reader, participants: BTreeMap::new(), warned_of_older: false }
    }

    /// The topic of the announcements, with the names of DDS.
    pub(super) fn topic() -> TopicDescription {
        TopicDescription {
            name: TOPIC.to_owned(),
            type_name: ParticipantEntitiesInfo::DDS_TYPE.to_owned(),
            type_hash: Some(ParticipantEntitiesInfo::TYPE_HASH.to_owned()),
            qos: Qos {
                reliability: Reliability::Reliable,
                durability: Durability::TransientLocal,
                history: History::KeepAll,
                ..Qos::default()
            },
            max_bytes: MAX_BYTES,
            hears_own: false,
        }
    }

    fn read(&mut self, Announcement { info, before_iron }: Announcement) {
        if before_iron {
            self.tell_of_older(&info);
        }
        let participant = info.gid.data;
        if info.node_entities_info_seq.is_empty() {
            self.participants.remove(&participant);
            return;
        }
        if self.participants.len() >= MAX_PARTICIPANTS
            && !self.participants.contains_key(&participant)
        {
            tracing::warn!("nodes of more than {MAX_PARTICIPANTS} participants are not kept");
            return;
        }
        let mut owned = HashMap::new();
        for node in info.node_entities_info_seq {
            let name = full_name(&node);
            for gid in node.reader_gid_seq.iter().chain(&node.writer_gid_seq) {
                owned.insert(gid.data, name.clone());
            }
        }
        self.participants.insert(participant, owned);
    }

    fn tell_of_older(&mut self, info: &ParticipantEntitiesInfo) {
        let Some(node) = info.node_entities_info_seq.first() else { return };
        if !std::mem::replace(&mut self.warned_of_older, true) {
            tracing::warn!(
                "node {} is of a ROS 2 distribution before Iron: its endpoints announce no type \
                 hash, and a type whose definition has changed since is misread or refused; compare \
                 `ros2 interface show` on both sides for each type that is exchanged with it. This is \
                 said once, whatever the number of such nodes",
                full_name(node)
            );
        }
    }
}

pub(super) fn full_name(node: &NodeEntitiesInfo) -> String {
    format!("{}/{}", node.node_namespace.trim_end_matches('/'), node.node_name)
}

impl NodeWatch for Owners {
    fn update(&mut self) -> bool {
        let mut is_news = false;
        loop {
            match self.reader.take() {
                Ok(Some(sample)) => match announcement::read(&sample.cdr, MAX_BYTES) {
                    Ok(announcement) => {
                        self.read(announcement);
                        is_news = true;
                    }
                    Err(error) => {
                        tracing::warn!(%error, "{TOPIC}: an announcement is not readable");
                    }
                },
                Ok(None) => return is_news,
                Err(error) => {
                    tracing::warn!(%error, "{TOPIC}");
                    // A message that is too large is gone; any other fault would come again at
                    // once.
                    if !matches!(error, GraphError::TooLarge { .. }) {
                        return is_news;
                    }
                }
            }
        }
    }

    fn owner(&self, gid: &Gid) -> Option<&str> {
        self.participants.values().find_map(|owned| owned.get(gid)).map(String::as_str)
    }
}
