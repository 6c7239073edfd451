//! A middleware as an observer of it sees it: the server that has to be reached first, and a look that opens
//! no endpoint and starts no broker.
//!
//! ```text
//!   Endpoints ─ server_addresses ─▶ broker, name server, master: host, port, who starts it
//!             └ observer ─────────▶ a middleware that only looks
//! ```

use std::net::{IpAddr, Ipv4Addr};
use std::sync::Arc;

use wrapyfi_data::Limits;
use wrapyfi_endpoint::Middleware;
use wrapyfi_interfaces::named;
use wrapyfi_ros1::{self as ros1, MASTER_PORT, Ros1};
use wrapyfi_ros2::{Ros2, environment::DiscoveryRange};
use wrapyfi_yarp::name::conf::locate;
use wrapyfi_yarp::name::environment::DEFAULT_PORT;
use wrapyfi_yarp::name::{Environment, NameServerConf};
use wrapyfi_yarp_endpoint as yarp;
use wrapyfi_zeromq::{BrokerMode, ZeroMqConfig};

use super::load::Endpoints;
use super::ros2::Ros2Section;
use super::start::{Role, start};
use super::start_as;
use crate::exit::{Failure, Result};
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
        /// The router through which nodes on rmw_zenoh_cpp find each other.
        Router => "Zenoh router",
    }
    /// Name of the server.
    pub fn name;
}

/// Place at which a server is expected.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ServerAddress {
    /// Kind of the server.
    pub server: Server,
    /// Host as it is configured.
    pub host: String,
    /// Port of the server.
    pub port: u16,
    /// True where the bridge runs the server itself.
    pub is_own: bool,
    /// Command that starts it there, and what may be done instead.
    pub start: String,
    /// Settings that lead a command of this shell there, where the shell has others.
    pub reach: Reach,
}

/// Settings of a command of `wrapyfi`, each with a space.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Reach {
    /// Variables, to stand before the command.
    pub variables: String,
    /// Options, to stand behind it.
    pub options: String,
}

/// Command that has a server listen at a host and on ports, each with its option; what is usual is left out.
fn start_at(program: &str, host: &str, ports: &[(&str, u16, u16)]) -> String {
    let ip = host.parse::<IpAddr>().ok();
    let is_usual = ip.is_some_and(|ip| ip.is_unspecified() || ip == Ipv4Addr::LOCALHOST);
    let at = match ip {
        _ if is_usual || matches!(host, "*" | "localhost") => String::new(),
        Some(ip) if ip.is_loopback() => format!(" --ip {host}"),
        _ => format!(" --ip {host} --insecure"),
    };
    let others = ports.iter().filter(|(_, port, usual)| port != usual);
    let options: String = others.map(|(option, port, _)| format!(" {option} {port}")).collect();
    format!("{program}{at}{options}")
}

/// A middleware that only looks, and the same once more where it is ROS 1.
pub type Observer = (Arc<dyn Middleware>, Option<Arc<Ros1>>);

