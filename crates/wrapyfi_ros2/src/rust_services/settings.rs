//! Settings of a node for RustDDS, and warnings about those that RustDDS does not have.
//!
//! ```text
//!   CycloneConfig { domain, discovery, interface } ─ Settings::new ─▶ domain, networks, warnings
//!                                                          └─▶ an error where nothing would be right
//! ```

use std::net::{IpAddr, Ipv4Addr};

use crate::config::CycloneConfig;
use crate::environment::{DiscoveryRange, MAX_DOMAIN_ID};
use wrapyfi_node::NodeName;

/// Settings with which no services can be had.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum RustServicesError {
    /// RustDDS has no domain tags and always listens on the ports of its domain.
    #[error(
        "services of the Fast DDS mapping cannot be hidden as ROS_AUTOMATIC_DISCOVERY_RANGE=OFF asks: set it to LOCALHOST, or set RMW_IMPLEMENTATION=rmw_cyclonedds_cpp"
    )]
    Off,
    /// Ports for this domain do not exist.
    #[error("domain {0} is out of range for services: domains are 0 to {MAX_DOMAIN_ID}")]
    DomainOutOfRange(u32),
    /// The interface to be used is not there.
    #[error(
        "services are to use the interface {name:?}, but no interface of that name has an IPv4 address (there are: {known})"
    )]
    NoInterface {
        /// Name asked for.
        name: String,
        /// Interfaces that have one.
        known: String,
    },
}

/// Settings that a participant is created with.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Settings {
    /// Node that the services belong to.
    pub(super) node: NodeName,
    /// Number of the participant among those of the node.
    pub(super) place: u8,
    /// DDS domain.
    pub(super) domain_id: u16,
    /// Addresses of the interfaces to announce itself on; `None` for all.
    pub(super) networks: Option<Vec<IpAddr>>,
    /// Largest samples that are sent in one piece.
    pub(super) whole: WholeSamples,
    /// True where the node has its services in CycloneDDS's mapping too.
    pub(super) is_beside: bool,
    /// Settings that have no effect on services, to be logged.
    pub(super) warnings: Vec<String>,
}

/// Largest samples, encapsulation header included, that RustDDS sends in one piece. It computes the
/// same from the addresses that a reader announces: the least of what the interfaces towards them
/// carry, and of what Ethernet carries where it knows none.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct WholeSamples {
    /// Largest sample to any reader, in bytes.
    pub(super) anywhere: usize,
    /// Largest sample to readers that announce only addresses of the loopback interface, in bytes.
    pub(super) loopback: usize,
}

/// Bytes that RustDDS subtracts from the MTU of an interface: headers of IP, UDP and RTPS, a
/// heartbeat, and the header of the sample.
const AROUND_SAMPLE: usize = 48 + 32 + 48;
/// Bytes of a sample that fit a UDP datagram (65507 bytes) beside all headers, the identity among
/// them, which RustDDS does not count.
const DATAGRAM: usize = 65_507 - (20 + 12 + 16 + 24 + 60 + 32);
/// MTU of Ethernet: RustDDS assumes it of networks it is not on.
const ETHERNET: usize = 1500;

impl WholeSamples {
    fn new(interfaces: &[Interface]) -> Self {
        let least = |loopback: bool| {
            let mtus = interfaces.iter().filter(|known| known.loopback == loopback || !loopback);
            mtus.filter_map(|known| known.mtu).min().unwrap_or(ETHERNET)
        };
        let carries = |mtu: usize| mtu.saturating_sub(AROUND_SAMPLE).min(DATAGRAM);
        Self { anywhere: carries(least(false).min(ETHERNET)), loopback: carries(least(true)) }
    }

    /// Bytes of the largest datagram to a reader, `near` if only the loopback interface leads to it.
    pub(super) fn datagram(self, near: bool) -> usize {
        /// Bytes that belong to a datagram beside its sample, without the headers of IP and UDP.
        const AROUND: usize = AROUND_SAMPLE - (20 + 8);
        if near { self.loopback + AROUND } else { self.anywhere + AROUND }
    }
}

