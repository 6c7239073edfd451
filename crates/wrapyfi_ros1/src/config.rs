//! Settings of a ROS 1 node: the master's address, the node's name, and the address at which other
//! nodes find it.
//!
//! ```text
//!   ROS_MASTER_URI, ROS_HOSTNAME, ROS_IP, ROS_NAMESPACE ─▶ Ros1Config ─▶ Ros1::start
//! ```

use std::net::{IpAddr, SocketAddr};

use hyper::Uri;
use wrapyfi_interfaces::ros1::Rules;

use super::names::{NodeName, Ros1NameError};
use wrapyfi_endpoint::network::{
    Hosts, Insecure, Place, ReachedByOthers, VariableError, Variables, facing, is_of_this_machine,
    unspecified, variable,
};

/// Name of this middleware in addresses.
pub const NAME: &str = "ros";

/// Port of a master whose address names none.
pub const MASTER_PORT: u16 = 11311;

/// Settings of [`Ros1`](super::Ros1).
///
/// ```
/// # mod wrapyfi_core { pub mod middleware { pub use wrapyfi_ros1 as ros1; } }
/// use wrapyfi_core::middleware::ros1::Ros1Config;
/// let settings = Ros1Config {
///     master_uri: "http://robot:11311".into(),
///     node: Some("camera".into()),
///     remaps: vec![("image".into(), "/head/image".into())],
///     ..Ros1Config::default()
/// };
/// assert_eq!(Ros1Config::default().master_uri, "http://localhost:11311");
/// assert_eq!((settings.namespace.as_str(), settings.hostname), ("/", None));
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Ros1Config {
    /// Address of the master (`ROS_MASTER_URI`).
    pub master_uri: String,
    /// Name or address under which other nodes reach this one (`ROS_HOSTNAME`, else `ROS_IP`).
    /// Without one: loopback where the master is there, else the address that faces the master.
    pub hostname: Option<String>,
    /// Namespace of relative names (`ROS_NAMESPACE`).
    pub namespace: String,
    /// Name of the node. Without one it is `wrapyfi` and a number that no other program has, as Python
    /// Wrapyfi's anonymous node. A node that takes a name which another has ends that one.
    pub node: Option<String>,
    /// Remapping rules: the name in the program, the name on the graph.
    pub remaps: Vec<(String, String)>,
    /// Rules by which types of ROS 1 and ROS 2 belong together, before the rules that are built in.
    pub mapping_rules: Rules,
    /// Allows sockets on addresses that other machines reach (`WRAPYFI_ROS_INSECURE`). ROS 1 has no
    /// authentication and no encryption: the program that reaches the port may publish and call.
    pub insecure: Insecure,
    /// Addresses of names that the system need not know.
    pub hosts: Hosts,
    /// Most connections from other nodes at once.
    pub connections: usize,
}

impl Default for Ros1Config {
    fn default() -> Self {
        Self {
            master_uri: format!("http://localhost:{MASTER_PORT}"),
            hostname: None,
            namespace: "/".to_owned(),
            node: None,
            remaps: Vec::new(),
            mapping_rules: Rules::built_in(),
            insecure: Insecure::default(),
            hosts: Hosts::default(),
            connections: 256,
        }
    }
}

/// Error of the settings of a ROS 1 node.
///
/// ```
/// use wrapyfi_ros1::{Ros1, Ros1Config};
/// let settings = Ros1Config { master_uri: "robot:11311".into(), ..Ros1Config::default() };
/// let error = Ros1::start(&settings).err().unwrap().to_string();
/// assert!(error.starts_with("master_uri \"robot:11311\" (ROS_MASTER_URI) is no address of a master"));
/// ```
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Ros1ConfigError {
    /// The master's address is none.
    #[error(
        "master_uri {uri:?} (ROS_MASTER_URI) is no address of a master: {reason}; write it as \
         http://host:11311"
    )]
    MasterUri {
        /// Address as configured.
        uri: String,
        /// Rule that the address breaks.
        reason: String,
    },
    /// A name breaks the rules.
    #[error(transparent)]
    Name(#[from] Ros1NameError),
    /// A host name has no address now.
    #[error("{setting}: {reason}")]
    Host {
        /// Setting or variable that names the host.
        setting: &'static str,
        /// Reason why the host has no address.
        reason: String,
    },
    /// Other machines would reach the sockets.
    #[error(transparent)]
    Open(#[from] ReachedByOthers),
    /// A variable has a value that means nothing.
    #[error(transparent)]
    Variable(#[from] VariableError),
}

/// An address on the net as ROS 1 writes it: `http://host:port/`.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) struct NodeUri {
    pub(super) host: String,
    pub(super) port: u16,
}

impl std::fmt::Display for NodeUri {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.host.contains(':') {
            write!(f, "http://[{}]:{}/", self.host, self.port)
        } else {
            write!(f, "http://{}:{}/", self.host, self.port)
        }
    }
}