/// Servers that `middleware` needs: for services if `is_service`, else for topics. None on ROS 2, but for the router
/// of Zenoh.
///
/// # Errors
/// Exit code 2 for settings that cannot be, and where nothing says where the server is.
pub fn server_addresses(
    endpoints: &Endpoints,
    middleware: &str,
    is_service: bool,
) -> Result<Vec<ServerAddress>> {
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
            let (is_own, host) = (mode == BrokerMode::Embedded, config.ip);
            let usual = ZeroMqConfig::default();
            let options = [
                ("--pub-port", config.pub_port, usual.pub_port),
                ("--sub-port", config.sub_port, usual.sub_port),
                ("--rep-port", config.rep_port, usual.rep_port),
                ("--req-port", config.req_port, usual.req_port),
            ];
            let start = start_at("wrapyfi broker", &host, &options);
            let shell = ZeroMqConfig::from_env().unwrap_or(usual);
            let mut reach = Reach::default();
            // A broker on all interfaces is reached at the usual address.
            if host != shell.ip && host != "*" {
                reach.variables = format!("WRAPYFI_ZEROMQ_SOCKET_IP={host} ");
            }
            for (kind, port, of_shell) in
                [("PUB", config.pub_port, shell.pub_port), ("SUB", config.sub_port, shell.sub_port)]
            {
                if !is_service && port != of_shell {
                    reach.variables += &format!("WRAPYFI_ZEROMQ_SOCKET_{kind}_PORT={port} ");
                }
            }
            for (option, port, of_shell) in [
                ("--rep-port", config.rep_port, shell.rep_port),
                ("--req-port", config.req_port, shell.req_port),
            ] {
                if is_service && port != of_shell {
                    reach.options += &format!(" {option} {port}");
                }
            }
            let at = ServerAddress { server, host, port: 0, is_own, start, reach };
            Ok(ports.map(|port| ServerAddress { port, ..at.clone() }).into())
        }
        yarp::NAME => {
            let config = endpoints.yarp.config(largest, &endpoints.hosts)?;
            let found = match config.name_server {
                Some(written) => written,
                None => match locate(&Environment::from_process()) {
                    Ok(located) => located.server,
                    Err(_) if config.embedded => {
                        NameServerConf { host: "127.0.0.1".to_owned(), port: DEFAULT_PORT }
                    }
                    Err(error) => return Err(Failure::Absent(error.to_string())),
                },
            };
            let (host, port, is_own) = (found.host, found.port, config.embedded);
            let on = |option| [(option, port, DEFAULT_PORT)];
            let ours = start_at("wrapyfi yarpserver", &host, &on("--port"));
            let start = format!("{ours}    # or {}", start_at("yarpserver", "*", &on("--socket")));
            let reach = Reach::default();
            Ok(vec![ServerAddress { server: Server::NameServer, host, port, is_own, start, reach }])
        }
        ros1::NAME => {
            let config = endpoints.ros.config(&endpoints.hosts)?;
            let (host, port) = config.master().map_err(Failure::usage)?;
            // What the file says goes before the environment.
            let place = match &endpoints.ros.master_uri {
                Some(_) => "have `master_uri` say",
                None => "set ROS_MASTER_URI to",
            };
            let roscore = start_at("roscore", "*", &[("-p", port, MASTER_PORT)]);
            let start = format!("{roscore}    # or {place} where it runs");
            let variables = match &endpoints.ros.master_uri {
                Some(uri) => format!("ROS_MASTER_URI={} ", uri.value),
                None => String::new(),
            };
            let reach = Reach { variables, options: String::new() };
            Ok(vec![ServerAddress {
                server: Server::Master,
                host,
                port,
                is_own: false,
                start,
                reach,
            }])
        }
        "ros2" if endpoints.ros2.needs_zenoh_router() => Ok(vec![ServerAddress {
            server: Server::Router,
            host: "localhost".to_owned(),
            port: ZENOH_PORT,
            is_own: false,
            start: "ros2 run rmw_zenoh_cpp rmw_zenohd    # or have ZENOH_SESSION_CONFIG_URI say where it runs"
                .to_owned(),
            reach: Reach::default(),
        }]),
        _ => Ok(Vec::new()),
    }
}

/// Port on which the router of rmw_zenoh_cpp listens.
const ZENOH_PORT: u16 = 7447;

/// Starts a middleware that only looks.
///
/// # Errors
/// Exit code 2 for settings that cannot work, 1 when it does not start.
pub fn observer(endpoints: &Endpoints, middleware: &str) -> Result<Observer> {
    if middleware == ros1::NAME {
        let mut config = endpoints.ros.config(&endpoints.hosts)?;
        // The name of the bridge's node would end that node.
        config.node = None;
        let ros1 = Arc::new(start(ros1::NAME, &config)?);
        return Ok((Arc::clone(&ros1) as Arc<dyn Middleware>, Some(ros1)));
    }
    let mut endpoints = endpoints.clone();
    endpoints.yarp.embedded = false;
    Ok((start_as(&endpoints, middleware, Role::Observer)?, None))
}

