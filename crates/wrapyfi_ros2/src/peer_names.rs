//! Hosts on which CycloneDDS is told to look for others, by name.
//!
//! ```text
//!   ROS_STATIC_PEERS ─────────────┐             address ─▶ as it is
//!   <Peer> in CYCLONEDDS_URI ─────┴─ host ─▶ ─┤ name ────▶ address of a Relay, 127.0.0.1:PORT
//!                                             └ neither ─▶ refused
//! ```
//!
//! CycloneDDS ends the process where a peer does not resolve, and takes no peers later. It knows a name as a port of this
//! program (`peer_relay`), so that nothing waits for the name.

use std::net::{Ipv4Addr, ToSocketAddrs as _};

use super::config::CycloneConfig;
use super::environment::DiscoveryRange;
use super::peer_relay::Relay;

pub(super) const STATIC_PEERS: &str = "ROS_STATIC_PEERS";
const URI: &str = "CYCLONEDDS_URI";

/// A peer that CycloneDDS cannot be told.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PeerError {
    /// Four numbers, one of them too large, or less.
    #[error("{from} has {peer:?}, which is no IPv4 address: numbers of one are 0 to 255")]
    NoAddress {
        /// Variable that has it.
        from: &'static str,
        /// Peer as it is written.
        peer: String,
    },
    /// An address of IPv6.
    #[error(
        "{from} has {peer:?}, an address of IPv6: CycloneDDS inside this program is on IPv4, unless CYCLONEDDS_URI has a Transport of IPv6; give the IPv4 address of that host, or its name"
    )]
    Ipv6 {
        /// Variable that has it.
        from: &'static str,
        /// Peer as it is written.
        peer: String,
    },
    /// A name that does not resolve, on a transport that a relay does not speak.
    #[error(
        "{from} has the host {host:?}: {reason}; CycloneDDS on another transport than UDP over IPv4 cannot start before that name resolves"
    )]
    Unresolved {
        /// Variable that has it.
        from: &'static str,
        /// Name of the host.
        host: String,
        /// Words of the system.
        reason: String,
    },
    /// The system gives a relay no port or no thread.
    #[error("{from} has the host {host:?}, which takes a port and a thread: {reason}")]
    NoRelay {
        /// Variable that has it.
        from: &'static str,
        /// Name of the host.
        host: String,
        /// Words of the system.
        reason: String,
    },
}

impl PeerError {
    /// True where another setting alone is the remedy.
    pub fn is_of_settings(&self) -> bool {
        matches!(self, Self::NoAddress { .. } | Self::Ipv6 { .. })
    }
}

/// `config` as CycloneDDS can start with it, in which names are addresses of relays, and these.
///
/// # Errors
/// Peers that are neither a name nor an address; no room for a relay.
pub(super) fn relayed(config: &CycloneConfig) -> Result<(CycloneConfig, Vec<Relay>), PeerError> {
    let mut config = config.clone();
    let uri = config.extra_uri.take().unwrap_or_default();
    let domain = config.domain_id;
    let text: String = sources_of(&uri).into_iter().map(text_of).collect();
    let is_ipv4 = !text.contains("udp6") && !text.contains("tcp6");
    let is_udp4 = is_ipv4 && !text.contains(">tcp<");
    let mut relays = Vec::new();
    let mut address =
        |from, peer: &str| -> Result<String, PeerError> {
            let Some(Host { before, name, port }) = host(from, peer, is_ipv4)? else {
                return Ok(peer.to_owned());
            };
            let host = name.to_owned();
            if !is_udp4 {
                let resolved = (name, 0).to_socket_addrs().map(drop);
                let unresolved = |error: std::io::Error| PeerError::Unresolved {
                    from,
                    host,
                    reason: error.to_string(),
                };
                return resolved.map(|()| peer.to_owned()).map_err(unresolved);
            }
            let relay = Relay::start(from, name, port, domain)
                .map_err(|error| PeerError::NoRelay { from, host, reason: error.to_string() })?;
            let at = relay.at();
            relays.push(relay);
            Ok(format!("{before}{at}"))
        };
    if matches!(config.discovery_range, DiscoveryRange::Subnet | DiscoveryRange::Localhost) {
        for peer in &mut config.static_peers {
            *peer = address(STATIC_PEERS, peer)?;
        }
    }
    config.extra_uri = match uri.is_empty() {
        true => None,
        false => Some(with_addresses(&uri, &mut |peer| address(URI, peer))?),
    };
    Ok((config, relays))
}