/// A network interface of this host.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Interface {
    name: String,
    addresses: Vec<Ipv4Addr>,
    mtu: Option<usize>,
    loopback: bool,
}

impl Settings {
    /// The same domain, interfaces and range as the node's topics have.
    pub(super) fn new(config: &CycloneConfig) -> Result<Self, RustServicesError> {
        Self::with_interfaces(config, &interfaces())
    }

    fn with_interfaces(
        config: &CycloneConfig,
        interfaces: &[Interface],
    ) -> Result<Self, RustServicesError> {
        let domain_id = u16::try_from(config.domain_id)
            .ok()
            .filter(|_| config.domain_id <= MAX_DOMAIN_ID)
            .ok_or(RustServicesError::DomainOutOfRange(config.domain_id))?;
        let here = Some(vec![IpAddr::V4(Ipv4Addr::LOCALHOST)]);
        let networks = match (config.discovery_range, config.interface.as_deref()) {
            (DiscoveryRange::Off, _) => return Err(RustServicesError::Off),
            (DiscoveryRange::Localhost, _) | (_, Some("lo")) => here,
            (DiscoveryRange::Subnet | DiscoveryRange::SystemDefault, None) => None,
            (DiscoveryRange::Subnet | DiscoveryRange::SystemDefault, Some(name)) => {
                Some(addresses_of(name, interfaces)?)
            }
        };
        Ok(Self {
            node: config.node.clone(),
            place: 0,
            domain_id,
            networks,
            whole: WholeSamples::new(interfaces),
            is_beside: config.services.is_none(),
            warnings: warnings(config),
        })
    }
}

fn addresses_of(name: &str, interfaces: &[Interface]) -> Result<Vec<IpAddr>, RustServicesError> {
    let found: Vec<IpAddr> = interfaces
        .iter()
        .filter(|known| known.name == name)
        .flat_map(|known| known.addresses.iter().copied().map(IpAddr::V4))
        .collect();
    if found.is_empty() {
        let with_address = interfaces.iter().filter(|known| !known.addresses.is_empty());
        let known: Vec<&str> = with_address.map(|known| known.name.as_str()).collect();
        return Err(RustServicesError::NoInterface { name: name.into(), known: known.join(", ") });
    }
    Ok(found)
}

fn warnings(config: &CycloneConfig) -> Vec<String> {
    let mut warnings = Vec::new();
    let elsewhere: Vec<&str> = config
        .static_peers
        .iter()
        .map(String::as_str)
        // Participants of this host are asked one by one in any case.
        .filter(|peer| !matches!(*peer, "localhost" | "127.0.0.1"))
        .collect();
    if !elsewhere.is_empty() {
        warnings.push(format!(
            "ROS_STATIC_PEERS does not reach services of the Fast DDS mapping: those on {} are \
             found only if they announce themselves to this host",
            elsewhere.join(", ")
        ));
    }
    if config.extra_uri.is_some() {
        warnings.push(
            "CYCLONEDDS_URI does not reach services of the Fast DDS mapping: they are on RustDDS"
                .into(),
        );
    }
    warnings
}

/// Addresses of all interfaces that RustDDS knows.
pub(super) fn addresses() -> Vec<Ipv4Addr> {
    interfaces().into_iter().flat_map(|interface| interface.addresses).collect()
}

