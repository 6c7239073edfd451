//! From a configuration to middlewares that run.
//!
//! ```text
//!   bridge.yaml ─ load ─▶ Endpoints + Plan ─ Middlewares::for_plan ─▶ Registry
//!   endpoint on the command line ────────── Middlewares::for_endpoint ─▶ Registry
//! ```
//!
//! The only place that knows which middlewares exist. Those that no route uses are not started.

use std::collections::{BTreeMap, BTreeSet};
use std::net::IpAddr;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use serde::Deserialize;
use wrapyfi_core::Limits;
use wrapyfi_core::endpoint::{EndpointAddress, Middleware, Registry};
use wrapyfi_core::engine::{
    Available, Config, ConfigError, MAX_CONFIG_BYTES, Plan, Problem, Spanned,
};
use wrapyfi_core::middleware::ros1::{self, Ros1, Ros1Config};
use wrapyfi_core::middleware::ros2::graph::Graph;
use wrapyfi_core::middleware::ros2::{
    self, CycloneConfig, CycloneGraph, NodeEndpoints, NodeHandle, Ros2,
};
use wrapyfi_core::middleware::yarp;
use wrapyfi_core::middleware::zeromq::{self, BrokerMode, ZeroMq, ZeroMqConfig};
use wrapyfi_core::node::parameters::ParameterStore;
use wrapyfi_core::types::MessageType;

use wrapyfi_interfaces::parser::{Dialect, TypeName};
use wrapyfi_interfaces::store::TypeStore;

use crate::cli::ServicePorts;
use crate::command::any;
use crate::exit::Failure;
use crate::logging;
use crate::node::Node;
use crate::yarp::YarpSection;

/// How long publishers on ROS 1 have to show the types that nobody here has.
const LEARNING: Duration = Duration::from_secs(5);

/// Names under which routes and commands address the middlewares, with their rules for topics.
fn available() -> [Available<'static>; 4] {
    [
        Available { name: "zeromq", check_topic: &zeromq::check_topic, options: &[] },
        Available { name: "ros2", check_topic: &check_ros_topic, options: &[] },
        Available { name: ros1::NAME, check_topic: &ros1::check_name, options: &[] },
        Available { name: yarp::NAME, check_topic: &yarp::check_topic, options: yarp::OPTIONS },
    ]
}

/// The rules do not depend on the node: any will do.
fn check_ros_topic(topic: &str) -> Result<(), String> {
    let check = || Node::bridge()?.name().expand(topic);
    check().map(drop).map_err(|error| error.to_string())
}

/// The `endpoints` section of a configuration: how each middleware is reached.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Endpoints {
    /// The ZeroMQ broker.
    pub zeromq: ZeroMqSection,
    /// The ROS 2 graph.
    pub ros2: Ros2Section,
    /// The ROS 1 master.
    pub ros: Ros1Section,
    /// YARP's name server, and our ports.
    pub yarp: YarpSection,
}

/// `endpoints.zeromq`; what is left out comes from the `WRAPYFI_ZEROMQ_*` variables, else from
/// Wrapyfi's defaults.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[allow(missing_docs)] // config/example.yaml is the manual
pub struct ZeroMqSection {
    pub ip: Option<Spanned<String>>,
    pub pub_port: Option<u16>,
    pub sub_port: Option<u16>,
    pub rep_port: Option<u16>,
    pub req_port: Option<u16>,
    pub broker: Option<BrokerWord>,
    pub monitor_topic: Option<String>,
    pub send_hwm: Option<u16>,
    pub insecure: bool,
}

/// Who runs the broker.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs)]
pub enum BrokerWord {
    Embedded,
    Foreign,
}

/// `endpoints.ros2`; what is left out comes from the ROS 2 environment variables.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[allow(missing_docs)] // config/example.yaml is the manual
pub struct Ros2Section {
    pub domain_id: Option<u32>,
    pub interface: Option<String>,
}

/// `endpoints.ros`; what is left out comes from `ROS_MASTER_URI`, `ROS_HOSTNAME`, `ROS_IP` and
/// `ROS_NAMESPACE`.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[allow(missing_docs)] // config/example.yaml is the manual
pub struct Ros1Section {
    pub master_uri: Option<String>,
    pub hostname: Option<String>,
    pub namespace: Option<String>,
    pub node: Option<String>,
    pub remap: BTreeMap<String, String>,
    pub insecure: bool,
}