impl NodeUri {
    /// Reads `scheme://host:port/`; without a port the one of a master.
    pub(super) fn parse(text: &str) -> Result<Self, String> {
        const LONGEST: usize = 512;
        if text.len() > LONGEST {
            return Err(format!("it is {} bytes long, the limit is {LONGEST}", text.len()));
        }
        let uri: Uri = text
            .parse()
            .map_err(|error: hyper::http::uri::InvalidUri| format!("it is no URI: {error}"))?;
        // rosrpc:// is the address of a service.
        let (Some("http" | "rosrpc"), Some(authority)) = (uri.scheme_str(), uri.authority()) else {
            return Err("it does not begin with http://".to_owned());
        };
        if authority.as_str().contains('@') {
            return Err("it holds a user name, for which ROS 1 has no use".to_owned());
        }
        let port = authority.as_str().strip_prefix(authority.host()).unwrap_or_default();
        let port = match port.strip_prefix(':').map(str::parse) {
            None if port.is_empty() => MASTER_PORT,
            Some(Ok(port @ 1..)) => port,
            _ => return Err(format!("{port:?} is no port from 1 to 65535")),
        };
        let host = authority.host().trim_matches(['[', ']']);
        if host.is_empty() {
            return Err("it names no host".to_owned());
        }
        Ok(Self { host: host.to_owned(), port })
    }
}

/// Addresses and names that follow from the settings.
#[derive(Debug, Clone)]
pub(super) struct Resolved {
    pub(super) master: NodeUri,
    pub(super) node: NodeName,
    /// Host name or address that other nodes are told.
    pub(super) advertised: String,
    /// Address on which the node's sockets listen.
    pub(super) bind: IpAddr,
    /// Address of the master where it is on another machine.
    pub(super) afar: Option<IpAddr>,
}

impl Ros1Config {
    /// The defaults, changed by `ROS_MASTER_URI`, `ROS_HOSTNAME`, `ROS_IP`, `ROS_NAMESPACE` and
    /// `WRAPYFI_ROS_INSECURE`.
    ///
    /// # Errors
    /// When a variable has a value that means nothing; the error names it.
    #[doc(hidden)]
    pub fn from_env() -> Result<Self, Ros1ConfigError> {
        Ok(Self::from_lookup(variable)?)
    }

