//! Configuration of CycloneDDS: our defaults and the discovery settings, then the user's own
//! sources.
//!
//! ```text
//!   discovery, interface ──▶ <CycloneDDS>…</CycloneDDS> , $CYCLONEDDS_URI
//!                             ours, first                 the user's, wins where both speak
//! ```
//!
//! The large datagrams are what makes megabyte frames fast on loopback; the receive buffer is
//! asked for with `max` alone, because a `min` the kernel does not grant would make creation fail.
//! Key hashes are for Fast DDS, which sees nothing end without them: `ros2 topic list` of
//! `rmw_fastrtps_cpp` would show a node's topics until its lease is over. Of topics only those with
//! keys carry them, so that they cost nothing outside discovery.
//! Heartbeats follow soon on what is not acknowledged: readers acknowledge, and ask for fragments again, when
//! they hear one, and a large message to a Fast DDS node waits for that (`pacing`). On two busy cores 12 images of
//! 0.9 MB went out in a second with CycloneDDS's own 100 ms, 21 with 20 ms, 33 with 10 ms and 44 with 4 ms.
//! Peers are asked for as long as the node lives: CycloneDDS's own 30 s would leave out for good a robot that is switched
//! on later, or is away for longer.
//! Type information (XTypes) of others is ignored, and none is offered: names and hashes decide, as in ROS 2's rmw.
//! CycloneDDS would keep the type objects that the nodes of Fast DDS 3 send each other, take those with a sequence of
//! strings for invalid, and from then on drop every writer and reader of such a type without a word.

use std::fmt::Write as _;

use wrapyfi_data::Limits;
use wrapyfi_node::NodeName;

use super::environment::{DiscoveryRange, Environment};
use super::graph::ServiceMapping;

/// Receive buffer asked of the kernel for every socket.
pub(super) const RECEIVE_BUFFER: u64 = 4 << 20;
/// Participants on one host that unicast discovery reaches, as `rmw_cyclonedds_cpp` sets it.
pub(super) const PARTICIPANTS: u32 = 32;
/// Silence after which others take this node for gone, in seconds. By CycloneDDS's own 10 s they, bridges among them,
/// would notice a cut cable after 11 s. Each node says its own: what announces 10 s is missed no sooner.
const LEASE_S: u32 = 8;
/// Time between two announcements of this node, in milliseconds: when a link is back, others find it after so long.
/// CycloneDDS's own is four fifths of the lease.
const ANNOUNCE_MS: u32 = 1500;

/// Peers of a node that looks for others without multicast, from their beginning. Those on this host announce themselves
/// to all of it when they come, so that the 33 ports that one of them might have are not asked for ever.
const HERE: &str = "<Peers AddLocalhost=\"false\"><Peer address=\"127.0.0.1\" PruneDelay=\"30s\"/>";

/// Vendors whose type information is ignored, `1.N`: all that CycloneDDS can name there.
const VENDORS: std::ops::RangeInclusive<u32> = 2..=32;

/// Factor by which a message may exceed the limit and still be received and counted rather than
/// discarded.
const SLACK: usize = 4;
/// Cyclone's own limit for a sample.
const MAX_SAMPLE: usize = i32::MAX as usize;

/// Settings of a node on CycloneDDS.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_node as node; pub mod middleware { pub use wrapyfi_ros2 as ros2; } }
/// use wrapyfi_core::middleware::ros2::CycloneConfig;
/// use wrapyfi_core::node::NodeName;
/// let config = CycloneConfig {
///     max_message_bytes: 256 << 20,
///     ..CycloneConfig::loopback(NodeName::new("camera", "/lab")?, 7)
/// };
/// assert_eq!((config.domain_id, config.interface.as_deref()), (7, Some("lo")));
/// # Ok::<(), wrapyfi_node::NameError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CycloneConfig {
    /// Name of the node.
    pub node: NodeName,
    /// DDS domain.
    pub domain_id: u32,
    /// Range in which participants are looked for.
    pub discovery_range: DiscoveryRange,
    /// Addresses asked one by one, `ROS_STATIC_PEERS`.
    pub static_peers: Vec<String>,
    /// The only network interface to use, for instance `lo`; `None` lets Cyclone choose.
    pub interface: Option<String>,
    /// Largest message that any topic of the node carries. Messages over a topic's own limit are
    /// counted there; one more than four times over this limit is discarded by its header, before
    /// memory is taken for it, with a warning from Cyclone.
    pub max_message_bytes: usize,
    /// The only form in which services are mapped to DDS; `None`: each is offered in both, and a server is called in
    /// its own.
    pub services: Option<ServiceMapping>,
    /// Sources after ours, as in `CYCLONEDDS_URI`: XML or `file://…`, separated by commas.
    pub extra_uri: Option<String>,
}

