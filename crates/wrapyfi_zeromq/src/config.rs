//! Settings of ZeroMQ: the address of the broker, and the behaviour of the sockets.
//!
//! ```text
//!   WRAPYFI_ZEROMQ_* ──▶ ZeroMqConfig ──▶ Broker, ServiceBroker (embedded)
//!                                    └──▶ tcp://ip:port (publishers, listeners)
//! ```

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr};
use std::path::PathBuf;

use serde::Deserialize;

use super::curve_config::{CurveConfig, SECRET_KEY_FILE, SERVER_KEY};
use super::error::BrokerError;
use super::options::FRAME_SLACK;
use wrapyfi_endpoint::ServiceSpec;
use wrapyfi_endpoint::network::{
    Hosts, Insecure, Place, ReachedByOthers, VariableError, Variables, is_of_this_machine, variable,
};

/// Name of this middleware in addresses.
pub const NAME: &str = "zeromq";

/// Permission for this process to run the broker.
///
/// See [`ZeroMqConfig`].
///
/// ```
/// # mod wrapyfi_core { pub mod middleware { pub use wrapyfi_zeromq as zeromq; } }
/// use wrapyfi_core::middleware::zeromq::{BrokerMode, ZeroMqConfig};
/// assert_eq!(ZeroMqConfig::default().broker, BrokerMode::Embedded);
/// let elsewhere = ZeroMqConfig { broker: BrokerMode::Foreign, ..ZeroMqConfig::default() };
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BrokerMode {
    /// Runs the broker unless one is there already; takes over when that one goes away.
    #[default]
    Embedded,
    /// Only connects: another program runs the broker.
    Foreign,
}

impl BrokerMode {
    /// The mode of a process that starts a broker, or does not.
    const fn started(is_started: bool) -> Self {
        if is_started { Self::Embedded } else { Self::Foreign }
    }
}

/// Settings of [`ZeroMq`](super::ZeroMq).
///
/// ```
/// # mod wrapyfi_core { pub mod middleware { pub use wrapyfi_zeromq as zeromq; } }
/// use wrapyfi_core::middleware::zeromq::{BrokerMode, ZeroMqConfig};
/// let there = ZeroMqConfig {
///     ip: "192.168.1.7".into(),
///     broker: BrokerMode::Foreign,
///     ..ZeroMqConfig::default()
/// };
/// assert_eq!((there.pub_port, there.sub_port), (5555, 5556)); // Wrapyfi's own
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ZeroMqConfig {
    /// Host of the broker, an address or a name (`WRAPYFI_ZEROMQ_SOCKET_IP`).
    pub ip: String,
    /// Port to which listeners connect (`WRAPYFI_ZEROMQ_SOCKET_PUB_PORT`). With an embedded
    /// broker 0 means any free port.
    pub pub_port: u16,
    /// Port to which publishers connect (`WRAPYFI_ZEROMQ_SOCKET_SUB_PORT`).
    pub sub_port: u16,
    /// Port to which clients connect (`WRAPYFI_ZEROMQ_SOCKET_REP_PORT` for a client,
    /// `WRAPYFI_ZEROMQ_SOCKET_REQ_PORT` for a server: Wrapyfi crosses the names).
    pub rep_port: u16,
    /// Port to which servers connect (`WRAPYFI_ZEROMQ_SOCKET_REP_PORT` for a server).
    pub req_port: u16,
    /// Topic on which the broker tells who is subscribed
    /// (`WRAPYFI_ZEROMQ_PUBSUB_MONITOR_TOPIC`).
    pub monitor_topic: String,
    /// True where our broker publishes that topic (`WRAPYFI_ZEROMQ_START_PUBSUB_MONITOR`).
    pub monitor: bool,
    /// Process that runs the broker (`WRAPYFI_ZEROMQ_START_PROXY_BROKER`: `False` is foreign).
    pub broker: BrokerMode,
    /// True where that variable decided [`Self::broker`], so that keys do not. It is for scripts: a bridge, which has
    /// `broker: foreign`, does not follow it.
    pub broker_by_variable: bool,
    /// Process that runs the broker of requests and replies; ours starts with the first server.
    pub service_broker: BrokerMode,
    /// Messages a socket holds for a peer that is slower, in publishers and in the broker; 0 means
    /// without limit.
    pub send_hwm: u16,
    /// Requests that our broker holds while no server takes them; those beyond are answered with an error.
    pub pending: usize,
    /// Largest message, all frames, that a broker accepts before it cuts the connection, in bytes; of a socket the
    /// largest frame. A listener uses the limit of its own topic instead.
    pub max_frame_bytes: usize,
    /// Connections at one port of a broker. Those beyond are refused.
    pub max_connections: usize,
    /// Allows a broker on addresses other machines can reach (`WRAPYFI_ZEROMQ_INSECURE`). Nothing is
    /// authenticated or encrypted there, unless [`Self::curve`] has a list of clients: then no permission is needed.
    pub insecure: Insecure,
    /// Keys of CURVE; none: connections are open to all, and are not encrypted.
    pub curve: Option<CurveConfig>,
    /// Addresses of names that the system need not know.
    pub hosts: Hosts,
}