/// A configuration that was read and checked.
#[derive(Debug)]
pub struct Loaded {
    /// How each middleware is reached.
    pub endpoints: Endpoints,
    /// The routes.
    pub plan: Plan,
    /// Where their types come from.
    pub types: TypeStore,
}

/// Reads and checks a configuration file.
///
/// # Errors
/// Exit code 2 with every fault, each with its line.
pub fn load(file: &Path) -> Result<Loaded, Failure> {
    load_with(file, |_, _| Ok(()))
}

/// As [`load`]; types of routes from ROS 1 that nobody here has are asked from their publishers.
///
/// # Errors
/// As [`load`], and exit code 1 when ROS 1 does not start.
pub fn load_and_learn(file: &Path) -> Result<Loaded, Failure> {
    load_with(file, learn)
}

/// Asks the publishers on ROS 1 for what no place of definitions has.
fn learn(config: &Config<Endpoints>, types: &mut TypeStore) -> Result<(), Failure> {
    let mut node = None;
    let begin = Instant::now();
    for entry in &config.routes {
        let route = &entry.value;
        let Some((ros1::NAME, topic)) =
            route.from.as_ref().and_then(|from| from.value.split_once(':'))
        else {
            continue;
        };
        let wanted = route.from_type.as_ref().unwrap_or(&route.message_type);
        if MessageType::resolve(&wanted.value, types).is_ok() {
            continue;
        }
        let Ok(name) = TypeName::parse(Dialect::Ros2, &wanted.value) else { continue };
        let ros1 = match &mut node {
            Some(ros1) => ros1,
            none => none.insert(start_ros1(&config.endpoints.ros)?),
        };
        match ros1.learn(topic, &name, LEARNING.saturating_sub(begin.elapsed())) {
            Ok(found) => {
                tracing::info!("{name} is what a publisher of ros:{topic} shows");
                types.add_resolved(&found);
            }
            Err(error) => tracing::warn!("{error}"),
        }
    }
    Ok(())
}

fn load_with(
    file: &Path,
    learn: impl FnOnce(&Config<Endpoints>, &mut TypeStore) -> Result<(), Failure>,
) -> Result<Loaded, Failure> {
    let name = file.display().to_string();
    let size =
        std::fs::metadata(file).map_err(|error| Failure::usage(format!("{name}: {error}")))?;
    if size.len() > MAX_CONFIG_BYTES as u64 {
        let text = format!("{name}: {} bytes long, the limit is {MAX_CONFIG_BYTES}", size.len());
        return Err(Failure::usage(text));
    }
    let text = std::fs::read_to_string(file)
        .map_err(|error| Failure::usage(format!("{name}: {error}")))?;
    let config: Config<Endpoints> = Config::from_yaml(&text, &name).map_err(Failure::usage)?;
    check_zeromq(&config.endpoints.zeromq)
        .and_then(|()| config.endpoints.yarp.check())
        .map_err(|problem| ConfigError { file: name.clone(), problems: vec![problem] })
        .map_err(Failure::usage)?;
    // As seen from the file, wherever the program was started.
    let beside = file.parent().unwrap_or(Path::new(""));
    let folders: Vec<_> =
        config.definitions.iter().map(|folder| beside.join(&folder.value)).collect();
    let mut types = any::definitions(&folders)
        .map_err(|failure| Failure::Usage(format!("{name}: definitions {failure}")))?;
    learn(&config, &mut types)?;
    let plan = Plan::new(&config, &available(), &mut types, &name).map_err(Failure::usage)?;
    Ok(Loaded { endpoints: config.endpoints, plan, types })
}

/// An address that other machines reach is refused before anything starts.
fn check_zeromq(section: &ZeroMqSection) -> Result<(), Problem> {
    match &section.ip {
        Some(ip) if !section.insecure => match ip.value.parse::<IpAddr>() {
            Ok(address) if !address.is_loopback() => Err(Problem::at(
                ip.referenced,
                format!(
                    "ip {address} is open to other machines, and nothing is encrypted there; use \
                     127.0.0.1, or write insecure: true"
                ),
            )),
            _ => Ok(()),
        },
        _ => Ok(()),
    }
}