    fn from_lookup(
        lookup: impl Fn(&'static str) -> Result<Option<String>, VariableError>,
    ) -> Result<Self, VariableError> {
        let of = Variables(lookup);
        let is_insecure = of.switch("WRAPYFI_ROS_INSECURE", false)?;
        let default = Self::default();
        let hostname = match of.text("ROS_HOSTNAME")? {
            Some(hostname) => Some(hostname),
            None => of.text("ROS_IP")?,
        };
        let mut insecure = Insecure::default();
        insecure.said(Place::Environment, hostname.is_some(), is_insecure);
        // An empty namespace is the root, also in ROS 1's own tools.
        let namespace = (of.0)("ROS_NAMESPACE")?.unwrap_or(default.namespace);
        let master_uri = of.text("ROS_MASTER_URI")?.unwrap_or(default.master_uri);
        Ok(Self { master_uri, hostname, namespace, insecure, ..Self::default() })
    }

    /// Host and port of the master.
    ///
    /// # Errors
    /// When `master_uri` is no address.
    #[doc(hidden)]
    pub fn master(&self) -> Result<(String, u16), Ros1ConfigError> {
        self.master_at().map(|at| (at.host, at.port))
    }

    fn master_at(&self) -> Result<NodeUri, Ros1ConfigError> {
        NodeUri::parse(&self.master_uri)
            .map_err(|reason| Ros1ConfigError::MasterUri { uri: self.master_uri.clone(), reason })
    }

    /// Checks everything that can be known before anything starts. May ask the system for the address
    /// of a host name.
    pub(super) fn resolve(&self) -> Result<Resolved, Ros1ConfigError> {
        let master = self.master_at()?;
        let name = self.node.clone().unwrap_or_else(anonymous);
        let mut node = NodeName::new(&name, &self.namespace)?;
        for (from, to) in &self.remaps {
            node.remap(from, to)?;
        }
        let resolved = |setting, host: &str| {
            let found = self.hosts.resolve(host);
            found.map_err(|reason| Ros1ConfigError::Host { setting, reason })
        };
        let address = resolved("master_uri (ROS_MASTER_URI)", &master.host)?;
        let (advertised, own) = match &self.hostname {
            Some(hostname) => {
                let own = resolved("hostname (ROS_HOSTNAME, ROS_IP)", hostname)?;
                (hostname.trim_matches(['[', ']']).to_owned(), own)
            }
            None if address.is_loopback() => (address.to_string(), address),
            None => {
                // No packet is sent for it.
                let own = facing(SocketAddr::new(address, master.port));
                let own = own.ok_or_else(|| Ros1ConfigError::Host {
                    setting: "master_uri (ROS_MASTER_URI)",
                    reason: format!("no way leads from this machine to {address}"),
                })?;
                (own.to_string(), own)
            }
        };
        self.insecure.check(NAME, "a ROS 1 node", own)?;
        let afar = (!is_of_this_machine(address)).then_some(address);
        let master = NodeUri { host: self.hosts.or_same(&master.host), ..master };
        let bind = if is_of_this_machine(own) {
            own
        } else {
            // As behind a router that translates addresses: what is sent there arrives at another one.
            tracing::warn!(
                "ROS 1: {advertised}, which other nodes are told, is {own}, an address that this machine does not \
                 have: the node listens on all of its addresses"
            );
            unspecified(own)
        };
        Ok(Resolved { master, node, advertised, bind, afar })
    }
}

/// Begin of the name of a node that has none by its configuration.
const ANONYMOUS: &str = "wrapyfi_";

/// True for the full name of a node that got it from this crate, because its configuration gave it none.
pub fn is_anonymous(node: &str) -> bool {
    node.rsplit('/').next().is_some_and(|last| last.starts_with(ANONYMOUS))
}

/// `wrapyfi` and what no other node has: the process, and a count of the time in it.
fn anonymous() -> String {
    use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
    static NEXT: AtomicU64 = AtomicU64::new(0);
    let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
    let millis = since.map_or(0, |since| since.as_millis());
    format!("{ANONYMOUS}{}_{millis}_{}", std::process::id(), NEXT.fetch_add(1, Relaxed))
}

#[cfg(test)]
mod tests {
    use std::net::Ipv4Addr;

    use super::*;

    fn from(pairs: &[(&str, &str)]) -> Result<Ros1Config, VariableError> {
        Ros1Config::from_lookup(|name| {
            Ok(pairs.iter().find(|(n, _)| *n == name).map(|(_, v)| (*v).to_owned()))
        })
    }

    #[test]
    fn an_empty_environment_is_the_default() {
        assert_eq!(from(&[]), Ok(Ros1Config::default()));
        let resolved = Ros1Config::default().resolve().unwrap();
        assert!(resolved.bind.is_loopback());
        assert_eq!(resolved.master, NodeUri { host: "localhost".into(), port: 11311 });
        assert!(resolved.node.full().starts_with("/wrapyfi_"), "{}", resolved.node.full());
    }

    #[test]
    fn variables_replace_defaults_and_the_host_name_wins() {
        let config = from(&[
            ("ROS_MASTER_URI", "http://10.0.0.1:11411"),
            ("ROS_IP", "10.0.0.2"),
            ("ROS_HOSTNAME", "127.0.0.1"),
            ("ROS_NAMESPACE", "/arm"),
        ])
        .unwrap();
        assert_eq!(config.hostname.as_deref(), Some("127.0.0.1"));
        assert_eq!(config.namespace, "/arm");
        let resolved = config.resolve().unwrap();
        assert_eq!(resolved.master, NodeUri { host: "10.0.0.1".into(), port: 11411 });
        assert_eq!(resolved.advertised, "127.0.0.1");
        assert!(resolved.node.full().starts_with("/arm/wrapyfi_"));
    }