/// A peer by name: `udp/robot:7410`.
#[derive(Debug, PartialEq, Eq)]
struct Host<'p> {
    /// Transport with its slash.
    before: &'p str,
    name: &'p str,
    port: Option<u16>,
}

/// The name in a peer (`host`, `host:port`, `udp/host`); `None` for an address, and for what only CycloneDDS knows.
fn host<'p>(
    from: &'static str,
    peer: &'p str,
    is_ipv4: bool,
) -> Result<Option<Host<'p>>, PeerError> {
    let (before, host) = peer.split_at(peer.rfind('/').map_or(0, |slash| slash + 1));
    if host.matches(':').count() > 1 {
        return match is_ipv4 {
            true => Err(PeerError::Ipv6 { from, peer: peer.to_owned() }),
            false => Ok(None),
        };
    }
    let (name, port) = host.split_once(':').map_or((host, None), |(name, port)| (name, Some(port)));
    let is_known = name == "localhost" || name.parse::<Ipv4Addr>().is_ok();
    if name.is_empty() || name.contains(['$', '@']) || is_known {
        return Ok(None);
    }
    if name.bytes().all(|byte| byte.is_ascii_digit() || byte == b'.') {
        return Err(PeerError::NoAddress { from, peer: peer.to_owned() });
    }
    // Of a port that is none CycloneDDS says so.
    let Ok(port) = port.map(str::parse).transpose() else { return Ok(None) };
    Ok(Some(Host { before, name, port }))
}

/// Sources with `address` of each peer in place of the peer. A file is left where no peer of it changes.
fn with_addresses<E>(
    uri: &str,
    address: &mut impl FnMut(&str) -> Result<String, E>,
) -> Result<String, E> {
    let mut sources = Vec::new();
    for source in sources_of(uri) {
        let text = text_of(source);
        let changed = in_xml(&text, address)?;
        sources.push(if changed == text { source.to_owned() } else { changed });
    }
    Ok(sources.join(","))
}

/// Sources in a list: each file, and XML with the commas that it has.
fn sources_of(uri: &str) -> Vec<&str> {
    let mut sources: Vec<&str> = Vec::new();
    let mut rest = uri.trim_start_matches([',', ' ']);
    while !rest.is_empty() {
        let is_xml = rest.starts_with('<');
        let is_end =
            |at: &usize| !is_xml || rest.get(..*at).is_some_and(|it| it.trim_end().ends_with('>'));
        let end = rest.match_indices(',').map(|(at, _)| at).find(is_end);
        let (source, after) = rest.split_at(end.unwrap_or(rest.len()));
        sources.push(source.trim_end());
        rest = after.trim_start_matches([',', ' ']);
    }
    sources
}

/// Text of a source; that of a file which cannot be read is empty, and CycloneDDS says why.
fn text_of(source: &str) -> String {
    if source.starts_with('<') {
        return source.to_owned();
    }
    let path = source.strip_prefix("file://").unwrap_or(source);
    std::fs::read_to_string(path).unwrap_or_default().trim().to_owned()
}

/// XML with `address` of each peer in place of the peer.
fn in_xml<E>(xml: &str, address: &mut impl FnMut(&str) -> Result<String, E>) -> Result<String, E> {
    let mut changed = String::with_capacity(xml.len());
    for (at, element) in xml.split('<').enumerate() {
        if at > 0 {
            changed.push('<');
        }
        let Some((before, peers, after)) = peers_in(element) else {
            changed.push_str(element);
            continue;
        };
        let addresses: Result<Vec<_>, _> =
            peers.split(',').map(|peer| address(peer.trim())).collect();
        let addresses = addresses?.join(",");
        changed.push_str(before);
        changed.push_str(if addresses == peers { peers } else { &addresses });
        changed.push_str(after);
    }
    Ok(changed)
}

/// Addresses of an element `Peer`, with the text before and after them.
fn peers_in(element: &str) -> Option<(&str, &str, &str)> {
    let (tag, attributes) = element.split_once(char::is_whitespace)?;
    if !tag.eq_ignore_ascii_case("peer") {
        return None;
    }
    let name = tag.len() + 1 + attributes.to_ascii_lowercase().find("address")?;
    let equals = name + element.get(name..)?.find('=')?;
    let begin = equals + element.get(equals..)?.find(['"', '\''])?;
    let quote = element.get(begin..)?.chars().next()?;
    let (before, value) = element.split_at_checked(begin + 1)?;
    let (peers, after) = value.split_at_checked(value.find(quote)?)?;
    (!peers.is_empty()).then_some((before, peers, after))
}

