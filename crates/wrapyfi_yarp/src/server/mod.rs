//! A name server to embed: what `yarpserver` does, in this process.
//!
//! ```text
//!   one line, name_ser, text, text_ack, tcp, http ──session──▶ commands ──▶ registry, subscriptions
//!   multicast question ────────────────────────────────────────┘  │  │
//!   readers of /root  ◀── [add] "/cam" ───────────────── events ──┘  └── links ──▶ asks /cam to
//!                                                                                  connect to /view
//! ```
//!
//! Real `yarp` tools, ports and Wrapyfi work with it as with YARP's own: it gives away port numbers,
//! names and multicast groups, and makes persistent connections itself.
//!
//! It listens on the loopback interface unless it is told otherwise: a name server obeys the program that
//! reaches it, and so decides where everybody's data go.
//!
//! # Differences to YARP's
//!
//! The answers are those of YARP 3.12.3, byte for byte: every recorded conversation with its name server is held
//! with ours. Also the odd ones: values come back sorted,
//! an unregistered port's groups are told as lines `old`, `bot register` answers in lines, commands over binary
//! tcp are answered with text, a port without a name can be registered.
//!
//! | | YARP | here |
//! | --- | --- | --- |
//! | a later line without `NAME_SERVER` | loses its first twelve bytes | is read |
//! | `NAME_SERVER` alone | waits for ever | answers with the end |
//! | no port number or group is free | the server exits | `refused: …` |
//! | registering a port that owns others | forgets what was asked | does it |
//! | a port number that is in use on this machine | is given away; the port then fails | is left out |
//! | `set` of `host`, `socket`, `carrier`, `type` | moves the port | `refused: …` |
//! | registering or unregistering the name server | does it | `refused: …` |
//! | a browser's form | does any command | only those that change nothing |
//! | `=tail`, unregistered | its name is lost | its name is used again |

use std::net::{IpAddr, Ipv4Addr, SocketAddr, UdpSocket};
use std::sync::{Arc, Weak};
use std::time::{Duration, Instant};

use tokio::net::TcpListener;
use tokio::task::JoinSet;
use wrapyfi_retry::Mutex;

use crate::WireLimits;
use crate::name::{NameClient, NameServerConf, name_fault};
use crate::port::core::{Core, NameService, Role};
use crate::port::names::Registration;
use crate::port::open::Opened;
use crate::port::{Network, NetworkOptions, Overflow, Port, PortOptions, Timeouts, life};
use crate::task::erased;
use commands::NameState;
use shared::ServerState;

mod allocator;
mod commands;
mod discovery;
mod http;
mod links;
mod options;
mod registry;
mod reply;
mod shared;
mod subscriptions;

pub use options::{NameServerLimits, NameServerOptions};
pub use shared::NameServerStatus;

#[doc(hidden)]
pub mod offline;

/// Longest time that readers of changes have to hear a goodbye.
const FAREWELL: Duration = Duration::from_secs(1);

/// Error of starting a name server.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum NameServerError {
    /// Other machines could reach it.
    #[error(
        "a name server on {0} can be reached by other machines, and anyone there could redirect \
         every connection: use 127.0.0.1, or set insecure: true where the network is trusted"
    )]
    NotLoopback(IpAddr),
    /// Another program has the port.
    #[error(
        "port {port} on {ip} is taken, perhaps by another name server: stop it, or choose another port"
    )]
    PortTaken {
        /// Address asked for.
        ip: IpAddr,
        /// Port asked for.
        port: u16,
    },
    /// The address belongs to another machine.
    #[error("{0} is not an address of this machine: run the name server there")]
    NotHere(IpAddr),
    /// The name cannot be that of a port.
    #[error("namespace {namespace:?} {reason}: write for instance /root")]
    BadNamespace {
        /// Name asked for.
        namespace: String,
        /// Rule that the name breaks.
        reason: String,
    },
    /// Anything else the system refused.
    #[error("the name server could not {action}: {source}")]
    Io {
        /// Action that failed.
        action: &'static str,
        /// Error of the system.
        source: std::io::Error,
    },
}

/// A running name server. Dropping it ends it.
#[derive(Debug)]
pub struct NameServer {
    port: Port,
    shared: Arc<ServerState>,
    discovery: JoinSet<()>,
}

