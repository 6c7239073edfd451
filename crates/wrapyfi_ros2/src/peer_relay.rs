//! Peers by name: what CycloneDDS sends to a port of this program goes on to the host once its name resolves.
//!
//! ```text
//!   CycloneDDS ─ announcement, every 1.5 s ─▶ 127.0.0.1:PORT, a thread ─▶ ports of discovery at the host's addresses
//!                                              └ the name does not resolve: log, UNRESOLVED ─▶ why, waiting_for
//! ```
//!
//! Participants at the host answer the addresses that the announcement has, and from then on both are in touch without
//! the relay.

use std::collections::BTreeMap;
use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddrV4, ToSocketAddrs as _, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::{Duration, Instant};

use super::config::PARTICIPANTS;
use wrapyfi_endpoint::Mutex;

/// Time after which it is said again that a name does not resolve.
const TELL_EVERY: Duration = Duration::from_secs(30);
/// Time after which the addresses of a name are asked for again.
const RESOLVE_EVERY: Duration = Duration::from_secs(30);
/// Largest datagram.
const DATAGRAM: usize = 65_507;
/// Beginning of every message of DDS.
const MAGIC: &[u8] = b"RTPS";

/// Names that do not resolve: where each is from, the reason, and when it was logged. Of the whole process: nodes that
/// share a domain share its relays.
static UNRESOLVED: Mutex<BTreeMap<String, (&'static str, String, Instant)>> =
    Mutex::new(BTreeMap::new());

/// Hosts of `ROS_STATIC_PEERS` and `CYCLONEDDS_URI` whose names do not resolve, a sentence each.
pub fn unresolved_peers() -> Vec<String> {
    let unresolved = UNRESOLVED.lock();
    let sentence = |(host, (from, reason, _)): (&String, &(&str, String, Instant))| {
        format!("the host {host:?} of {from} does not resolve: {reason}")
    };
    unresolved.iter().map(sentence).collect()
}

/// Passes announcements on to one host until it is dropped.
#[derive(Debug)]
pub(super) struct Relay {
    port: u16,
    has_ended: Arc<AtomicBool>,
}

impl Relay {
    /// Begins for the `host` of the variable `from`, at its `port`, else at those of discovery in the `domain`.
    pub(super) fn start(
        from: &'static str,
        host: &str,
        port: Option<u16>,
        domain: u32,
    ) -> io::Result<Self> {
        let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))?;
        let out = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0))?;
        let relay = Self { port: socket.local_addr()?.port(), has_ended: Arc::default() };
        let (has_ended, host) = (Arc::clone(&relay.has_ended), host.to_owned());
        let ports = port.map_or_else(|| ports(domain), |port| vec![port]);
        std::thread::Builder::new().name("ros2-peer".to_owned()).spawn(move || {
            let mut addresses = Addresses::new(from, host);
            let mut buffer = vec![0; DATAGRAM];
            loop {
                let length = socket.recv(&mut buffer).unwrap_or_default();
                let datagram = buffer.get(..length).unwrap_or_default();
                if datagram.starts_with(MAGIC) {
                    for &address in addresses.known(resolve) {
                        for &port in &ports {
                            // There may be no program, or no way to it: the next announcement follows soon.
                            _ = out.send_to(datagram, (address, port));
                        }
                    }
                } else if has_ended.load(Relaxed) {
                    return;
                }
            }
        })?;
        Ok(relay)
    }

    /// Address at which CycloneDDS reaches it.
    pub(super) fn at(&self) -> SocketAddrV4 {
        SocketAddrV4::new(Ipv4Addr::LOCALHOST, self.port)
    }
}

impl Drop for Relay {
    fn drop(&mut self) {
        self.has_ended.store(true, Relaxed);
        // Behind the last announcement. The thread may be in a look-up, which nothing should wait for.
        let wake = || UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))?.send_to(&[], self.at());
        _ = wake();
    }
}

/// Ports of discovery of the participants in a domain.
fn ports(domain: u32) -> Vec<u16> {
    let first = 7400 + 250 * domain + 10;
    (0..=PARTICIPANTS).filter_map(|index| u16::try_from(first + 2 * index).ok()).collect()
}