#[cfg(test)]
mod tests {
    use super::*;
    use wrapyfi_node::NodeName;

    #[test]
    fn a_peer_is_an_address_a_name_or_refused() {
        let host = |peer| host(STATIC_PEERS, peer, true);
        for address in [
            "10.0.0.1",
            "10.0.0.1:7412",
            "udp/10.0.0.1",
            "239.255.0.1",
            "${ROBOT}",
            "localhost",
            "",
        ] {
            assert_eq!(host(address), Ok(None), "{address}");
        }
        for (peer, before, port) in [
            ("robot.local", "", None),
            ("robot.local:7410", "", Some(7410)),
            ("udp/robot.local:7410", "udp/", Some(7410)),
        ] {
            assert_eq!(host(peer), Ok(Some(Host { before, name: "robot.local", port })), "{peer}");
        }
        let refused = host("999.1.1.1").unwrap_err().to_string();
        assert!(
            refused.starts_with("ROS_STATIC_PEERS has \"999.1.1.1\", which is no IPv4"),
            "{refused}"
        );
        let refused = host("::1").unwrap_err().to_string();
        assert!(
            refused.starts_with("ROS_STATIC_PEERS has \"::1\", an address of IPv6"),
            "{refused}"
        );
        assert_eq!(super::host(URI, "[fe80::1]:7410", false), Ok(None));
    }

    const XML: &str = "<CycloneDDS><Domain><Discovery><Peers><Peer address=\"robot.local\"/>\
                       <peer PruneDelay='1s' Address = 'base:7410,10.0.0.1'></peer><Peer Address=\"\"/></Peers>\
                       </Discovery></Domain></CycloneDDS>";

    #[test]
    fn names_in_sources_become_addresses() {
        let mut seen = Vec::new();
        let mut address = |peer: &str| {
            seen.push(peer.to_owned());
            Ok::<_, ()>(if peer.contains("10.") {
                peer.to_owned()
            } else {
                "127.0.0.1:9".to_owned()
            })
        };
        let changed = XML.replace("robot.local", "127.0.0.1:9").replace("base:7410", "127.0.0.1:9");
        assert_eq!(with_addresses(XML, &mut address).as_deref(), Ok(changed.as_str()));
        let file = std::env::temp_dir().join(format!("wrapyfi_peers_{}.xml", std::process::id()));
        std::fs::write(&file, format!("{XML}\n")).unwrap();
        let uri = format!("<CycloneDDS/>,file://{}", file.display());
        let wanted = format!("<CycloneDDS/>,{changed}");
        assert_eq!(with_addresses(&uri, &mut address), Ok(wanted));
        std::fs::write(&file, "<Peer address='10.0.0.1'/>").unwrap();
        assert_eq!(with_addresses(&uri, &mut address).as_deref(), Ok(uri.as_str()));
        std::fs::remove_file(&file).unwrap();
        let odd = "file:///nowhere,<a,b/>";
        assert_eq!(with_addresses(odd, &mut address).as_deref(), Ok(odd));
        assert_eq!(
            seen.join(" "),
            "robot.local base:7410 10.0.0.1 robot.local base:7410 10.0.0.1 10.0.0.1"
        );
    }

    #[test]
    fn cyclonedds_is_told_the_address_of_a_relay() {
        let mut config = CycloneConfig::loopback(NodeName::new("n", "/").unwrap(), 7);
        config.static_peers = vec!["10.0.0.1".to_owned(), "no-such-host.invalid".to_owned()];
        let (relayed_config, relays) = relayed(&config).unwrap();
        let [address, name] = relayed_config.static_peers.as_slice() else { panic!("two peers") };
        assert_eq!((address.as_str(), name), ("10.0.0.1", &relays[0].at().to_string()));
        config.discovery_range = DiscoveryRange::Off;
        assert!(relayed(&config).unwrap().1.is_empty(), "peers are not looked for");
        config.discovery_range = DiscoveryRange::Subnet;
        config.extra_uri = Some("<General><Transport>udp6</Transport></General>".to_owned());
        assert!(matches!(relayed(&config), Err(PeerError::Unresolved { .. })));
    }
}