/// ROS 2 that only looks, in another domain, or as far as multicast reaches.
///
/// # Errors
/// As [`observer`].
pub fn ros2_elsewhere(section: &Ros2Section, domain_id: u32, wide: bool) -> Result<Ros2> {
    let node = Node::hidden().map_err(Failure::usage)?;
    let domain_id = in_no_file(domain_id);
    let section = Ros2Section { domain_id: Some(domain_id), ..section.clone() };
    let mut settings = section.settings(&node, Limits::default().message_bytes)?;
    if wide {
        settings.cyclone.discovery_range = DiscoveryRange::Subnet;
    }
    start("ros2", &settings)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::middlewares::load_text;

    /// First server of a middleware where a configuration says.
    fn server_address(middleware: &str, settings: &str, is_service: bool) -> ServerAddress {
        let route = "routes:\n  - { from: 'zeromq:/a', to: 'ros2:/a', type: Text }\n";
        let text = format!("endpoints: {{ {settings} }}\n{route}");
        let endpoints = load_text(&text, "x.yaml").unwrap().endpoints;
        server_addresses(&endpoints, middleware, is_service).unwrap().remove(0)
    }

    #[test]
    fn a_command_of_the_shell_is_led_to_where_the_configuration_says() {
        let ports = "zeromq: { ip: 127.0.0.2, pub_port: 6555, rep_port: 6558, broker: foreign }";
        for (middleware, settings, is_service, variables, options) in [
            ("zeromq", "", false, "", ""),
            (
                "zeromq",
                ports,
                false,
                "WRAPYFI_ZEROMQ_SOCKET_IP=127.0.0.2 WRAPYFI_ZEROMQ_SOCKET_PUB_PORT=6555 ",
                "",
            ),
            ("zeromq", ports, true, "WRAPYFI_ZEROMQ_SOCKET_IP=127.0.0.2 ", " --rep-port 6558"),
            (
                "ros",
                "ros: { master_uri: 'http://localhost:11411' }",
                false,
                "ROS_MASTER_URI=http://localhost:11411 ",
                "",
            ),
        ] {
            let Reach { variables: led, options: given } =
                server_address(middleware, settings, is_service).reach;
            assert_eq!((led.as_str(), given.as_str()), (variables, options), "{settings}");
        }
    }

    #[test]
    fn what_starts_a_server_does_so_where_the_configuration_says() {
        for (middleware, settings, wanted) in [
            ("zeromq", "", "wrapyfi broker"),
            (
                "zeromq",
                "zeromq: { ip: 10.0.0.2, broker: foreign, pub_port: 6555, req_port: 6559 }",
                "wrapyfi broker --ip 10.0.0.2 --insecure --pub-port 6555 --req-port 6559",
            ),
            (
                "zeromq",
                "zeromq: { ip: 127.0.0.9, broker: foreign }",
                "wrapyfi broker --ip 127.0.0.9",
            ),
            (
                "yarp",
                "yarp: { name_server: '127.0.0.1:10000' }",
                "wrapyfi yarpserver    # or yarpserver",
            ),
            (
                "yarp",
                "yarp: { name_server: '10.0.0.2:10050' }",
                "wrapyfi yarpserver --ip 10.0.0.2 --insecure --port 10050    # or yarpserver --socket 10050",
            ),
            (
                "ros",
                "ros: { master_uri: 'http://localhost:11411' }",
                "roscore -p 11411    # or have `master_uri` say where it runs",
            ),
        ] {
            assert_eq!(server_address(middleware, settings, false).start, wanted);
        }
    }
}