fn resolve(host: &str) -> Result<Vec<Ipv4Addr>, String> {
    let found = (host, 0).to_socket_addrs().map_err(|error| error.to_string())?;
    let ipv4 = |address: std::net::SocketAddr| match address.ip() {
        IpAddr::V4(address) => Some(address),
        IpAddr::V6(_) => None,
    };
    let mut found: Vec<Ipv4Addr> = found.filter_map(ipv4).collect();
    found.dedup();
    if found.is_empty() { Err("it has no IPv4 address".to_owned()) } else { Ok(found) }
}

/// Addresses of one host as they were found last.
struct Addresses {
    from: &'static str,
    host: String,
    found: Vec<Ipv4Addr>,
    since: Option<Instant>,
}

impl Addresses {
    fn new(from: &'static str, host: String) -> Self {
        Self { from, host, found: Vec::new(), since: None }
    }

    /// Addresses that are known, after a look-up where there are none or they are old.
    fn known(
        &mut self,
        resolve: impl FnOnce(&str) -> Result<Vec<Ipv4Addr>, String>,
    ) -> &[Ipv4Addr] {
        if !self.found.is_empty() && self.since.is_some_and(|at| at.elapsed() < RESOLVE_EVERY) {
            return &self.found;
        }
        let (from, host) = (self.from, &self.host);
        match resolve(host) {
            Ok(found) => {
                if found != self.found {
                    tracing::info!("ROS 2 looks for others at {host} ({from}): {found:?}");
                }
                UNRESOLVED.lock().remove(host);
                (self.found, self.since) = (found, Some(Instant::now()));
            }
            // Those known before are as good as any.
            Err(_) if !self.found.is_empty() => self.since = Some(Instant::now()),
            Err(reason) => tell(from, host, &reason),
        }
        &self.found
    }
}

/// Notes that a name does not resolve, and logs it once in a while.
fn tell(from: &'static str, host: &str, reason: &str) {
    let (mut unresolved, now) = (UNRESOLVED.lock(), Instant::now());
    let before = unresolved.get(host).map(|(.., told)| *told);
    let told = before.filter(|told| now < *told + TELL_EVERY);
    unresolved.insert(host.to_owned(), (from, reason.to_owned(), told.unwrap_or(now)));
    drop(unresolved);
    if told.is_none() {
        tracing::warn!(
            "the host {host:?} of {from} does not resolve, and nodes on it are not found until it does: {reason}"
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::peer_names::STATIC_PEERS;

    #[test]
    fn an_announcement_reaches_the_host_that_a_name_resolves_to() {
        let host = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let port = host.local_addr().unwrap().port();
        let relay = Relay::start(STATIC_PEERS, "localhost", Some(port), 0).unwrap();
        let cyclone = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        for sent in [b"".as_slice(), b"noise", b"RTPS, hello"] {
            cyclone.send_to(sent, relay.at()).unwrap();
        }
        let mut got = [0; 64];
        let length = host.recv(&mut got).unwrap();
        assert_eq!(&got[..length], b"RTPS, hello");
    }

    #[test]
    fn a_name_is_told_until_it_resolves_and_its_address_is_kept() {
        let mut addresses = Addresses::new(STATIC_PEERS, "robot.made-up".to_owned());
        let is_told = || unresolved_peers().iter().any(|it| it.contains("robot.made-up"));
        let none = |_: &str| Err("no such name".to_owned());
        assert!(addresses.known(none).is_empty());
        assert!(is_told());
        let robot = Ipv4Addr::new(10, 0, 0, 7);
        assert_eq!(addresses.known(|_| Ok(vec![robot])), [robot]);
        assert!(!is_told());
        assert_eq!(addresses.known(|_| panic!("known a moment ago")), [robot]);
        addresses.since = None;
        assert_eq!(addresses.known(none), [robot]);
        assert!(!is_told());
    }

    #[test]
    fn ports_are_those_of_the_domain() {
        assert_eq!(ports(0).get(..2), Some(&[7410, 7412][..]));
        assert_eq!(ports(232).len(), 33);
        assert_eq!(ports(232).last(), Some(&65_474));
    }
}
