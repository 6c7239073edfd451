//! Settings that the ports of a process have in common.

use std::net::{IpAddr, Ipv4Addr};
use std::sync::Arc;
use std::time::Duration;

use super::link::LinkOptions;
use super::names::{NameTable, Names, Registration};
use super::room::{Boundless, Rooms};
use crate::name::Environment;
use crate::{Dialect, Limits};

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

/// Place of a port that the name server does not know.
type Known = Arc<dyn Fn(&str) -> Option<Registration> + Send + Sync>;

#[derive(Clone)]
pub(super) struct Shared {
    pub(super) names: Arc<dyn Names>,
    pub(super) known: Known,
    pub(super) dialect: Dialect,
    pub(super) limits: Limits,
    pub(super) timeouts: Timeouts,
    pub(super) listen: IpAddr,
    pub(super) host: Option<String>,
    pub(super) environment: Environment,
    pub(super) rooms: Rooms,
}

/// A network of ports: its name server, its dialect and its limits. Clones are the same network.
///
/// ```
/// use wrapyfi_yarp::port::names::NameTable;
/// use wrapyfi_yarp::port::Network;
///
/// // Without a name server: ports of this process find each other, and one fixed address.
/// let names = NameTable::new().with("/robot/cam", "192.168.1.7:10012".parse().unwrap());
/// let network = Network::builder().names(names).build();
/// # let _ = network;
/// ```
#[derive(Clone)]
pub struct Network(pub(super) Arc<Shared>);

impl std::fmt::Debug for Network {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Shared { dialect, limits, timeouts, listen, host, .. } = &*self.0;
        let mut out = f.debug_struct("Network");
        out.field("dialect", dialect).field("limits", limits).field("timeouts", timeouts);
        out.field("listen", listen).field("host", host).finish_non_exhaustive()
    }
}

impl Network {
    /// A network with a [`NameTable`] of its own, YARP 3 and the default limits, until told
    /// otherwise.
    pub fn builder() -> NetworkBuilder {
        NetworkBuilder(Shared {
            names: Arc::new(NameTable::new()),
            known: Arc::new(|_name| None),
            dialect: Dialect::default(),
            limits: Limits::default(),
            timeouts: Timeouts::default(),
            listen: Ipv4Addr::UNSPECIFIED.into(),
            host: None,
            environment: Environment::default(),
            rooms: || Box::new(Boundless),
        })
    }

    /// Name server of the network.
    #[must_use]
    pub fn names(&self) -> &Arc<dyn Names> {
        &self.0.names
    }

    /// Dialect in which the network's ports encode bottles.
    #[must_use]
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
        Self(Arc::new(Shared { dialect, ..(*self.0).clone() }))
    }

    /// Limits of everything that the network's ports read.
    #[must_use]
    pub fn limits(&self) -> &Limits {
        &self.0.limits
    }

    pub(super) fn link_options(&self) -> LinkOptions {
        LinkOptions {
            dialect: self.0.dialect,
            limits: self.0.limits.clone(),
            timeout: self.0.timeouts.connect,
            runtime_folder: self.0.environment.runtime_folder(),
        }
    }
}

/// Settings of a [`Network`].
#[must_use]
pub struct NetworkBuilder(Shared);

impl std::fmt::Debug for NetworkBuilder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("NetworkBuilder").finish_non_exhaustive()
    }
}

impl NetworkBuilder {
    /// Looks names up there.
    pub fn names(self, names: impl Names) -> Self {
        self.shared_names(Arc::new(names))
    }

    /// Looks names up there, too.
    pub fn shared_names(self, names: Arc<dyn Names>) -> Self {
        Self(Shared { names, ..self.0 })
    }

    /// Finds ports there that the name server does not know.
    pub fn known(
        self,
        known: impl Fn(&str) -> Option<Registration> + Send + Sync + 'static,
    ) -> Self {
        Self(Shared { known: Arc::new(known), ..self.0 })
    }

    /// Encodes and decodes bottles so. [`Network::probe_dialect`] finds out what a port speaks.
    pub fn dialect(self, dialect: Dialect) -> Self {
        Self(Shared { dialect, ..self.0 })
    }

    /// Refuses what exceeds these.
    pub fn limits(self, limits: Limits) -> Self {
        Self(Shared { limits, ..self.0 })
    }

    /// Waits so long.
    pub fn timeouts(self, timeouts: Timeouts) -> Self {
        Self(Shared { timeouts, ..self.0 })
    }

    /// Listens on this address only, instead of on all.
    pub fn listen(self, listen: IpAddr) -> Self {
        Self(Shared { listen, ..self.0 })
    }

    /// Registers ports under this host, instead of under the one that the name server sees.
    pub fn host(self, host: impl Into<String>) -> Self {
        Self(Shared { host: Some(host.into()), ..self.0 })
    }

    /// Opens ports under the names, at the numbers and addresses that these variables give them:
    /// [`Environment::port_naming`], [`Environment::own_ip`].
    pub fn environment(self, environment: Environment) -> Self {
        Self(Shared { environment, ..self.0 })
    }

    /// Counts what waits for a peer, or has begun to come from one, in the rooms that this makes.
    pub fn rooms(self, rooms: Rooms) -> Self {
        Self(Shared { rooms, ..self.0 })
    }

    /// The network.
    #[must_use]
    pub fn build(self) -> Network {
        Network(Arc::new(self.0))
    }
}