impl NameServer {
    /// Binds the port and starts answering, on the current tokio runtime.
    ///
    /// # Errors
    /// When the port cannot be bound or must not be.
    pub async fn start(options: NameServerOptions) -> Result<Self, NameServerError> {
        let (ip, port) = (options.ip, options.port);
        if !ip.is_loopback() && !options.insecure {
            return Err(NameServerError::NotLoopback(ip));
        }
        let namespace = options.namespace.clone();
        if let Some(reason) = name_fault(&namespace, options.wire.max_name_bytes) {
            return Err(NameServerError::BadNamespace { namespace, reason });
        }
        let io = |action| move |source| NameServerError::Io { action, source };
        let listener = TcpListener::bind((ip, port)).await.map_err(|error| match error.kind() {
            std::io::ErrorKind::AddrInUse => NameServerError::PortTaken { ip, port },
            std::io::ErrorKind::AddrNotAvailable => NameServerError::NotHere(ip),
            _ => io("bind its port")(error),
        })?;
        let address = listener.local_addr().map_err(io("learn its port"))?;
        let own = Registration {
            name: namespace,
            host: options.advertised.clone().unwrap_or_else(|| reachable(ip).to_string()),
            port: options.advertised_port.unwrap_or_else(|| address.port()),
            carrier: "tcp".to_owned(),
        };
        let group = options.discovery_port.unwrap_or(crate::name::environment::DEFAULT_PORT);
        let state = NameState::new(&own, group, options.limits.clone());
        let limits = WireLimits { max_connections: options.limits.max_connections, ..options.wire };
        let network = Network::new(NetworkOptions {
            dialect: options.dialect,
            limits: limits.clone(),
            timeouts: Timeouts {
                handshake: options.handshake_timeout,
                connect: options.link_timeout,
                admin: options.link_timeout,
                close: FAREWELL,
                ..Timeouts::default()
            },
            ..NetworkOptions::default()
        });
        let (name, number) = (own.name.clone(), own.port);
        let opened = Opened { name, address, contact: format!("{}:{number}", own.host), number };
        let port = PortOptions {
            register: false,
            queue: options.limits.max_waiting_events,
            overflow: Overflow::DropNewest,
            ..PortOptions::default()
        };
        let options = NameServerOptions { wire: limits, ..options };
        let shared = Arc::new_cyclic(|this: &Weak<ServerState>| {
            let service = NameService {
                requests: this.clone(),
                idle_timeout: options.idle_timeout,
                max_readers: options.limits.max_readers,
            };
            let core = Core::new(&network, opened, port, Role::Output, None, Some(service));
            ServerState {
                this: this.clone(),
                own,
                options,
                core: Arc::new(core),
                state: Mutex::new(state),
                started: Instant::now(),
                commands: 0.into(),
                links: links::Links::default(),
            }
        });
        let mut discovery = JoinSet::new();
        if let Some(port) = shared.options.discovery_port {
            match discovery::socket(ip, port) {
                Ok(socket) => {
                    discovery.spawn(erased(discovery::answer(socket, port, Arc::clone(&shared))));
                }
                // Configured clients do not need it.
                Err(error) => tracing::warn!(
                    target: "wrapyfi_yarp::server",
                    "cannot be found by multicast on port {port}: {error}"
                ),
            }
        }
        let port = Port { core: Arc::clone(&shared.core) };
        tokio::spawn(erased(life::keep(Arc::clone(&port.core), listener)));
        tracing::info!(target: "wrapyfi_yarp::server", %address, "name server runs");
        Ok(Self { port, shared, discovery })
    }

    /// Address that the name server listens on.
    pub fn address(&self) -> SocketAddr {
        self.port.address()
    }

    /// Entry of the name server itself: its name, and the address at which others reach it.
    pub fn registration(&self) -> &Registration {
        &self.shared.own
    }

    /// A client of it.
    pub fn client(&self) -> NameClient {
        let own = &self.shared.own;
        NameClient::new(NameServerConf { host: own.host.clone(), port: own.port })
            .with_namespace(&*own.name)
    }

    /// Numbers of the server's names, connections and commands.
    pub fn status(&self) -> NameServerStatus {
        self.shared.status()
    }

    /// Ends it: connections are closed, readers of changes are told goodbye, the port is free when
    /// this returns.
    pub async fn stop(mut self) {
        self.shared.links.end();
        self.port.end().await;
        self.discovery.shutdown().await;
        tracing::info!(target: "wrapyfi_yarp::server", address = %self.address(), "name server ended");
    }
}

impl Drop for NameServer {
    fn drop(&mut self) {
        // The port ends with its handle, and answering by multicast with its set.
        self.shared.links.end();
    }
}

/// The address at which others reach what listens on `ip`.
fn reachable(ip: IpAddr) -> IpAddr {
    if !ip.is_unspecified() {
        return ip;
    }
    // Nothing is sent: the system only chooses the interface that leads to the network.
    let local = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).and_then(|socket| {
        socket.connect((crate::name::DISCOVERY_GROUP, 9))?;
        socket.local_addr()
    });
    // A machine without a route to anywhere has only itself.
    let local = local.ok().map(|address| address.ip()).filter(|ip| !ip.is_unspecified());
    local.unwrap_or(IpAddr::V4(Ipv4Addr::LOCALHOST))
}
