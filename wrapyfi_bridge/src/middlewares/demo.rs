//! Middlewares of `wrapyfi demo`: three parties on one host.

use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;

use wrapyfi_endpoint::{MiddlewareSettings, Registry};
use wrapyfi_ros2::{self as ros2, Ros2, Ros2Settings};
use wrapyfi_yarp_endpoint::{self as yarp, YarpConfig};
use wrapyfi_zeromq::{self as zeromq, BrokerMode, ZeroMqConfig};

use super::endpoints::of_start;
use crate::exit::{Failure, Result};
use crate::node::Node;

/// The three parties of the demo, each with sockets of its own.
pub struct DemoMiddlewares {
    /// Middlewares that the routes use.
    pub bridge: Registry,
    /// Middlewares that the sources publish on.
    // After the bridge's: ports are unregistered where the name server still is.
    pub sources: Registry,
    /// Middleware that the viewer listens on.
    pub viewer: Ros2,
    /// Address and ports of the broker.
    pub broker: String,
    /// Address and port of the YARP name server.
    pub name_server: String,
    domain_id: u32,
}

impl DemoMiddlewares {
    /// Starts the bridge's side with its broker, the sources' with a YARP name server, and the
    /// viewer's.
    ///
    /// Everything stays on this host: ROS 2 discovery is limited to it unless
    /// `ROS_AUTOMATIC_DISCOVERY_RANGE` says otherwise. The name server has a free port and is not
    /// announced, so that the user's own YARP network, if there is one, is left alone.
    ///
    /// # Errors
    /// Exit code 1 when a middleware does not start.
    pub fn start() -> Result<Self> {
        let mut config = ZeroMqConfig::from_env().map_err(Failure::usage)?;
        config.broker = BrokerMode::Embedded;
        config.check_keys().map_err(Failure::Usage)?;
        let bridge_side = match started(zeromq::NAME, &config) {
            Ok(started) => started,
            Err(error) => {
                // Something else has Wrapyfi's ports: the demo does not need those.
                tracing::info!("{error}; the demo's broker takes free ports");
                (config.pub_port, config.sub_port) = (0, 0);
                started(zeromq::NAME, &config)?
            }
        };
        (config.pub_port, config.sub_port) = (bridge_side.pub_port(), bridge_side.sub_port());
        config.broker = BrokerMode::Foreign;
        let broker = format!("{}:{}/{}", config.ip, config.pub_port, config.sub_port);
        let mut sources = Registry::new();
        sources.register(Arc::new(started(zeromq::NAME, &config)?));
        let robot_side = YarpConfig {
            name_server: Some(SocketAddr::from((Ipv4Addr::LOCALHOST, 0)).into()),
            embedded: true,
            ..YarpConfig::default()
        };
        let robot_side = started(yarp::NAME, &robot_side)?;
        let name_server = robot_side.embedded().map(Into::into);
        let config = YarpConfig { name_server, ..YarpConfig::default() };
        let yarp = started(yarp::NAME, &config)?;
        let name_server = robot_side.name_server().to_owned();
        sources.register(Arc::new(robot_side));

        let graph = |name: &str| -> Result<_> {
            let lookup = |name: &str| match (name, std::env::var(name).ok()) {
                ("ROS_AUTOMATIC_DISCOVERY_RANGE", None) => Some("LOCALHOST".to_owned()),
                (_, value) => value,
            };
            let node = Node::named(name).map_err(Failure::usage)?;
            let settings = Ros2Settings::of_node(node.name().clone(), lookup);
            let settings = settings.map_err(Failure::usage)?;
            Ok((started(ros2::NAME, &settings)?, settings.cyclone.domain_id))
        };
        let (ros2, domain_id) = graph("wrapyfi_demo")?;
        let (viewer, _) = graph("wrapyfi_demo_viewer")?;
        let mut bridge = Registry::new();
        bridge.register(Arc::new(bridge_side));
        bridge.register(Arc::new(yarp));
        bridge.register(Arc::new(ros2));
        Ok(Self { sources, bridge, viewer, broker, name_server, domain_id })
    }

    /// Domain of the demo, what carries it and why.
    pub fn graph(&self) -> String {
        let carrier = self.viewer.carried_by().map(|carrier| format!(" on {carrier}"));
        format!("domain {}{}", self.domain_id, carrier.unwrap_or_default())
    }
}

fn started<S: MiddlewareSettings>(name: &str, settings: &S) -> Result<S::Middleware> {
    settings.start().map_err(|error| of_start(name, error))
}
