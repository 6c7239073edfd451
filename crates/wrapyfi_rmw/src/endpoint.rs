//! Endpoints that others have, as the graph knows them.

use super::TypeHash;
use wrapyfi_endpoint::AnnouncedQos;

/// Identity of an endpoint, the same on every host.
pub type Gid = [u8; 16];

/// A side of a topic.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[allow(missing_docs, reason = "ROS 2's own terms")]
pub enum EndpointType {
    Publishers,
    Subscriptions,
}

/// An endpoint on the graph.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Endpoint {
    /// Full name of its node, for instance `/robot/talker`.
    pub node: String,
    /// Type as the middleware spells it, for instance `std_msgs::msg::dds_::String_`.
    pub type_name: String,
    /// Hash that it announces, of version 1.
    pub type_hash: Option<TypeHash>,
    /// Identity.
    pub gid: Gid,
    /// Quality of service that it announces.
    pub qos: AnnouncedQos,
}

/// The first 16 bytes of an identity: longer ones of older distributions end with zeros.
pub(crate) fn gid(bytes: &[u8]) -> Gid {
    let mut gid = [0; 16];
    for (to, from) in gid.iter_mut().zip(bytes) {
        *to = *from;
    }
    gid
}
