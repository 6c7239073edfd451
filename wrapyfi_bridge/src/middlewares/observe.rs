//! A middleware as an observer of it sees it: the server that has to be reached first, and a look that opens
//! no endpoint and starts no broker.
//!
//! ```text
//!   Endpoints ─ doors ────▶ broker, name server, master: host, port, who starts it
//!             └ observer ─▶ a middleware that only looks
//! ```

use std::sync::Arc;

use wrapyfi_core::Limits;
use wrapyfi_core::endpoint::Middleware;
use wrapyfi_core::middleware::ros1::{self, Ros1};
use wrapyfi_core::middleware::ros2::Ros2;
use wrapyfi_core::middleware::ros2::environment::DiscoveryRange;
use wrapyfi_core::middleware::yarp;
use wrapyfi_core::middleware::zeromq::BrokerMode;
use wrapyfi_interfaces::named;
use wrapyfi_yarp::name::conf::locate;
use wrapyfi_yarp::name::{Environment, NameServerConf};

use super::available::unknown;
use super::load::Endpoints;
use super::ros2::Ros2Section;
use super::start::{Role, start};
use super::yarp::YarpSection;
use crate::exit::Failure;
use crate::files::in_no_file;
use crate::node::Node;

named! {
    /// Server without which nothing of a middleware is found.
    pub enum Server {
        /// The broker of topics.
        Broker => "ZeroMQ broker",
        /// The broker of requests and replies.
        ServiceBroker => "ZeroMQ broker of services",
        /// The name server of YARP.
        NameServer => "YARP name server",
        /// The master of ROS 1.
        Master => "ROS 1 master",
    }
    /// Name of the server.
    pub fn name;
}

/// Place at which a server is expected.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Door {
    /// Kind of the server.
    pub server: Server,
    /// Host as it is configured.
    pub host: String,
    /// Port of the server.
    pub port: u16,
    /// True where the bridge runs the server itself.
    pub is_own: bool,
}

/// A middleware that only looks, and the same once more where it is ROS 1.
pub type Observer = (Arc<dyn Middleware>, Option<Arc<Ros1>>);

/// Servers that `middleware` needs: for services if `is_service`, else for topics. None on ROS 2.
///
/// # Errors
/// Exit code 2 for settings that cannot be, and where nothing says where the server is.
pub fn doors(
    endpoints: &Endpoints,
    middleware: &str,
    is_service: bool,
) -> Result<Vec<Door>, Failure> {
    let largest = Limits::default().message_bytes;
    match middleware {
        "zeromq" => {
            let config = endpoints.zeromq.config(None, largest, &endpoints.hosts)?;
            let (server, mode, ports) = match is_service {
                false => (Server::Broker, config.broker, [config.pub_port, config.sub_port]),
                true => {
                    let ports = [config.rep_port, config.req_port];
                    (Server::ServiceBroker, config.service_broker, ports)
                }
            };
            let is_own = mode == BrokerMode::Embedded;
            let at = |port| Door { server, host: config.ip.clone(), port, is_own };
            Ok(ports.map(at).into())
        }
        yarp::NAME => {
            let config = endpoints.yarp.config(largest, &endpoints.hosts)?;
            let found = match config.name_server {
                Some(written) => written,
                None => match locate(&Environment::from_process()) {
                    Ok(located) => located.conf,
                    Err(_) if config.embedded => {
                        let port = wrapyfi_yarp::name::environment::DEFAULT_PORT;
                        NameServerConf { host: "127.0.0.1".to_owned(), port }
                    }
                    Err(error) => return Err(Failure::Absent(error.to_string())),
                },
            };
            let (host, port, is_own) = (found.host, found.port, config.embedded);
            Ok(vec![Door { server: Server::NameServer, host, port, is_own }])
        }
        ros1::NAME => {
            let config = endpoints.ros.config(&endpoints.hosts)?;
            let (host, port) = config.master().map_err(Failure::usage)?;
            Ok(vec![Door { server: Server::Master, host, port, is_own: false }])
        }
        _ => Ok(Vec::new()),
    }
}

/// Starts a middleware that only looks.
///
/// # Errors
/// Exit code 2 for settings that cannot work, 1 when it does not start.
pub fn observer(endpoints: &Endpoints, middleware: &str) -> Result<Observer, Failure> {
    let largest = Limits::default().message_bytes;
    match middleware {
        "zeromq" => {
            let observer = Some(Role::Observer);
            let config = endpoints.zeromq.config(observer, largest, &endpoints.hosts)?;
            let config = endpoints.zeromq.checked(config)?;
            Ok((Arc::new(start("zeromq", &config)?), None))
        }
        yarp::NAME => {
            let mut config = endpoints.yarp.config(largest, &endpoints.hosts)?;
            config.embedded = false;
            Ok((Arc::new(YarpSection::start_with(&config, false)?), None))
        }
        ros1::NAME => {
            let mut config = endpoints.ros.config(&endpoints.hosts)?;
            // The name of the bridge's node would end that node.
            config.node = None;
            let ros1 = Arc::new(start(ros1::NAME, &config)?);
            Ok((Arc::clone(&ros1) as Arc<dyn Middleware>, Some(ros1)))
        }
        "ros2" => Ok((Arc::new(endpoints.ros2.hidden()?), None)),
        other => Err(unknown(other)),
    }
}

/// ROS 2 that only looks, in another domain, or as far as multicast reaches.
///
/// # Errors
/// As [`observer`].
pub fn ros2_elsewhere(section: &Ros2Section, domain_id: u32, wide: bool) -> Result<Ros2, Failure> {
    let node = Node::hidden().map_err(Failure::usage)?;
    let domain_id = in_no_file(domain_id);
    let section = Ros2Section { domain_id: Some(domain_id), ..section.clone() };
    let mut settings = section.settings(&node, Limits::default().message_bytes)?;
    if wide {
        settings.cyclone.discovery.range = DiscoveryRange::Subnet;
    }
    start("ros2", &settings)
}