/// Which end of a topic a command is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// It listens: Wrapyfi's listeners never start a broker.
    Listener,
    /// It publishes: Wrapyfi's publishers start the broker when there is none.
    Publisher,
    /// It calls: Wrapyfi's clients never start a broker.
    Client,
    /// It serves: Wrapyfi's servers start the broker of requests where there is none.
    Server,
}

/// Middlewares at work.
#[derive(Default)]
pub struct Middlewares {
    registry: Registry,
    /// The graph of the ROS 2 node, where there is one.
    graph: Option<Arc<dyn Graph>>,
}

impl Middlewares {
    /// The middlewares that `plan` uses, as the ROS 2 node `node`.
    ///
    /// # Errors
    /// Exit code 2 for settings that cannot work, 1 when one does not start.
    pub fn for_plan(endpoints: &Endpoints, plan: &Plan, node: &Node) -> Result<Self, Failure> {
        let largest = plan.largest_message();
        let mut middlewares = Self::default();
        if plan.uses("zeromq") {
            let zeromq = start_zeromq(&endpoints.zeromq, None, largest)?;
            let ends = plan.services.iter().flat_map(|route| [&route.offered, &route.service]);
            if ends.into_iter().any(|end| end.middleware == "zeromq") {
                // A server of Wrapyfi's that was told not to start one relies on it.
                zeromq.start_services().context("zeromq")?;
            }
            middlewares.add(Arc::new(zeromq));
        }
        if plan.uses(yarp::NAME) {
            middlewares.add(Arc::new(endpoints.yarp.start(largest)?));
        }
        if plan.uses(ros1::NAME) {
            middlewares.add(Arc::new(start_ros1(&endpoints.ros)?));
        }
        if plan.uses("ros2") {
            let ros2 = start_ros2(&endpoints.ros2, node, largest)?;
            middlewares.graph = Some(Arc::clone(ros2.graph()));
            middlewares.add(Arc::new(ros2));
        }
        Ok(middlewares)
    }

    /// What the node has beside its topics: parameters, descriptions of the types that are named, log,
    /// clock.
    /// It ends with the result; nothing where no route is on ROS 2.
    ///
    /// # Errors
    /// Exit code 1 when the DDS stack refuses.
    pub fn offer_node(
        &self,
        node: &Node,
        parameters: ParameterStore,
        types: (&mut TypeStore, &BTreeSet<&'static str>),
    ) -> Result<Option<OfferedNode>, Failure> {
        let Some(graph) = &self.graph else { return Ok(None) };
        let offered = NodeEndpoints::start(graph, parameters).context("ros2")?;
        let (store, names) = types;
        offered.handle().types(|described| {
            for name in names {
                if let Err(error) = described.add_named(store, name) {
                    tracing::warn!("{name} is not described: {error}");
                }
            }
        });
        if node.logs_to_rosout() {
            logging::publish_to(Some(offered.handle().clone()));
        }
        Ok(Some(OfferedNode(offered)))
    }

    /// The one middleware that `address` names, for a command.
    ///
    /// # Errors
    /// As [`Middlewares::for_plan`].
    pub fn for_endpoint(address: &EndpointAddress, role: Role) -> Result<Self, Failure> {
        let mut middlewares = Self::default();
        let endpoints = Endpoints::default();
        let largest = Limits::default().message_bytes;
        match address.middleware.as_str() {
            "zeromq" => {
                middlewares.add(Arc::new(start_zeromq(&endpoints.zeromq, Some(role), largest)?));
            }
            "ros2" => {
                middlewares.add(Arc::new(Self::ros2_of_command()?));
            }
            yarp::NAME => middlewares.add(Arc::new(endpoints.yarp.start(largest)?)),
            ros1::NAME => middlewares.add(Arc::new(start_ros1(&endpoints.ros)?)),
            other => {
                let text = format!(
                    "middleware {other:?} is not available; available: {}",
                    available().map(|known| known.name).join(", ")
                );
                return Err(Failure::Usage(text));
            }
        }
        Ok(middlewares)
    }

    /// As [`Middlewares::for_endpoint`], with the ports of requests and replies that were given.
    ///
    /// # Errors
    /// As [`Middlewares::for_plan`].
    pub fn for_service(
        address: &EndpointAddress,
        role: Role,
        ports: &ServicePorts,
    ) -> Result<Self, Failure> {
        if address.middleware != "zeromq" {
            if ports.any() {
                let text = format!("{address}: --rep-port and --req-port are for zeromq");
                return Err(Failure::Usage(text));
            }
            return Self::for_endpoint(address, role);
        }
        let ServicePorts { rep_port, req_port } = *ports;
        let section = ZeroMqSection { rep_port, req_port, ..ZeroMqSection::default() };
        let mut middlewares = Self::default();
        let largest = Limits::default().message_bytes;
        middlewares.add(Arc::new(start_zeromq(&section, Some(role), largest)?));
        Ok(middlewares)
    }

    /// ROS 2 as the hidden node of a command.
    ///
    /// # Errors
    /// As [`Middlewares::for_plan`].
    pub fn ros2_of_command() -> Result<Ros2, Failure> {
        let node = Node::hidden().map_err(Failure::usage)?;
        start_ros2(&Ros2Section::default(), &node, Limits::default().message_bytes)
    }

    /// Only `ros2`.
    #[must_use]
    pub fn with_ros2(ros2: Arc<Ros2>) -> Self {
        let mut middlewares = Self::default();
        middlewares.add(ros2);
        middlewares
    }

    /// Names of all that there are.
    #[must_use]
    pub fn names() -> Vec<&'static str> {
        available().map(|known| known.name).into()
    }