impl CycloneConfig {
    /// A node called `node`, on the domain and with the discovery that the environment says.
    #[doc(hidden)]
    pub fn from_environment(node: NodeName, environment: &Environment) -> Self {
        Self {
            node,
            domain_id: environment.domain_id,
            discovery_range: environment.discovery.range,
            static_peers: environment.discovery.static_peers.clone(),
            interface: None,
            max_message_bytes: Limits::default().message_bytes,
            services: environment.services,
            extra_uri: environment.cyclonedds_uri.clone(),
        }
    }

    /// A node that talks to this host only, over `lo`: for tests and demonstrations.
    pub fn loopback(node: NodeName, domain_id: u32) -> Self {
        Self {
            node,
            domain_id,
            discovery_range: DiscoveryRange::Localhost,
            static_peers: Vec::new(),
            interface: Some("lo".into()),
            max_message_bytes: Limits::default().message_bytes,
            services: Some(ServiceMapping::Cyclone),
            extra_uri: None,
        }
    }

    /// The list of sources handed to Cyclone.
    pub(super) fn sources(&self) -> String {
        let mut sources = self.xml(std::process::id());
        if let Some(extra) = &self.extra_uri {
            sources.push(',');
            sources.push_str(extra);
        }
        sources
    }

    fn xml(&self, pid: u32) -> String {
        // Writing to a String cannot fail.
        let mut general = String::from(
            "<MaxMessageSize>65500B</MaxMessageSize><FragmentSize>64000B</FragmentSize>",
        );
        let mut discovery = format!(
            "<LeaseDuration>{LEASE_S}s</LeaseDuration><SPDPInterval>{ANNOUNCE_MS}ms</SPDPInterval>\
             <InitialLocatorPruneDelay>inf</InitialLocatorPruneDelay>"
        );
        let (mut peers, mut begin) = (self.static_peers.as_slice(), "<Peers>");
        if let Some(name) = &self.interface {
            _ = write!(
                general,
                "<Interfaces><NetworkInterface name=\"{}\"/></Interfaces>",
                escape(name)
            );
        }
        let range = match self.discovery_range {
            // Multicast does not work on lo: what is confined to it finds others by unicast.
            DiscoveryRange::Subnet | DiscoveryRange::SystemDefault
                if self.interface.as_deref() == Some("lo") =>
            {
                DiscoveryRange::Localhost
            }
            range => range,
        };
        let indexed = format!(
            "<ParticipantIndex>auto</ParticipantIndex>\
             <MaxAutoParticipantIndex>{PARTICIPANTS}</MaxAutoParticipantIndex>"
        );
        match range {
            DiscoveryRange::Subnet => discovery.push_str(&indexed),
            DiscoveryRange::Localhost => {
                general.push_str("<AllowMulticast>false</AllowMulticast>");
                discovery.push_str(&indexed);
                begin = HERE;
            }
            DiscoveryRange::Off => {
                general.push_str("<AllowMulticast>false</AllowMulticast>");
                discovery.push_str("<ParticipantIndex>none</ParticipantIndex>");
                // A tag no other program has: participants with another tag are not seen.
                _ = write!(discovery, "<Tag>ros_discovery_off_{pid}</Tag>");
                peers = &[];
            }
            DiscoveryRange::SystemDefault => peers = &[],
        }
        if !peers.is_empty() || begin == HERE {
            discovery.push_str(begin);
            for peer in peers {
                _ = write!(discovery, "<Peer address=\"{}\"/>", escape(peer));
            }
            discovery.push_str("</Peers>");
        }
        let vendors: Vec<String> = VENDORS.map(|vendor| format!("1.{vendor}")).collect();
        let vendors = vendors.join(",");
        let max_sample = self.max_message_bytes.saturating_mul(SLACK).min(MAX_SAMPLE);
        format!(
            "<CycloneDDS><Domain Id=\"any\"><General>{general}</General>\
             <Discovery>{discovery}</Discovery>\
             <Internal><SocketReceiveBufferSize max=\"{RECEIVE_BUFFER}B\"/>\
             <MaxSampleSize>{max_sample}B</MaxSampleSize>\
             <HeartbeatInterval min=\"1ms\" minsched=\"1ms\">5ms</HeartbeatInterval>\
             <GenerateKeyhash>true</GenerateKeyhash></Internal>\
             <Compatibility><IgnoreTypeInformation>{vendors}</IgnoreTypeInformation></Compatibility>\
             </Domain></CycloneDDS>"
        )
    }
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config(range: DiscoveryRange, peers: &[&str]) -> CycloneConfig {
        CycloneConfig {
            node: NodeName::new("n", "/").unwrap(),
            domain_id: 0,
            discovery_range: range,
            static_peers: peers.iter().map(|&peer| peer.to_owned()).collect(),
            interface: None,
            max_message_bytes: 1000,
            services: Some(ServiceMapping::Cyclone),
            extra_uri: None,
        }
    }

