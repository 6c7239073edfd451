//! Names of machines, and the address of ours by which another machine is reached.

use std::collections::BTreeMap;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, ToSocketAddrs, UdpSocket};
use std::sync::LazyLock;

/// Names of machines and their addresses, known beside what the system resolves: `hosts:` of a
/// configuration.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_endpoint::network; }
/// use wrapyfi_core::network::Hosts;
/// let hosts = Hosts::from_iter([("robot".to_owned(), "192.168.1.7".parse()?)]);
/// assert_eq!(hosts.or_same("robot"), "192.168.1.7");
/// assert_eq!(hosts.or_same("laptop"), "laptop");
/// assert_eq!(hosts.resolve("127.0.0.1"), Ok("127.0.0.1".parse()?));
/// # Ok::<(), std::net::AddrParseError>(())
/// ```
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Hosts(BTreeMap<String, IpAddr>);

impl Hosts {
    /// Address that the configuration has for a name.
    pub fn get(&self, host: &str) -> Option<IpAddr> {
        self.0.get(&host.to_ascii_lowercase()).copied()
    }

    /// All names with their addresses.
    pub fn iter(&self) -> impl Iterator<Item = (&str, IpAddr)> {
        self.0.iter().map(|(host, ip)| (host.as_str(), *ip))
    }

    /// Address that the configuration has for `host`, or else `host`.
    pub fn or_same(&self, host: &str) -> String {
        self.get(host).map_or_else(|| host.to_owned(), |ip| ip.to_string())
    }

    /// Resolves `host`, which may be an address itself; to an IPv4 address where there is one.
    ///
    /// # Errors
    /// When it does not resolve; the text has the cause and the remedy.
    pub fn resolve(&self, host: &str) -> Result<IpAddr, String> {
        let bare = host.trim_matches(['[', ']']);
        if let Some(ip) = bare.parse().ok().or_else(|| self.get(bare)) {
            return Ok(ip);
        }
        let found: Vec<SocketAddr> =
            (bare, 0).to_socket_addrs().map_err(|error| Self::unresolved(bare, &error))?.collect();
        // ROS 1, YARP and Wrapyfi's sockets speak IPv4 unless they are told otherwise.
        let preferred = found.iter().find(|address| address.is_ipv4()).or(found.first());
        preferred.map(SocketAddr::ip).ok_or_else(|| Self::unresolved(bare, &"it has no address"))
    }

    /// Error text for a name for which the system has no address, with the remedy.
    pub fn unresolved(host: &str, reason: &dyn std::fmt::Display) -> String {
        format!(
            "host name {host:?} does not resolve on this machine ({reason}): write its address \
             under hosts: in the configuration, or into /etc/hosts"
        )
    }
}

impl FromIterator<(String, IpAddr)> for Hosts {
    fn from_iter<I: IntoIterator<Item = (String, IpAddr)>>(entries: I) -> Self {
        Self(entries.into_iter().map(|(host, ip)| (host.to_ascii_lowercase(), ip)).collect())
    }
}

/// Address of this machine from which `to` is reached; `None` where no way leads there. No packet
/// is sent for it.
pub fn facing(to: SocketAddr) -> Option<IpAddr> {
    let socket = UdpSocket::bind((unspecified(to.ip()), 0)).ok()?;
    socket.connect(to).ok()?;
    Some(socket.local_addr().ok()?.ip())
}

/// All addresses of this machine that are of the kind of `like`.
pub fn unspecified(like: IpAddr) -> IpAddr {
    match like {
        IpAddr::V4(_) => Ipv4Addr::UNSPECIFIED.into(),
        IpAddr::V6(_) => Ipv6Addr::UNSPECIFIED.into(),
    }
}

/// True when this machine has the address, so that a socket can listen on it.
pub fn is_of_this_machine(ip: IpAddr) -> bool {
    UdpSocket::bind((ip, 0)).is_ok()
}

/// Text that is the same for two programs that mean the same server: host and port, and for loopback the machine and
/// the network namespace that it belongs to. Two names of one host are two texts.
pub fn server_text(host: &str, port: u16) -> String {
    let bare = host.trim_matches(['[', ']']).to_ascii_lowercase();
    let is_loopback = |ip: IpAddr| ip.is_loopback() || ip.is_unspecified();
    if bare != "localhost" && !bare.parse().is_ok_and(is_loopback) {
        return format!("{bare}:{port}");
    }
    // Read once: a bridge asks for both ends of each of its routes, again and again.
    static HERE: LazyLock<String> = LazyLock::new(|| {
        let machine = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
        let namespace = std::fs::read_link("/proc/self/ns/net").unwrap_or_default();
        format!("{} {}", machine.trim_end(), namespace.display())
    });
    format!("{}:{port}", *HERE)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_texts_of_one_server_on_this_machine_are_the_same() {
        assert_eq!(server_text("localhost", 5555), server_text("127.0.0.1", 5555));
        assert_eq!(server_text("[::1]", 5555), server_text("0.0.0.0", 5555));
        assert_ne!(server_text("127.0.0.1", 5555), server_text("127.0.0.1", 5556));
        assert_eq!(server_text("Robot", 1), "robot:1");
    }

    #[test]
    fn names_are_looked_up_here_first() {
        let robot = IpAddr::from([192, 0, 2, 7]);
        let hosts: Hosts = [("Robot-Base".to_owned(), robot)].into_iter().collect();
        assert_eq!(hosts.resolve("robot-base"), Ok(robot));
        assert_eq!(hosts.or_same("ROBOT-BASE"), "192.0.2.7");
        assert_eq!(hosts.or_same("other"), "other");
        assert_eq!(hosts.resolve("[::1]"), Ok(Ipv6Addr::LOCALHOST.into()));
        assert!(hosts.resolve("localhost").unwrap().is_loopback());
        let error = hosts.resolve("no-such-host.invalid").unwrap_err();
        assert!(error.contains("no-such-host.invalid") && error.contains("hosts:"), "{error}");
    }

    #[test]
    fn loopback_faces_loopback() {
        let local = IpAddr::from(Ipv4Addr::LOCALHOST);
        assert_eq!(facing(SocketAddr::new(local, 9)), Some(local));
        assert!(is_of_this_machine(local));
        assert!(!is_of_this_machine([192, 0, 2, 7].into()));
    }
}