    /// The middlewares by name.
    #[must_use]
    pub fn registry(&self) -> &Registry {
        &self.registry
    }

    fn add(&mut self, middleware: Arc<dyn Middleware>) {
        self.registry.register(middleware);
    }
}

/// The node's own endpoints; they end with it.
pub struct OfferedNode(NodeEndpoints);

impl OfferedNode {
    /// The node as the rest of the program uses it.
    #[must_use]
    pub fn handle(&self) -> &NodeHandle {
        self.0.handle()
    }
}

impl Drop for OfferedNode {
    fn drop(&mut self) {
        logging::publish_to(None);
    }
}

fn start_zeromq(
    section: &ZeroMqSection,
    role: Option<Role>,
    largest_message: usize,
) -> Result<ZeroMq, Failure> {
    let config = match role {
        Some(Role::Client) => ZeroMqConfig::from_env_of_client(),
        _ => ZeroMqConfig::from_env(),
    };
    let mut config = config.map_err(Failure::usage)?;
    if let Some(ip) = &section.ip {
        config.ip.clone_from(&ip.value);
    }
    if let Some(topic) = &section.monitor_topic {
        config.monitor_topic.clone_from(topic);
    }
    config.pub_port = section.pub_port.unwrap_or(config.pub_port);
    config.sub_port = section.sub_port.unwrap_or(config.sub_port);
    config.rep_port = section.rep_port.unwrap_or(config.rep_port);
    config.req_port = section.req_port.unwrap_or(config.req_port);
    config.send_hwm = section.send_hwm.unwrap_or(config.send_hwm);
    config.insecure |= section.insecure;
    config.max_frame_bytes = config.max_frame_bytes.max(largest_message);
    match section.broker {
        Some(BrokerWord::Embedded) => config.broker = BrokerMode::Embedded,
        Some(BrokerWord::Foreign) => config.broker = BrokerMode::Foreign,
        None => (),
    }
    config.service_broker = match (section.broker, role) {
        (None, Some(Role::Client)) => BrokerMode::Foreign,
        (None, _) => config.service_broker,
        (Some(_), _) => config.broker,
    };
    // What a command does not use is not started for it.
    if section.broker.is_none()
        && matches!(role, Some(Role::Listener | Role::Client | Role::Server))
    {
        config.broker = BrokerMode::Foreign;
    }
    Ok(ZeroMq::start(&config).context("zeromq")?)
}

fn start_ros1(section: &Ros1Section) -> Result<Ros1, Failure> {
    let mut config = Ros1Config::from_env().map_err(Failure::usage)?;
    let Ros1Section { master_uri, hostname, namespace, node, remap, insecure } = section.clone();
    config.master_uri = master_uri.unwrap_or(config.master_uri);
    config.hostname = hostname.or(config.hostname);
    config.namespace = namespace.unwrap_or(config.namespace);
    config.node = node.or(config.node);
    config.remaps = remap.into_iter().collect();
    config.insecure |= insecure;
    Ros1::start(&config).map_err(|error| match error {
        ros1::StartError::Config(error) => Failure::usage(error),
        other => anyhow::Error::new(other).context("ros").into(),
    })
}