    #[test]
    fn other_machines_are_let_in_only_by_word() {
        let open = from(&[("ROS_IP", "10.0.0.2")]).unwrap();
        let refused = open.resolve().unwrap_err();
        assert!(matches!(refused, Ros1ConfigError::Open(_)), "{refused}");
        assert!(refused.to_string().contains("WRAPYFI_ROS_INSECURE=1"), "{refused}");
        let allowed = Ros1Config { insecure: true.into(), ..open }.resolve().unwrap();
        assert!(allowed.bind.is_unspecified(), "no address of this machine");
        assert_eq!(allowed.advertised, "10.0.0.2");
        assert!(from(&[("WRAPYFI_ROS_INSECURE", "True")]).unwrap().insecure.is_allowed);
    }

    #[test]
    fn an_announced_address_of_this_machine_is_the_one_that_is_bound() {
        let second = IpAddr::from([127, 0, 0, 2]);
        let hosts = [("robot".to_owned(), second)].into_iter().collect();
        let config =
            Ros1Config { hosts, hostname: Some("robot".to_owned()), ..Ros1Config::default() };
        let resolved = config.resolve().unwrap();
        assert_eq!((resolved.bind, resolved.advertised.as_str()), (second, "robot"));
        let Some(facing) = facing(SocketAddr::from(([192, 0, 2, 7], 9))) else { return };
        let config = Ros1Config {
            hostname: Some(facing.to_string()),
            insecure: true.into(),
            ..Ros1Config::default()
        };
        assert_eq!(config.resolve().unwrap().bind, facing);
    }

    #[test]
    fn values_without_meaning_are_named() {
        assert!(from(&[("ROS_IP", " ")]).unwrap_err().to_string().contains("ROS_IP"));
        assert!(from(&[("WRAPYFI_ROS_INSECURE", "perhaps")]).is_err());
        for uri in ["localhost:11311", "http://", "http://a:0", "http://a:x", "http://a b:1", "x"] {
            let config = Ros1Config { master_uri: uri.to_owned(), ..Ros1Config::default() };
            let error = config.resolve().unwrap_err().to_string();
            assert!(error.contains("ROS_MASTER_URI") && error.contains(uri), "{error}");
        }
        let node = Ros1Config { node: Some("1x".to_owned()), ..Ros1Config::default() };
        assert!(matches!(node.resolve(), Err(Ros1ConfigError::Name(_))));
    }

    #[test]
    fn a_master_whose_name_is_not_known_yet_may_become_known() {
        let master_uri = "http://no-such-host.invalid:11311".to_owned();
        let config = Ros1Config { master_uri, ..Ros1Config::default() };
        let error = config.resolve().unwrap_err();
        assert!(matches!(error, Ros1ConfigError::Host { .. }), "{error}");
        assert!(error.to_string().contains("no-such-host.invalid"), "{error}");
        let local = IpAddr::from(Ipv4Addr::LOCALHOST);
        let hosts = [("no-such-host.invalid".to_owned(), local)].into_iter().collect();
        let resolved = Ros1Config { hosts, ..config }.resolve().unwrap();
        assert_eq!((resolved.master.host.as_str(), resolved.afar), ("127.0.0.1", None));
    }

    #[test]
    fn addresses_read_as_nodes_write_them() {
        let read = |text: &str| NodeUri::parse(text).unwrap();
        let uri = |host: &str, port| NodeUri { host: host.to_owned(), port };
        assert_eq!(read("http://robot:1234/"), uri("robot", 1234));
        assert_eq!(read("rosrpc://robot:1234"), uri("robot", 1234));
        assert_eq!(read("http://[::1]:5/"), uri("::1", 5));
        assert_eq!(read("http://robot"), uri("robot", 11311));
        assert_eq!(read("http://[::1]:5/").to_string(), "http://[::1]:5/");
        for wrong in ["http://user@robot:1/", "ftp://robot:1/", "http://[::1]5", ""] {
            assert!(NodeUri::parse(wrong).is_err(), "{wrong}");
        }
    }
}
