//! Settings of a YARP network: the address of the name server, and the addresses on which our ports
//! listen.
//!
//! ```text
//!   YARP_CONFIG_HOME, HOME ─▶ yarp.conf ─▶ YarpConfig ─▶ name server: theirs, or ours (embedded)
//!   YARP_NAMESPACE ──────────────────────┘          └──▶ ports, which others are told to reach at
//!        ip of the configuration, else YARP_IP, else the address that leads to the name server
//! ```

use std::net::{IpAddr, Ipv4Addr, SocketAddr};

use wrapyfi_yarp::Dialect;
use wrapyfi_yarp::name::conf::{self, DEFAULT_NAMESPACE, locate};
use wrapyfi_yarp::name::environment::EnvironmentError;
use wrapyfi_yarp::name::{Environment, Located, NameServerConf};

use super::error::YarpError;
use super::name::NAME;
use super::types::Convention;
use wrapyfi_data::Limits;
use wrapyfi_endpoint::network::{
    Hosts, Insecure, Place, ReachedByOthers, facing, is_of_this_machine, is_on,
};

/// Variable of the environment that lets other machines reach our ports.
const INSECURE: &str = "WRAPYFI_YARP_INSECURE";

/// Settings of [`Yarp`](super::Yarp).
///
/// ```
/// # mod wrapyfi_core { pub mod middleware { pub use wrapyfi_yarp_endpoint as yarp; } }
/// use wrapyfi_core::middleware::yarp::YarpConfig;
/// let config = YarpConfig {
///     name_server: Some("192.168.1.7:10000".parse()?),
///     ip: Some("127.0.0.1".parse()?),
///     ..YarpConfig::default()
/// };
/// assert_eq!(config.name_server.unwrap().port, 10000);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct YarpConfig {
    /// Address of the name server. `None`: what YARP's own configuration says (`yarp.conf` in
    /// `$YARP_CONFIG_HOME`, …); with [`YarpConfig::embedded`] 127.0.0.1:10000 where it says nothing.
    pub name_server: Option<NameServerConf>,
    /// Runs a name server in this process, unless one answers there already. With port 0 it takes
    /// any free one: [`Yarp::name_server`](super::Yarp::name_server) tells it.
    pub embedded: bool,
    /// Port name of the name server; `None`: what YARP's configuration says, else `/root`.
    pub namespace: Option<String>,
    /// Dialect in which bottles are written and read: YARP 3 or YARP 4. Nothing on the wire tells
    /// it.
    pub dialect: Dialect,
    /// Address at which ports are reached; where it is one of this machine's they listen there alone.
    /// `None`: what `YARP_IP` says, else the address that leads to the name server, which is
    /// 127.0.0.1 where the name server is there.
    pub ip: Option<IpAddr>,
    /// Allows an address that other machines can reach (`WRAPYFI_YARP_INSECURE`): nothing is
    /// authenticated or encrypted.
    pub insecure: Insecure,
    /// Addresses of names that the system need not know.
    pub hosts: Hosts,
    /// Messages that wait for each reader of a publisher; those beyond are refused.
    pub send_queue: usize,
    /// Largest message in bytes that a port reads before it cuts the connection; topics and services
    /// have limits of their own below it.
    pub max_message_bytes: usize,
    /// True where a bottle of one string is JSON, whichever program sends it, as Wrapyfi's listeners have it. Otherwise
    /// it is that where a program of Wrapyfi sends it, and itself where another one does. Option `bottle` goes before
    /// it.
    #[doc(hidden)]
    pub is_wrapyfi: bool,
    /// Rules that tell a port's type by its name, of which the first that matches counts; [`Convention::usual`] unless
    /// said. The type of any other port is that of its first message.
    #[doc(hidden)]
    pub conventions: Vec<Convention>,
}

impl Default for YarpConfig {
    fn default() -> Self {
        Self {
            name_server: None,
            embedded: false,
            namespace: None,
            dialect: Dialect::V3,
            ip: None,
            insecure: Insecure::default(),
            hosts: Hosts::default(),
            send_queue: 16,
            max_message_bytes: Limits::default().message_bytes + SLACK,
            is_wrapyfi: false,
            conventions: Convention::usual(),
        }
    }
}

/// Room above a message limit for what is around the message.
pub(super) const SLACK: usize = 64 * 1024;

/// Address on which ports listen, and the one that other programs are told.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Listening {
    pub(super) on: IpAddr,
    /// `None`: the address from which the name server sees us, as YARP's ports.
    pub(super) advertised: Option<IpAddr>,
    /// The name server is on another machine.
    pub(super) is_afar: bool,
    /// Refusal of ports that others connect to; `None` where they may be opened.
    pub(super) refused: Option<ReachedByOthers>,
}

