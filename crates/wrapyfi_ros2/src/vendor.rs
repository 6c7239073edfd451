//! Pairing of the ends of services, and detection of another vendor's mapping.
//!
//! ```text
//!   peers of the request endpoint ─┐  same serviceid, clientid or participant
//!   peers of the reply endpoint ───┴─▶ pair ─▶ Peers { None, Half, Ready(n), Foreign }
//! ```

use std::collections::HashSet;
use std::time::Duration;

use super::graph::{Peers, ServiceMapping};

/// Longest time that a writer of our services on RustDDS waits. Their endpoints announce it, and by it others know
/// that they speak the mapping of Fast DDS: RustDDS announces no USER_DATA, and programs on it may speak either. It is
/// a time that no other program would choose.
pub(super) const RUST_SERVICES_BLOCKING: Duration = Duration::from_millis(503);

/// The mapping that the owner of an endpoint speaks, where its GUID tells: the first two bytes name
/// the vendor (RTPS 9.3.1.5). Those on RustDDS that announce [`RUST_SERVICES_BLOCKING`] are bridges; others of
/// RustDDS may speak either.
pub(super) fn mapping_of(
    guid: &[u8; 16],
    max_blocking: Option<Duration>,
) -> Option<ServiceMapping> {
    let is_ours = |time: Duration| {
        // RTPS counts fractions of seconds.
        let distance = time.abs_diff(RUST_SERVICES_BLOCKING);
        distance < Duration::from_micros(1)
    };
    match guid {
        [0x01, 0x12, ..] if max_blocking.is_some_and(is_ours) => Some(ServiceMapping::FastDds),
        [0x01, 0x0f, ..] => Some(ServiceMapping::FastDds),
        [0x01, 0x10, ..] => Some(ServiceMapping::Cyclone),
        _ => None,
    }
}

/// True for an endpoint, or a participant, of Fast DDS.
pub(super) fn is_fast_dds(guid: &[u8]) -> bool {
    guid.starts_with(&[0x01, 0x0f])
}

/// True for an endpoint of RustDDS.
pub(super) fn is_rustdds(guid: &[u8; 16]) -> bool {
    guid.starts_with(&[0x01, 0x12])
}

/// Key that both endpoints of one server or client have in common.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(super) enum EndKey {
    /// The id that `rmw_cyclonedds_cpp` puts into USER_DATA of both.
    Id(Vec<u8>),
    /// The participant, where there is no id.
    Participant([u8; 12]),
}

impl EndKey {
    /// The key of an endpoint with this GUID and USER_DATA.
    pub(super) fn new(guid: &[u8; 16], user_data: &[u8]) -> Self {
        /// Sixteen bytes in hexadecimal and fifteen dots; a blank is before them.
        const LONGEST: usize = 64;
        let id = user_data.split(|&byte| byte == b';').find_map(|pair| {
            pair.strip_prefix(b"serviceid=").or_else(|| pair.strip_prefix(b"clientid="))
        });
        match (id, guid) {
            (Some(id), _) if id.len() <= LONGEST => Self::Id(id.trim_ascii().to_vec()),
            (_, &[a, b, c, d, e, f, g, h, i, j, k, l, ..]) => {
                Self::Participant([a, b, c, d, e, f, g, h, i, j, k, l])
            }
        }
    }
}

/// The other ends of a service, from the peers of its two endpoints.
pub(super) fn pair(
    requests: impl Iterator<Item = (Option<ServiceMapping>, EndKey)>,
    replies: impl Iterator<Item = (Option<ServiceMapping>, EndKey)>,
    ours: ServiceMapping,
) -> Peers {
    let mut foreign = None;
    let mut keep = |(mapping, key)| match mapping {
        Some(theirs) if theirs != ours => {
            foreign = Some(theirs);
            None
        }
        _ => Some(key),
    };
    let requests: HashSet<EndKey> = requests.filter_map(&mut keep).collect();
    let replies: HashSet<EndKey> = replies.filter_map(&mut keep).collect();
    let both = requests.intersection(&replies).count();
    if both > 0 {
        Peers::Ready(both)
    } else if !requests.is_empty() || !replies.is_empty() {
        Peers::Half
    } else {
        foreign.map_or(Peers::None, Peers::Foreign)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn guid(vendor: u8, participant: u8, entity: u8) -> [u8; 16] {
        let mut guid = [0; 16];
        (guid[0], guid[1], guid[11], guid[15]) = (1, vendor, participant, entity);
        guid
    }

    fn found(requests: &[([u8; 16], &str)], replies: &[([u8; 16], &str)]) -> Peers {
        fn keyed<'a>(
            peers: &'a [([u8; 16], &'a str)],
        ) -> impl Iterator<Item = (Option<ServiceMapping>, EndKey)> {
            let of = |guid| mapping_of(guid, Some(Duration::from_millis(100)));
            peers.iter().map(move |(guid, data)| (of(guid), EndKey::new(guid, data.as_bytes())))
        }
        pair(keyed(requests), keyed(replies), ServiceMapping::Cyclone)
    }

    #[test]
    fn both_halves_must_be_of_one_end() {
        let (a, b) = (guid(0x10, 1, 4), guid(0x10, 1, 3));
        assert_eq!(found(&[], &[]), Peers::None);
        assert_eq!(found(&[(a, "")], &[]), Peers::Half);
        assert_eq!(found(&[(a, "")], &[(guid(0x10, 2, 3), "")]), Peers::Half);
        assert_eq!(found(&[(a, "")], &[(b, "")]), Peers::Ready(1));
        let (one, two) = ("serviceid= 1.10.8;typehash=x;", "serviceid= 1.10.9;typehash=x;");
        assert_eq!(found(&[(a, one)], &[(b, two)]), Peers::Half);
        assert_eq!(found(&[(a, one), (a, two)], &[(b, two)]), Peers::Ready(1));
        assert_eq!(found(&[(a, one), (a, two)], &[(b, one), (b, two)]), Peers::Ready(2));
    }

    #[test]
    fn another_vendor_is_no_peer_but_is_named() {
        let fast = [(guid(0x0f, 1, 4), "")];
        let foreign = Peers::Foreign(ServiceMapping::FastDds);
        assert_eq!(found(&fast, &fast), foreign);
        assert_eq!(found(&fast, &[]), foreign);
        let rust = guid(0x12, 3, 3);
        assert_eq!(found(&[fast[0], (rust, "")], &[(rust, "")]), Peers::Ready(1));
        let ours = mapping_of(&rust, Some(RUST_SERVICES_BLOCKING - Duration::from_nanos(1)));
        assert_eq!(ours, Some(ServiceMapping::FastDds));
    }
}
