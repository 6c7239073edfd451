//! Settings and limits of a name server.

use std::net::{IpAddr, Ipv4Addr};
use std::time::Duration;

use crate::name::environment::DEFAULT_PORT;
use crate::{Dialect, WireLimits};

/// Limits of everything that a name server keeps. A client that asks for more is told so.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NameServerLimits {
    /// Most names. YARP's range of port numbers ends at 9998.
    pub max_names: usize,
    /// Longest name, host, carrier or key, in bytes.
    pub max_name_bytes: usize,
    /// Most properties of a port.
    pub max_properties: usize,
    /// Most values of a property.
    pub max_values: usize,
    /// Bytes of all values of a property.
    pub max_value_bytes: usize,
    /// Most persistent connections; also most topics, types and live ports.
    pub max_subscriptions: usize,
    /// Longest command, in bytes.
    pub max_command_bytes: usize,
    /// Most connections at a time.
    pub max_connections: usize,
    /// Most readers of changes at a time.
    pub max_readers: usize,
    /// Changes that wait for a reader; more are dropped and counted.
    pub max_waiting_events: usize,
}

impl Default for NameServerLimits {
    fn default() -> Self {
        Self {
            max_names: 10_000,
            max_name_bytes: 999,
            max_properties: 64,
            max_values: 256,
            max_value_bytes: 16 * 1024,
            max_subscriptions: 10_000,
            max_command_bytes: 64 * 1024,
            max_connections: 1024,
            max_readers: 64,
            max_waiting_events: 1024,
        }
    }
}

/// Settings of a name server.
#[derive(Debug, Clone)]
pub struct NameServerOptions {
    /// Address to bind.
    pub ip: IpAddr,
    /// Port to bind, 0 for any free one.
    pub port: u16,
    /// Port name of the name server.
    pub namespace: String,
    /// Host that it tells others for itself; by default the address it is bound to.
    pub advertised: Option<String>,
    /// Port number that it tells others for itself, where it is reached through another one than
    /// it is bound to; port numbers are given away from the second above it.
    pub advertised_port: Option<u16>,
    /// Allows an address that other machines can reach. Nothing is authenticated or encrypted.
    pub insecure: bool,
    /// UDP port on which it can be found by multicast, as `yarp detect` looks for it; none for not
    /// at all.
    pub discovery_port: Option<u16>,
    /// Gives ports of this machine no number that something else listens on.
    pub skip_busy_ports: bool,
    /// Makes the connections that subscriptions ask for, as YARP's name server does.
    pub make_connections: bool,
    /// Limits of everything that the server keeps.
    pub limits: NameServerLimits,
    /// Limits of everything that the server reads.
    pub wire: WireLimits,
    /// Encoding of bottles on binary carriers. Its own answers hold no floats: both are the same.
    pub dialect: Dialect,
    /// Time until a connection must have said what it is.
    pub handshake_timeout: Duration,
    /// Time after which a connection with one-line commands that says nothing is closed.
    pub idle_timeout: Duration,
    /// Time that each request to a port may take, when connections are made.
    pub link_timeout: Duration,
}

impl Default for NameServerOptions {
    fn default() -> Self {
        Self {
            ip: IpAddr::V4(Ipv4Addr::LOCALHOST),
            port: DEFAULT_PORT,
            namespace: crate::name::conf::DEFAULT_NAMESPACE.to_owned(),
            advertised: None,
            advertised_port: None,
            insecure: false,
            discovery_port: None,
            skip_busy_ports: true,
            make_connections: true,
            limits: NameServerLimits::default(),
            wire: WireLimits::default(),
            dialect: Dialect::default(),
            handshake_timeout: Duration::from_secs(5),
            idle_timeout: Duration::from_secs(30),
            link_timeout: Duration::from_secs(10),
        }
    }
}
