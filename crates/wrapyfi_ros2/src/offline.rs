//! Readers of what other nodes announce, without DDS, for fuzzing: no part of the interface.

use bytes::Bytes;
use wrapyfi_endpoint::BridgeMark;
use wrapyfi_interfaces::Message as _;

use super::announcement::{self, Announcement};
use super::vendor::EndKey;
use super::{dds_terms, owners};

/// Content of USER_DATA of an endpoint.
#[derive(Debug, PartialEq, Eq)]
pub struct Announced {
    /// Type hash.
    pub type_hash: Option<String>,
    /// Mark of the bridge that made the endpoint.
    pub mark: Option<BridgeMark>,
    /// Id that both endpoints of an end of a service have.
    pub id: Option<Vec<u8>>,
}

/// Reads USER_DATA.
pub fn user_data(bytes: &[u8]) -> Announced {
    let id = match EndKey::new(&[0; 16], bytes) {
        EndKey::Id(id) => Some(id),
        EndKey::Participant(_) => None,
    };
    Announced { type_hash: dds_terms::type_hash(bytes), mark: dds_terms::mark(bytes), id }
}

/// USER_DATA of an endpoint of ours with this type hash and mark.
pub fn write_user_data(type_hash: Option<&str>, mark: Option<&BridgeMark>) -> String {
    dds_terms::marked(dds_terms::hash_data(type_hash), mark)
}

/// Names of the nodes in an announcement of at most `max_bytes`, and the announcement as nodes of today write it;
/// `None` where it is refused.
pub fn announcement(cdr: &Bytes, max_bytes: usize) -> Option<(Vec<String>, Bytes)> {
    let Announcement { info, .. } = announcement::read(cdr, max_bytes).ok()?;
    let names = info.node_entities_info_seq.iter().map(owners::full_name).collect();
    Some((names, info.encode().to_bytes()))
}