impl Default for ZeroMqConfig {
    fn default() -> Self {
        Self {
            ip: "127.0.0.1".to_owned(),
            pub_port: 5555,
            sub_port: 5556,
            rep_port: 5558,
            req_port: 5559,
            monitor_topic: "ZEROMQ/CONNECTIONS".to_owned(),
            monitor: true,
            broker: BrokerMode::Embedded,
            broker_by_variable: false,
            service_broker: BrokerMode::Embedded,
            // libzmq's own default, and so Wrapyfi's.
            send_hwm: 1000,
            pending: ServiceSpec::PENDING,
            max_frame_bytes: wrapyfi_data::Limits::default().message_bytes + FRAME_SLACK,
            max_connections: 4096,
            insecure: Insecure::default(),
            curve: None,
            hosts: Hosts::default(),
        }
    }
}

impl ZeroMqConfig {
    /// The defaults, changed by the `WRAPYFI_ZEROMQ_*` variables, as Wrapyfi's publishers,
    /// listeners and servers read them: `…_REQ_PORT` is [`Self::rep_port`] and `…_REP_PORT` is
    /// [`Self::req_port`]. Those about processes and threads (`…_SPAWN`) mean nothing here: our broker is a thread.
    ///
    /// # Errors
    /// When a variable has a value that means nothing; the error names it.
    #[doc(hidden)]
    pub fn from_env() -> Result<Self, VariableError> {
        Self::from_lookup(variable)
    }

    /// [`Self::from_env`] as Wrapyfi's clients read it: `…_REP_PORT` is [`Self::rep_port`].
    ///
    /// # Errors
    /// As [`Self::from_env`].
    #[doc(hidden)]
    pub fn from_env_of_client() -> Result<Self, VariableError> {
        // The variable that servers read into the other port.
        Self::from_lookup(|name| match name {
            "WRAPYFI_ZEROMQ_SOCKET_REQ_PORT" => variable("WRAPYFI_ZEROMQ_SOCKET_REP_PORT"),
            "WRAPYFI_ZEROMQ_SOCKET_REP_PORT" => Ok(None),
            other => variable(other),
        })
    }

