//! Where the name server is, and where our ports listen.
//!
//! ```text
//!   YARP_CONFIG_HOME, HOME ─▶ yarp.conf ─▶ YarpConfig ─▶ name server: theirs, or ours (embedded)
//!   YARP_NAMESPACE ──────────────────────┘          └──▶ ports: 127.0.0.1, or the robot's network
//! ```

use std::net::{IpAddr, Ipv4Addr, SocketAddr};

use wrapyfi_yarp::Dialect;
use wrapyfi_yarp::name::conf::{self, DEFAULT_NAMESPACE, locate};
use wrapyfi_yarp::name::{Environment, Located, NameServerConf};

use crate::Limits;

/// Settings of [`Yarp`](super::Yarp).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct YarpConfig {
    /// Address of the name server. `None`: what YARP's own configuration says (`yarp.conf` in
    /// `$YARP_CONFIG_HOME`, …); with [`YarpConfig::embedded`] 127.0.0.1:10000 where it says nothing.
    pub name_server: Option<SocketAddr>,
    /// Runs a name server in this process, unless one answers there already. With port 0 it takes
    /// any free one: [`Yarp::name_server`](super::Yarp::name_server) tells it.
    pub embedded: bool,
    /// Port name of the name server; `None`: what YARP's configuration says, else `/root`.
    pub namespace: Option<String>,
    /// How bottles are encoded: YARP 3 or YARP 4. Nothing on the wire tells.
    pub dialect: Dialect,
    /// Address that ports listen on, and are reached at.
    pub ip: IpAddr,
    /// Allows an address that other machines can reach: nothing is authenticated or encrypted.
    pub insecure: bool,
    /// Messages that wait for each reader of a publisher; those beyond are refused.
    pub send_queue: usize,
    /// Largest message in bytes that a port reads before it cuts the connection; topics and services
    /// have limits of their own below it.
    pub max_message_bytes: usize,
}

impl Default for YarpConfig {
    fn default() -> Self {
        Self {
            name_server: None,
            embedded: false,
            namespace: None,
            dialect: Dialect::V3,
            ip: Ipv4Addr::LOCALHOST.into(),
            insecure: false,
            send_queue: 16,
            max_message_bytes: Limits::default().message_bytes + SLACK,
        }
    }
}

/// Room above a message limit for what is around the message.
pub(super) const SLACK: usize = 64 * 1024;

/// A name server to speak with.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Where {
    pub(super) server: NameServerConf,
    pub(super) namespace: String,
}

impl YarpConfig {
    /// The defaults with the name server that YARP's own configuration names, as YARP's programs and
    /// Wrapyfi find it. Wrapyfi has no variables of its own for YARP. Ports listen on the loopback
    /// interface where the name server does, else where other machines reach them.
    ///
    /// # Errors
    /// When there is no usable configuration; the error names the file.
    pub fn from_env() -> Result<Self, conf::ConfError> {
        let mut config = Self::default();
        let Located { conf, namespace, .. } = locate(&Environment::from_process())?;
        config.namespace = Some(namespace);
        // A name, or the address of another machine, stays with the file.
        if let Ok(ip) = conf.host.parse::<IpAddr>() {
            config.name_server = Some(SocketAddr::new(ip, conf.port));
        }
        Ok(config)
    }

    /// The name server that these settings mean.
    pub(super) fn find(&self) -> Result<Where, conf::ConfError> {
        let environment = Environment::from_process();
        let namespace = |known: Option<String>| {
            let wanted = self.namespace.clone().or(known);
            wanted.unwrap_or_else(|| DEFAULT_NAMESPACE.to_owned())
        };
        if let Some(address) = self.name_server {
            let server = NameServerConf { host: address.ip().to_string(), port: address.port() };
            return Ok(Where { server, namespace: namespace(None) });
        }
        match locate(&environment) {
            Ok(Located { conf, namespace: known, .. }) => {
                Ok(Where { server: conf, namespace: namespace(Some(known)) })
            }
            Err(conf::ConfError::Missing { .. } | conf::ConfError::NoFolder) if self.embedded => {
                let port = wrapyfi_yarp::name::environment::DEFAULT_PORT;
                let host = Ipv4Addr::LOCALHOST.to_string();
                let server = NameServerConf { host, port };
                Ok(Where { server, namespace: namespace(None) })
            }
            Err(error) => Err(error),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_needs_no_file() {
        let name_server = Some(([127, 0, 0, 1], 10_050).into());
        let config = YarpConfig { name_server, ..YarpConfig::default() };
        let found = config.find().unwrap();
        assert_eq!((found.server.host.as_str(), found.server.port), ("127.0.0.1", 10_050));
        assert_eq!(found.namespace, "/root");
        let other = YarpConfig { namespace: Some("/icub01".to_owned()), ..config };
        assert_eq!(other.find().unwrap().namespace, "/icub01");
    }
}