fn interfaces() -> Vec<Interface> {
    netdev::get_interfaces()
        .into_iter()
        .map(|interface| Interface {
            addresses: interface.ipv4_addrs(),
            mtu: interface.mtu.and_then(|mtu| usize::try_from(mtu).ok()),
            loopback: interface.is_loopback(),
            name: interface.name,
        })
        // RustDDS knows those with an IPv4 address only.
        .filter(|interface| !interface.addresses.is_empty())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn card(name: &str, addresses: &[Ipv4Addr], mtu: usize) -> Interface {
        let addresses = addresses.to_vec();
        Interface { name: name.into(), addresses, mtu: Some(mtu), loopback: name == "lo" }
    }

    #[test]
    fn samples_stay_whole_within_the_smallest_network() {
        let lo = card("lo", &[Ipv4Addr::LOCALHOST], 65_536);
        let whole = |others: &[usize]| {
            let others = others.iter().map(|&mtu| card("x", &[Ipv4Addr::LOCALHOST], mtu));
            WholeSamples::new(&others.chain([lo.clone()]).collect::<Vec<_>>())
        };
        assert_eq!(whole(&[]), WholeSamples { anywhere: 1372, loopback: 65_343 });
        assert_eq!(whole(&[9000]).anywhere, 1372);
        assert_eq!(whole(&[9000, 1420, 1500]), WholeSamples { anywhere: 1292, loopback: 65_343 });
        assert_eq!(whole(&[100]).anywhere, 0);
        assert_eq!(WholeSamples::new(&[]), WholeSamples { anywhere: 1372, loopback: 1372 });
    }

    fn settings(
        range: DiscoveryRange,
        interface: Option<&str>,
        peers: &[&str],
    ) -> Result<Settings, RustServicesError> {
        let mut config = CycloneConfig::loopback(NodeName::new("n", "/").unwrap(), 7);
        let static_peers = peers.iter().map(|&peer| peer.to_owned()).collect();
        (config.discovery_range, config.static_peers) = (range, static_peers);
        config.interface = interface.map(str::to_owned);
        let interfaces = [
            card("lo", &[Ipv4Addr::LOCALHOST], 65_536),
            card("eth0", &[Ipv4Addr::new(10, 0, 0, 2), Ipv4Addr::new(10, 1, 0, 2)], 9000),
            card("wlan0", &[], 1500),
        ];
        Settings::with_interfaces(&config, &interfaces)
    }

    #[test]
    fn ranges_and_interfaces_become_addresses() {
        let networks = |range, interface| settings(range, interface, &[]).unwrap().networks;
        let here = Some(vec![IpAddr::V4(Ipv4Addr::LOCALHOST)]);
        assert_eq!(networks(DiscoveryRange::Subnet, None), None);
        assert_eq!(networks(DiscoveryRange::SystemDefault, None), None);
        assert_eq!(networks(DiscoveryRange::Localhost, None), here);
        assert_eq!(networks(DiscoveryRange::Localhost, Some("eth0")), here);
        assert_eq!(networks(DiscoveryRange::Subnet, Some("lo")), here);
        let eth0 = networks(DiscoveryRange::Subnet, Some("eth0")).unwrap();
        assert_eq!(eth0, [IpAddr::from([10, 0, 0, 2]), IpAddr::from([10, 1, 0, 2])]);
    }

    #[test]
    fn what_cannot_be_honoured_is_refused_or_said() {
        let off = settings(DiscoveryRange::Off, None, &[]);
        assert_eq!(off, Err(RustServicesError::Off));
        for missing in ["eth1", "wlan0"] {
            let error = settings(DiscoveryRange::Subnet, Some(missing), &[]).unwrap_err();
            assert!(error.to_string().contains("(there are: lo, eth0)"), "{error}");
        }
        let quiet = settings(DiscoveryRange::Subnet, None, &["localhost", "127.0.0.1"]).unwrap();
        assert!(quiet.warnings.is_empty(), "{:?}", quiet.warnings);
        let peers = settings(DiscoveryRange::Subnet, None, &["10.0.0.1", "127.0.0.1"]).unwrap();
        assert!(peers.warnings[0].contains("those on 10.0.0.1 are"), "{:?}", peers.warnings);
        let mut config = CycloneConfig::loopback(NodeName::new("n", "/").unwrap(), 233);
        assert_eq!(Settings::new(&config), Err(RustServicesError::DomainOutOfRange(233)));
        config.domain_id = 232;
        config.extra_uri = Some("file:///x.xml".into());
        let settings = Settings::new(&config).unwrap();
        assert_eq!((settings.domain_id, settings.warnings.len()), (232, 1));
    }
}