    #[test]
    fn each_range_has_its_settings() {
        let subnet = config(DiscoveryRange::Subnet, &["10.0.0.1"]).xml(1);
        assert!(subnet.contains("<Peers><Peer address=\"10.0.0.1\"/></Peers>"), "{subnet}");
        assert!(subnet.contains("<MaxAutoParticipantIndex>32<"), "{subnet}");
        assert!(!subnet.contains("AllowMulticast"), "{subnet}");
        assert!(subnet.contains("<MaxSampleSize>4000B<"), "{subnet}");
        assert!(subnet.contains("<GenerateKeyhash>true<"), "{subnet}");
        // The first is 1.2: CycloneDDS takes 1.1, but ignores nothing of it. Fast DDS is 1.15, CycloneDDS 1.16.
        assert!(subnet.contains("<IgnoreTypeInformation>1.2,1.3,"), "{subnet}");
        assert!(subnet.contains(",1.15,1.16,"), "{subnet}");
        assert!(subnet.contains(",1.32</IgnoreTypeInformation></Compatibility>"), "{subnet}");
        assert!(subnet.contains("minsched=\"1ms\">5ms</HeartbeatInterval>"), "{subnet}");
        let local = config(DiscoveryRange::Localhost, &["10.0.0.1"]).xml(1);
        assert!(local.contains("<AllowMulticast>false<"), "{local}");
        let peers = format!("{HERE}<Peer address=\"10.0.0.1\"/></Peers>");
        assert!(local.contains(&peers) && local.contains("PruneDelay>inf<"), "{local}");
        let off = config(DiscoveryRange::Off, &["10.0.0.1"]).xml(77);
        assert!(off.contains("<Tag>ros_discovery_off_77</Tag>"), "{off}");
        assert!(!off.contains("Peer "), "{off}");
        let system = config(DiscoveryRange::SystemDefault, &["10.0.0.1"]).xml(1);
        assert!(
            system.contains("<LeaseDuration>8s</LeaseDuration><SPDPInterval>1500ms</SPDPInterval>"),
            "{system}"
        );
    }

    #[test]
    fn the_users_sources_come_last() {
        let mut config = config(DiscoveryRange::Subnet, &[]);
        config.extra_uri = Some("file:///etc/cyclone.xml".into());
        let sources = config.sources();
        assert!(sources.ends_with("</CycloneDDS>,file:///etc/cyclone.xml"), "{sources}");
    }

    #[test]
    fn foreign_text_cannot_leave_its_attribute() {
        let xml = config(DiscoveryRange::Subnet, &["a\"/><Tag>x</Tag>&"]).xml(1);
        assert!(xml.contains("address=\"a&quot;/&gt;&lt;Tag&gt;x&lt;/Tag&gt;&amp;\""), "{xml}");
    }

    #[test]
    fn on_lo_discovery_is_unicast() {
        let mut config = config(DiscoveryRange::Subnet, &[]);
        config.interface = Some("lo".into());
        let xml = config.xml(1);
        assert!(xml.contains("name=\"lo\"") && xml.contains(HERE), "{xml}");
    }
}