impl YarpConfig {
    /// The defaults, changed by `WRAPYFI_YARP_INSECURE`. The place of the name server and `YARP_IP`
    /// are looked up when [`Yarp`](super::Yarp) starts, as YARP's programs and Wrapyfi find them.
    ///
    /// # Errors
    /// When that variable has a value that means nothing.
    #[doc(hidden)]
    pub fn from_env() -> Result<Self, conf::ConfError> {
        let names_address = std::env::var_os("YARP_IP").is_some_and(|value| !value.is_empty());
        let is_insecure = match std::env::var_os(INSECURE) {
            None => false,
            Some(value) => {
                let value = value.to_string_lossy().into_owned();
                is_on(&value).ok_or_else(|| EnvironmentError {
                    name: INSECURE.to_owned(),
                    value,
                    reason: "is neither True nor False",
                })?
            }
        };
        let mut config = Self::default();
        config.insecure.said(Place::Environment, names_address, is_insecure);
        Ok(config)
    }

    /// Checks that these settings lead to a name server.
    ///
    /// # Errors
    /// When nothing says it; the error names the file.
    #[doc(hidden)]
    pub fn check_name_server(&self) -> Result<(), conf::ConfError> {
        self.find().map(drop)
    }

    /// These settings with the name server that they lead to now: another one where YARP's own configuration has changed.
    #[must_use]
    pub fn located(mut self) -> Self {
        if let Ok(Located { server, namespace }) = self.find() {
            (self.name_server, self.namespace) = (Some(server), Some(namespace));
        }
        self
    }

    /// The name server that these settings mean.
    pub(super) fn find(&self) -> Result<Located, conf::ConfError> {
        let environment = Environment::from_process();
        let namespace = |known: Option<String>| {
            let wanted = self.namespace.clone().or(known);
            wanted.unwrap_or_else(|| DEFAULT_NAMESPACE.to_owned())
        };
        if let Some(server) = &self.name_server {
            return Ok(Located { server: server.clone(), namespace: namespace(None) });
        }
        match locate(&environment) {
            Ok(Located { server, namespace: known }) => {
                Ok(Located { server, namespace: namespace(Some(known)) })
            }
            Err(missing) if self.embedded && missing.is_missing() => {
                let port = wrapyfi_yarp::name::environment::DEFAULT_PORT;
                let host = Ipv4Addr::LOCALHOST.to_string();
                let server = NameServerConf { host, port };
                Ok(Located { server, namespace: namespace(None) })
            }
            Err(error) => Err(error),
        }
    }

    /// Addresses for the ports of these settings, with the name server at `server`.
    pub(super) fn listening(
        &self,
        server: SocketAddr,
        environment: &Environment,
    ) -> Result<Listening, YarpError> {
        let is_afar = !is_of_this_machine(server.ip());
        let of_environment =
            || environment.own_ip(Some(server.ip())).map_err(conf::ConfError::from);
        let said = match self.ip {
            None => of_environment()?,
            said => said,
        };
        let any: IpAddr = Ipv4Addr::UNSPECIFIED.into();
        let (on, advertised) = match said {
            Some(ip) if ip.is_unspecified() => (ip, None),
            Some(ip) if is_of_this_machine(ip) => (ip, Some(ip)),
            // The address that others have for this machine, perhaps through a router.
            Some(ip) => (any, Some(ip)),
            None if server.ip().is_loopback() => (server.ip(), Some(server.ip())),
            None => (any, None),
        };
        let reached = match (on, advertised) {
            (on, None) if self.ip.is_none() => facing(server).unwrap_or(on),
            (_, Some(advertised)) => advertised,
            (on, None) => on,
        };
        let refused = self.insecure.check(NAME, "a port", reached).err();
        Ok(Listening { on, advertised, is_afar, refused })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_needs_no_file() {
        let name_server = Some(SocketAddr::from(([127, 0, 0, 1], 10_050)).into());
        let config = YarpConfig { name_server, ..YarpConfig::default() };
        let found = config.find().unwrap();
        assert_eq!((found.server.host.as_str(), found.server.port), ("127.0.0.1", 10_050));
        assert_eq!(found.namespace, "/root");
        let other = YarpConfig { namespace: Some("/icub01".to_owned()), ..config };
        assert_eq!(other.find().unwrap().namespace, "/icub01");
    }

    #[test]
    fn ports_are_where_the_name_server_is_unless_it_is_said() {
        let local = IpAddr::from(Ipv4Addr::LOCALHOST);
        let server = SocketAddr::new(local, 10_000);
        let (config, nothing) = (YarpConfig::default(), Environment::default());
        let listening = config.listening(server, &nothing).unwrap();
        let here = Listening { on: local, advertised: Some(local), is_afar: false, refused: None };
        assert_eq!(listening, here);
        let variable = Environment::default().with("YARP_IP", "192.0.2.7");
        let refused = config.listening(server, &variable).unwrap().refused.unwrap().to_string();
        assert!(refused.contains("192.0.2.7") && refused.contains(INSECURE), "{refused}");
        let open = YarpConfig { insecure: true.into(), ..config.clone() };
        let listening = open.listening(server, &variable).unwrap();
        assert_eq!((listening.advertised, listening.refused), (Some([192, 0, 2, 7].into()), None));
        assert!(listening.on.is_unspecified(), "no address of this machine: others lead to it");
        // The configuration goes before the variable.
        let said = YarpConfig { ip: Some(local), ..config };
        assert_eq!(said.listening(server, &variable).unwrap().advertised, Some(local));
    }
}