fn start_ros2(section: &Ros2Section, node: &Node, largest_message: usize) -> Result<Ros2, Failure> {
    let environment =
        ros2::environment::read(|name| std::env::var(name).ok()).map_err(Failure::usage)?;
    environment.log();
    let mut config = CycloneConfig::from_environment(node.name().clone(), &environment);
    config.domain_id = section.domain_id.unwrap_or(config.domain_id);
    config.interface.clone_from(&section.interface);
    config.max_message_bytes = largest_message;
    let graph = CycloneGraph::new(&config).context("ros2")?;
    let node = node.clone();
    let remap = move |topic: &str| node.resolve_topic(topic).map_err(|error| error.to_string());
    Ok(Ros2::new(Arc::new(graph), remap))
}

/// The three parties of the demo, each with sockets of its own.
pub struct DemoMiddlewares {
    sources: ZeroMq,
    bridge: Registry,
    viewer: Ros2,
    broker: String,
    domain_id: u32,
}

impl DemoMiddlewares {
    /// Starts the bridge's side with its embedded broker, then the sources' and the viewer's.
    ///
    /// Everything stays on this host: ROS 2 discovery is limited to it unless
    /// `ROS_AUTOMATIC_DISCOVERY_RANGE` says otherwise.
    ///
    /// # Errors
    /// Exit code 1 when a middleware does not start.
    pub fn start() -> Result<Self, Failure> {
        let mut config = ZeroMqConfig::from_env().map_err(Failure::usage)?;
        config.broker = BrokerMode::Embedded;
        let bridge_side = match ZeroMq::start(&config) {
            Ok(started) => started,
            Err(error) => {
                // Something else has Wrapyfi's ports: the demo does not need those.
                tracing::info!("{error}; the demo's broker takes free ports");
                (config.pub_port, config.sub_port) = (0, 0);
                ZeroMq::start(&config).context("zeromq")?
            }
        };
        (config.pub_port, config.sub_port) = (bridge_side.pub_port(), bridge_side.sub_port());
        config.broker = BrokerMode::Foreign;
        let broker = format!("{}:{}/{}", config.ip, config.pub_port, config.sub_port);
        let sources = ZeroMq::start(&config).context("zeromq")?;

        let graph = |name: &str| -> Result<_, Failure> {
            let lookup = |name: &str| match (name, std::env::var(name).ok()) {
                ("ROS_AUTOMATIC_DISCOVERY_RANGE", None) => Some("LOCALHOST".to_owned()),
                (_, value) => value,
            };
            let environment = ros2::environment::read(lookup).map_err(Failure::usage)?;
            let node = Node::named(name).map_err(Failure::usage)?;
            let config = CycloneConfig::from_environment(node.name().clone(), &environment);
            let graph = CycloneGraph::new(&config).context("ros2")?;
            let as_it_is = |topic: &str| Ok(topic.to_owned());
            Ok((Ros2::new(Arc::new(graph), as_it_is), environment.domain_id))
        };
        let (ros2, domain_id) = graph("wrapyfi_demo")?;
        let (viewer, _) = graph("wrapyfi_demo_viewer")?;
        let mut bridge = Registry::new();
        bridge.register(Arc::new(bridge_side));
        bridge.register(Arc::new(ros2));
        Ok(Self { sources, bridge, viewer, broker, domain_id })
    }

    /// What the sources publish on.
    #[must_use]
    pub fn sources(&self) -> &dyn Middleware {
        &self.sources
    }

    /// What the routes use.
    #[must_use]
    pub fn bridge(&self) -> &Registry {
        &self.bridge
    }

    /// What the viewer listens on.
    #[must_use]
    pub fn viewer(&self) -> &dyn Middleware {
        &self.viewer
    }

    /// Address and ports of the broker.
    #[must_use]
    pub fn broker(&self) -> &str {
        &self.broker
    }

    /// DDS domain of the demo.
    #[must_use]
    pub fn domain_id(&self) -> u32 {
        self.domain_id
    }
}
