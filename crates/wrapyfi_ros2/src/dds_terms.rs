//! Topics and endpoints in ROS's terms and in DDS's.
//!
//! ```text
//!   TopicDescription /chatter ── to_dds, user_data ──▶ rt/chatter, typehash=RIHS01_…;
//!   EndpointFound rt/chatter ── discovered ──▶ DiscoveredEndpoint /chatter, type, hash
//! ```

use super::discovery_info::Gid;
use super::graph::{DiscoveredEndpoint, GraphError, TopicDescription};
use super::{cyclone, names};
use wrapyfi_endpoint::BridgeMark;
use wrapyfi_node::NodeName;

/// A topic with the names that DDS has for it and its type.
pub(super) fn to_dds(topic: &TopicDescription) -> Result<TopicDescription, GraphError> {
    let fault = |reason: String| GraphError::stack("naming", &topic.name, &reason);
    NodeName::check_topic(&topic.name).map_err(|error| fault(error.to_string()))?;
    let type_name =
        names::type_to_dds(&topic.type_name).map_err(|error| fault(error.to_string()))?;
    Ok(TopicDescription { name: names::topic_to_dds(&topic.name), type_name, ..topic.clone() })
}

/// An endpoint in ROS's terms; `own` is the participant's GUID.
pub(super) fn discovered(endpoint: cyclone::EndpointFound, own: &Gid) -> DiscoveredEndpoint {
    DiscoveredEndpoint {
        is_publisher: endpoint.is_writer,
        type_hash: type_hash(&endpoint.user_data),
        mark: mark(&endpoint.user_data),
        gid: endpoint.guid,
        qos: endpoint.qos,
        service_mapping: endpoint.service_mapping,
        is_own: endpoint.guid.first_chunk::<12>() == own.first_chunk::<12>(),
        type_name: names::type_from_dds(&endpoint.type_name)
            .unwrap_or_else(|| endpoint.type_name.clone()),
        dds_type: endpoint.type_name,
        topic: names::topic_from_dds(&endpoint.topic).unwrap_or(&endpoint.topic).to_owned(),
        dds_topic: endpoint.topic,
    }
}

/// Key of a bridge's mark in USER_DATA. Letters and digits alone: the rmw of ROS 2 passes over all of the
/// USER_DATA, the type hash with it, where another character is in a key.
const MARK: &str = "wrapyfibridge=";

/// USER_DATA of a participant: where its security settings would lie.
pub(super) const ENCLAVE: &str = "enclave=/;";

/// USER_DATA of an end of a service, as `rmw_cyclonedds_cpp` has it: `serviceid` or `clientid`, which
/// both endpoints of the end share, the hash of the request or response, and from Lyrical on that of the service, which
/// `ros2 service info -v` shows.
pub(super) fn end_user_data(
    key: &str,
    id: &str,
    type_hash: Option<&str>,
    service_hash: Option<&str>,
) -> String {
    let service = service_hash.map(|hash| format!("ser{}", hash_data(Some(hash))));
    format!("{key}= {id};{}{}", hash_data(type_hash), service.unwrap_or_default())
}

/// USER_DATA of an endpoint: its type hash.
pub(super) fn user_data(topic: &TopicDescription) -> String {
    hash_data(topic.type_hash.as_deref())
}

/// A type hash as a pair of USER_DATA.
pub(super) fn hash_data(type_hash: Option<&str>) -> String {
    type_hash.map(|hash| format!("typehash={hash};")).unwrap_or_default()
}

/// Adds the mark of a bridge to USER_DATA, as a pair of its own that others pass over.
pub(super) fn marked(user_data: String, mark: Option<&BridgeMark>) -> String {
    match mark {
        Some(mark) => format!("{user_data}{MARK}{mark};"),
        None => user_data,
    }
}

/// The mark of a bridge in USER_DATA, where there is one.
pub(super) fn mark(user_data: &[u8]) -> Option<BridgeMark> {
    let text = std::str::from_utf8(user_data).ok()?;
    text.trim_end_matches('\0').split(';').find_map(|pair| pair.strip_prefix(MARK))?.parse().ok()
}

/// The type hash in USER_DATA, where there is one.
pub(super) fn type_hash(user_data: &[u8]) -> Option<String> {
    let text = std::str::from_utf8(user_data).ok()?;
    text.trim_end_matches('\0')
        .split(';')
        .find_map(|pair| pair.strip_prefix("typehash="))
        .map(ToOwned::to_owned)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lyrical adds the hash of the service, and the makers of memory that a node reads, in either spelling of
    /// `rmw_fastrtps_cpp`.
    #[test]
    fn pairs_of_later_distributions_are_passed_over() {
        let (own, service) = (Some("RIHS01_ab"), Some("RIHS01_cd"));
        let end = end_user_data("serviceid", "1.10.8", own, service);
        assert_eq!(end, "serviceid= 1.10.8;typehash=RIHS01_ab;sertypehash=RIHS01_cd;");
        for text in [
            end.as_str(),
            "sertypehash=RIHS01_cd;typehash=RIHS01_ab;",
            "typehash=RIHS01_ab;BUFBE:cpu=;cuda=device:0;",
            "typehash=RIHS01_ab;bufbe=cpu:,cuda:device=0;",
            "typehash=RIHS01_ab;sertypehash=RIHS01_cd;bufbe=cpu:;something new",
        ] {
            assert_eq!(type_hash(text.as_bytes()).as_deref(), own, "{text}");
            assert_eq!(mark(text.as_bytes()), None, "{text}");
        }
        assert_eq!(type_hash(b"sertypehash=RIHS01_cd;BUFBE:typehash=RIHS01_ab"), None);
    }

    #[test]
    fn a_mark_stands_beside_the_type_hash() {
        let wanted = BridgeMark { bridge: 7, path: vec!["ros".into()] };
        let text = marked("typehash=RIHS01_ab;".to_owned(), Some(&wanted));
        assert_eq!(type_hash(text.as_bytes()).as_deref(), Some("RIHS01_ab"));
        assert_eq!(mark(text.as_bytes()), Some(wanted));
        assert_eq!(mark(b"typehash=RIHS01_ab;wrapyfibridge=nonsense;"), None);
        for pair in text.split_terminator(';') {
            let (key, _) = pair.split_once('=').unwrap();
            assert!(
                key.bytes().all(|byte| byte.is_ascii_alphanumeric()),
                "rmw does not read {key}"
            );
        }
    }
}
