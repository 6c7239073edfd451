//! Settings that the ports of a process have in common.

use std::net::{IpAddr, Ipv4Addr};
use std::sync::Arc;
use std::time::Duration;

use super::link::LinkOptions;
use super::names::{Names, Registration};
use super::room::{Boundless, Rooms};
use crate::name::{Environment, NameClient, NameServerConf};
use crate::{Dialect, WireLimits};

/// Time limits of connections and requests.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Timeouts {
    /// Time until a header that a peer began is complete.
    pub handshake: Duration,
    /// Time until the next byte of a message that has begun.
    pub progress: Duration,
    /// Time until a peer took our connection and answered its header.
    pub connect: Duration,
    /// Time until a port answered an administrative request.
    pub admin: Duration,
    /// Time until waiting messages are sent and goodbyes are said, when a port closes.
    pub close: Duration,
}

impl Default for Timeouts {
    fn default() -> Self {
        Self {
            handshake: Duration::from_secs(5),
            progress: Duration::from_secs(30),
            connect: Duration::from_secs(5),
            admin: Duration::from_secs(10),
            close: Duration::from_secs(2),
        }
    }
}

/// Place of a port that the name server does not know, or does not tell because it is away.
type Known = Arc<dyn Fn(&str) -> Option<Registration> + Send + Sync>;

/// Settings of a [`Network`]: by default a name server of this machine, YARP 3 and the default limits.
#[derive(Clone)]
pub struct NetworkOptions {
    /// Registry of the names of ports.
    pub names: Arc<dyn Names>,
    /// Places of ports that the name server does not know, or does not tell because it is away.
    pub known: Known,
    /// Codes of bottles that are written and read. [`Network::probe_dialect`] finds out what a port
    /// speaks.
    pub dialect: Dialect,
    /// Limits of everything that is read; what exceeds them is refused.
    pub limits: WireLimits,
    /// Times that ports wait.
    pub timeouts: Timeouts,
    /// Address to listen on; all of them unless it says so.
    pub listen: IpAddr,
    /// Host under which ports are registered, instead of the one that the name server sees.
    pub host: Option<String>,
    /// Variables that give ports their names, numbers and addresses: [`Environment::port_naming`],
    /// [`Environment::own_ip`].
    pub environment: Environment,
    /// Rooms in which what waits for a peer, or has begun to come from one, is counted.
    pub rooms: Rooms,
}

impl Default for NetworkOptions {
    fn default() -> Self {
        Self {
            names: Arc::new(NameClient::new(NameServerConf::default())),
            known: Arc::new(|_name| None),
            dialect: Dialect::default(),
            limits: WireLimits::default(),
            timeouts: Timeouts::default(),
            listen: Ipv4Addr::UNSPECIFIED.into(),
            host: None,
            environment: Environment::default(),
            rooms: || Box::new(Boundless),
        }
    }
}

impl std::fmt::Debug for NetworkOptions {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("NetworkOptions").field("limits", &self.limits).finish_non_exhaustive()
    }
}

/// A network of ports: its name server, its dialect and its limits. Clones are the same network.
///
/// ```
/// use std::sync::Arc;
///
/// use wrapyfi_yarp::name::NameClient;
/// use wrapyfi_yarp::port::{Network, NetworkOptions};
///
/// let names = NameClient::new("robot:10000".parse()?);
/// let network = Network::new(NetworkOptions { names: Arc::new(names), ..NetworkOptions::default() });
/// # let _ = network;
/// # Ok::<_, String>(())
/// ```
#[derive(Debug, Clone)]
pub struct Network(pub(super) Arc<NetworkOptions>);

impl Network {
    /// A network with these settings.
    pub fn new(options: NetworkOptions) -> Self {
        Self(Arc::new(options))
    }

    /// Name server of the network.
    pub fn names(&self) -> &Arc<dyn Names> {
        &self.0.names
    }

    /// Dialect in which the network's ports encode bottles.
    pub fn dialect(&self) -> Dialect {
        self.0.dialect
    }

    /// The same network, where ports opened from now on encode bottles so: a robot may have programs
    /// of YARP 3 and of YARP 4.
    #[must_use]
    pub fn with_dialect(&self, dialect: Dialect) -> Self {
        if self.0.dialect == dialect {
            return self.clone();
        }
        Self::new(NetworkOptions { dialect, ..(*self.0).clone() })
    }

    /// Limits of everything that the network's ports read.
    pub fn limits(&self) -> &WireLimits {
        &self.0.limits
    }

    pub(crate) fn link_options(&self) -> LinkOptions {
        LinkOptions {
            dialect: self.0.dialect,
            limits: self.0.limits.clone(),
            timeout: self.0.timeouts.connect,
            runtime_folder: self.0.environment.runtime_folder(),
        }
    }
}
