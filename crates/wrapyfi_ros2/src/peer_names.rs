//! Hosts on which CycloneDDS is told to look for others, by name.
//!
//! ```text
//!   ROS_STATIC_PEERS ─────────────┐             address ─▶ as it is
//!   <Peer> in CYCLONEDDS_URI ─────┴─ host ─▶ ─┤ name ────▶ waited for until it resolves
//!                                             └ neither ─▶ refused
//! ```
//!
//! CycloneDDS ends the process where a peer does not resolve, and takes no peers later.

use std::net::{Ipv4Addr, ToSocketAddrs as _};
use std::time::{Duration, Instant};

use super::config::CycloneConfig;

/// Time between two tries.
const TRY_EVERY: Duration = Duration::from_secs(1);
/// Time after which it is said again that a name is waited for.
const TELL_EVERY: Duration = Duration::from_secs(30);
const STATIC_PEERS: &str = "ROS_STATIC_PEERS";
const URI: &str = "CYCLONEDDS_URI";

/// A peer that no wait makes one.
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
}

/// Waits until all peers of `config` that are names resolve, and says meanwhile which do not, and why.
///
/// # Errors
/// Peers that are neither a name nor an address.
pub(super) fn wait(config: &CycloneConfig) -> Result<(), PeerError> {
    let uri = config.extra_uri.as_deref().unwrap_or_default();
    let is_ipv4 = !uri.contains("udp6") && !uri.contains("tcp6");
    let given = config.static_peers.iter().map(|peer| (STATIC_PEERS, peer.clone()));
    for (from, peer) in given.chain(peers_of(uri).into_iter().map(|peer| (URI, peer))) {
        let Some(host) = host(from, &peer, is_ipv4)? else { continue };
        let mut told: Option<Instant> = None;
        while let Err(reason) = resolve(host) {
            if told.is_none_or(|at| at.elapsed() >= TELL_EVERY) {
                tracing::warn!("ROS 2 waits for the host {host:?} of {from}: {reason}");
                told = Some(Instant::now());
            }
            std::thread::sleep(TRY_EVERY);
        }
    }
    Ok(())
}

/// The name in a peer (`host`, `host:port`, `udp/host`); `None` for an address, and for what only CycloneDDS knows.
fn host<'p>(
    from: &'static str,
    peer: &'p str,
    is_ipv4: bool,
) -> Result<Option<&'p str>, PeerError> {
    let host = peer.rsplit_once('/').map_or(peer, |(_, host)| host);
    if host.matches(':').count() > 1 {
        return match is_ipv4 {
            true => Err(PeerError::Ipv6 { from, peer: peer.to_owned() }),
            false => Ok(None),
        };
    }
    let host = host.split_once(':').map_or(host, |(host, _)| host);
    if host.is_empty() || host.contains(['$', '@']) || host.parse::<Ipv4Addr>().is_ok() {
        return Ok(None);
    }
    match host.bytes().all(|byte| byte.is_ascii_digit() || byte == b'.') {
        true => Err(PeerError::NoAddress { from, peer: peer.to_owned() }),
        false => Ok(Some(host)),
    }
}

fn resolve(host: &str) -> Result<(), String> {
    let mut found = (host, 0).to_socket_addrs().map_err(|error| error.to_string())?;
    let has_ipv4 = found.any(|address| address.is_ipv4());
    has_ipv4.then_some(()).ok_or_else(|| "it has no IPv4 address".to_owned())
}

/// Addresses of the elements `Peer` in the sources, files included, as far as they are written out.
fn peers_of(uri: &str) -> Vec<String> {
    let mut peers = peers_in(uri);
    for source in uri.split(',').map(str::trim) {
        let path = source.strip_prefix("file://").unwrap_or(source);
        if !path.is_empty() && !path.starts_with('<') {
            // CycloneDDS says what it cannot read.
            peers.extend(peers_in(&std::fs::read_to_string(path).unwrap_or_default()));
        }
    }
    peers
}

fn peers_in(xml: &str) -> Vec<String> {
    let elements = xml.split('<').filter_map(|element| {
        let (tag, attributes) = element.split_once(char::is_whitespace)?;
        tag.eq_ignore_ascii_case("peer").then_some(attributes)
    });
    let addresses = elements.filter_map(|attributes| {
        let begin = attributes.to_ascii_lowercase().find("address")?;
        let (_, value) = attributes.get(begin..)?.split_once('=')?;
        let value = value.trim_start();
        let quote = value.chars().next().filter(|quote| matches!(quote, '"' | '\''))?;
        value.split(quote).nth(1).map(str::to_owned)
    });
    addresses.filter(|address| !address.is_empty()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_peer_is_an_address_a_name_or_refused() {
        let host = |peer| host(STATIC_PEERS, peer, true);
        for address in ["10.0.0.1", "10.0.0.1:7412", "udp/10.0.0.1", "239.255.0.1", "${ROBOT}", ""]
        {
            assert_eq!(host(address), Ok(None), "{address}");
        }
        for name in ["robot.local", "robot.local:7410", "udp/robot.local:7410"] {
            assert_eq!(host(name), Ok(Some("robot.local")), "{name}");
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

    #[test]
    fn peers_of_sources_are_found() {
        let xml = "<CycloneDDS><Domain><Discovery><Peers><Peer address=\"robot.local\"/>\
                   <peer PruneDelay='1s' Address = 'base:7410'></peer><Peer Address=\"\"/></Peers>\
                   </Discovery></Domain></CycloneDDS>";
        assert_eq!(peers_of(xml), ["robot.local", "base:7410"]);
        let folder = std::env::temp_dir().join(format!("wrapyfi_peers_{}.xml", std::process::id()));
        std::fs::write(&folder, xml).unwrap();
        let uri = format!("<CycloneDDS/>,file://{}", folder.display());
        assert_eq!(peers_of(&uri), ["robot.local", "base:7410"]);
        std::fs::remove_file(&folder).unwrap();
        assert!(peers_of("file:///nowhere,<a,b/>").is_empty());
    }

    #[test]
    fn names_resolve_or_say_why_not() {
        assert_eq!(resolve("localhost"), Ok(()));
        assert!(!resolve("no-such-host.invalid").unwrap_err().is_empty());
    }
}