    fn from_lookup(
        lookup: impl Fn(&'static str) -> Result<Option<String>, VariableError>,
    ) -> Result<Self, VariableError> {
        let of = Variables(lookup);
        let default = Self::default();
        let ip = of.text("WRAPYFI_ZEROMQ_SOCKET_IP")?;
        let mut insecure = Insecure::default();
        let is_insecure = of.switch("WRAPYFI_ZEROMQ_INSECURE", false)?;
        insecure.said(Place::Environment, ip.is_some(), is_insecure);
        let secret_key_file = of.text(SECRET_KEY_FILE)?.map(PathBuf::from);
        let server_key = of.text(SERVER_KEY)?;
        let has_curve = secret_key_file.is_some() || server_key.is_some();
        let curve = has_curve.then_some(CurveConfig { secret_key_file, server_key, clients: None });
        const START_BROKER: &str = "WRAPYFI_ZEROMQ_START_PROXY_BROKER";
        let broker = BrokerMode::started(of.switch(START_BROKER, true)?);
        let mut config = Self {
            ip: ip.unwrap_or(default.ip),
            insecure,
            curve,
            pub_port: of.port("WRAPYFI_ZEROMQ_SOCKET_PUB_PORT", default.pub_port)?,
            sub_port: of.port("WRAPYFI_ZEROMQ_SOCKET_SUB_PORT", default.sub_port)?,
            rep_port: of.port("WRAPYFI_ZEROMQ_SOCKET_REQ_PORT", default.rep_port)?,
            req_port: of.port("WRAPYFI_ZEROMQ_SOCKET_REP_PORT", default.req_port)?,
            monitor_topic: of
                .text("WRAPYFI_ZEROMQ_PUBSUB_MONITOR_TOPIC")?
                .unwrap_or(default.monitor_topic),
            monitor: of.switch("WRAPYFI_ZEROMQ_START_PUBSUB_MONITOR", true)?,
            broker,
            broker_by_variable: of.text(START_BROKER)?.is_some(),
            service_broker: broker,
            ..default
        };
        config.follow_keys();
        Ok(config)
    }

    /// Runs the brokers here unless clients are told the key of another process, where no variable says who runs them.
    /// It is asked again after [`Self::curve`] has changed.
    pub fn follow_keys(&mut self) {
        if !self.broker_by_variable {
            let is_elsewhere = self.curve.as_ref().is_some_and(CurveConfig::is_elsewhere);
            self.broker = BrokerMode::started(!is_elsewhere);
            self.service_broker = self.broker;
        }
    }

    /// Checks that no broker of ours would be open to other machines without permission. An address
    /// of another machine is only connected to, which needs none.
    ///
    /// # Errors
    /// When a broker would be; the error names the setting that permits it.
    #[doc(hidden)]
    pub fn check(&self) -> Result<(), ReachedByOthers> {
        let has_list = self.curve.as_ref().is_some_and(|curve| curve.clients.is_some());
        let is_ours =
            [self.broker, self.service_broker].contains(&BrokerMode::Embedded) && !has_list;
        // A name that has no address yet is looked at when the broker starts.
        let ip = match &*self.hosts.or_same(&self.ip) {
            ALL => Ok(Ipv4Addr::UNSPECIFIED.into()),
            other => other.parse::<IpAddr>(),
        };
        match ip {
            Ok(ip) if is_ours && is_of_this_machine(ip) => {
                self.insecure.check(NAME, "a broker", ip)
            }
            _ => Ok(()),
        }
    }

    /// Address of the broker.
    ///
    /// # Errors
    /// When the host has none.
    pub fn address(&self) -> Result<IpAddr, BrokerError> {
        resolve(&self.hosts.or_same(&self.ip))
    }
}

/// Host that stands for all addresses of this machine.
const ALL: &str = "*";

/// First address of `host`, or the reason why there is none.
fn resolve(host: &str) -> Result<IpAddr, BrokerError> {
    if host == ALL {
        return Ok(Ipv4Addr::UNSPECIFIED.into());
    }
    Hosts::default().resolve(host).map_err(BrokerError::Host)
}

/// Address to connect to for a broker bound to `ip`: all interfaces are reached through loopback.
pub(super) fn reachable(ip: IpAddr) -> IpAddr {
    match ip {
        IpAddr::V4(v4) if v4.is_unspecified() => Ipv4Addr::LOCALHOST.into(),
        IpAddr::V6(v6) if v6.is_unspecified() => Ipv6Addr::LOCALHOST.into(),
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn from(pairs: &[(&str, &str)]) -> Result<ZeroMqConfig, VariableError> {
        ZeroMqConfig::from_lookup(|name| {
            Ok(pairs.iter().find(|(n, _)| *n == name).map(|(_, v)| (*v).to_owned()))
        })
    }

    #[test]
    fn an_empty_environment_is_the_default() {
        assert_eq!(from(&[]), Ok(ZeroMqConfig::default()));
    }

    #[test]
    fn variables_replace_defaults() {
        let config = from(&[
            ("WRAPYFI_ZEROMQ_SOCKET_IP", "10.0.0.2"),
            ("WRAPYFI_ZEROMQ_SOCKET_PUB_PORT", "6000"),
            ("WRAPYFI_ZEROMQ_SOCKET_SUB_PORT", "6001"),
            ("WRAPYFI_ZEROMQ_SOCKET_REQ_PORT", "6002"),
            ("WRAPYFI_ZEROMQ_SOCKET_REP_PORT", "6003"),
            ("WRAPYFI_ZEROMQ_START_PROXY_BROKER", "False"),
            ("WRAPYFI_ZEROMQ_START_PUBSUB_MONITOR", "false"),
            ("WRAPYFI_ZEROMQ_PUBSUB_MONITOR_TOPIC", "M"),
        ])
        .unwrap();
        assert_eq!(
            (config.ip.as_str(), config.pub_port, config.sub_port),
            ("10.0.0.2", 6000, 6001)
        );
        assert_eq!((config.rep_port, config.req_port), (6002, 6003));
        assert_eq!((config.broker, config.monitor), (BrokerMode::Foreign, false));
        assert_eq!(config.monitor_topic, "M");
    }

    #[test]
    fn values_without_meaning_are_named() {
        for value in ["0", "-1", "65536", "abc"] {
            let error = from(&[("WRAPYFI_ZEROMQ_SOCKET_PUB_PORT", value)]).unwrap_err();
            assert!(error.to_string().contains("WRAPYFI_ZEROMQ_SOCKET_PUB_PORT"), "{error}");
            assert!(error.to_string().contains(value), "{error}");
        }
        assert!(from(&[("WRAPYFI_ZEROMQ_START_PROXY_BROKER", "perhaps")]).is_err());
        assert!(from(&[("WRAPYFI_ZEROMQ_SOCKET_IP", " ")]).is_err());
    }

    #[test]
    fn all_interfaces_are_reached_through_loopback() {
        assert_eq!(reachable(resolve("*").unwrap()), IpAddr::from(Ipv4Addr::LOCALHOST));
        assert_eq!(reachable(resolve("::").unwrap()), IpAddr::from(Ipv6Addr::LOCALHOST));
        assert!(resolve("localhost").unwrap().is_loopback());
    }
}
