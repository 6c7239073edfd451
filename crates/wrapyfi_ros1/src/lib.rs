//! ROS 1 over the network: topics, services and parameters of a running `roscore`, with nothing of
//! ROS 1 installed here.
//!
//! ```text
//!                      master (roscore)
//!        register, look up ▲      │ publisherUpdate, paramUpdate
//!   ┌──────────────────────┴──────▼──────────────────────────┐
//!   │ Node: endpoints by name     slave API (XML-RPC)        │
//!   └──▲─────────────────────────────────────────────────────┘
//!      │ one TCPROS connection for each pair of publisher and listener, for each call under way
//!   Ros1Listener ◀═══ publishers      Ros1Publisher ═══▶ subscribers      Ros1Client, Ros1Server
//! ```
//!
//! One instance is one node of ROS 1. Its sockets live on two threads of a runtime of their own; a
//! publisher writes to its subscribers on the caller's thread as long as they keep up.
//!
//! | module | one idea |
//! | --- | --- |
//! | `config`, `names` | environment and settings; what names mean |
//! | `header`, `xmlrpc`, `splitter` | bytes of connections, without sockets |
//! | `http`, `master`, `slave` | XML-RPC: calls, the master's API, ours |
//! | `core`, `node`, `registrations`, `registrar` | what connections need; the endpoints; what the master should know, and that it does |
//! | `tcpros`, `welcome` | connections: opened, accepted, refused; to whom one belongs that others open |
//! | `whereabouts` | which machines the addresses of other nodes mean |
//! | `listener_connections`, `listener` | a topic received |
//! | `publisher`, `publication`, `subscriber` | a topic sent, all publishers of it here, one subscriber |
//! | `services`, `service_host`, `server`, `client` | services |
//! | `action_client`, `client_goals`, `action_server`, `server_goals` | actions of actionlib: goals sent, and what becomes of them; goals taken |
//! | `action_topics`, `action_messages` | their five topics, and the messages there |
//! | `parameters` | properties |
//! | `node_parameters` | parameters of other nodes, dynamic_reconfigure's too, as nodes of ROS 2 offer theirs |
//! | `conversion` | messages of any type as payloads |
//! | `discovery`, `presence`, `marks` | what other nodes have, whether they live, what bridges made |
//! | `learn`, `peer_types`, `goal_probes` | the types of it; nodes asked for what the master does not tell |

mod action_client;
mod action_messages;
mod action_server;
mod action_topics;
mod body;
mod client;
mod client_goals;
mod config;
mod conversion;
mod core;
pub mod differences;
mod discovery;
mod goal_probes;
pub mod header;
mod http;
mod learn;
mod listener;
mod listener_connections;
mod marks;
mod master;
mod names;
mod node;
mod node_parameters;
#[cfg(feature = "fuzzing")]
pub mod offline;
mod parameters;
mod peer_types;
mod presence;
mod publication;
mod publisher;
mod recall;
mod registrar;
mod registrations;
#[cfg(feature = "driver")]
mod section;
mod server;
mod server_goals;
mod service_host;
mod services;
mod slave;
mod source;
mod splitter;
mod subscriber;
mod tcpros;
mod welcome;
mod whereabouts;
pub mod xmlrpc;

use std::sync::Arc;
use std::time::Duration;

use tokio::runtime::{Builder, Runtime};
use tokio::time::timeout;
use wrapyfi_interfaces::parser::TypeName;
use wrapyfi_interfaces::ros1::{PairError, Types};
use wrapyfi_interfaces::store::{ResolvedType, TypeStore};

pub use config::{MASTER_PORT, NAME, Ros1Config, Ros1ConfigError, is_anonymous};
pub use master::MasterError;
pub use names::{NodeName, Ros1NameError, check_name};
#[cfg(feature = "driver")]
pub use section::{DRIVER, observe};

use self::config::{NodeUri, Resolved};
use self::core::Core;
use self::goal_probes::GoalProbes;
use self::node::Node;
use self::node_parameters::{ParameterEvents, ParameterServiceClient, SharedParameters};
use self::tcpros::Port;
pub use source::source;
use wrapyfi_data::types::{RosAction, ServiceKind};
use wrapyfi_endpoint::restart::restarted;
use wrapyfi_endpoint::{
    ActionClient, ActionServer, ActionSpec, Builder as SettingsBuilder, Cause, Client, Context,
    Conventions, DiscoverError, Discovered, Discovery, LearnError, LearnResult, Learned, Listener,
    Middleware, MiddlewareSettings, NameService, OpenError, OpenResult, Opened, Peers, Publisher,
    Role, RoutingProperties, Server, ServiceSpec, StartError, TopicSpec,
};

/// Names of the options of a topic that are read here: what a configuration may write.
pub const OPTIONS: &[&str] = &[Peers::FROM, Peers::TO, action_client::PREEMPTED];

/// Conventions of ROS 1, where `set_parameters` and its like are dynamic_reconfigure's.
pub const CONVENTIONS: Conventions = Conventions {
    has_text_type: true,
    has_ros_names: true,
    node_services: &[&["get_loggers", "set_logger_level"]],
    name_service: Some(NameService {
        knows_listeners: true,
        address_variable: "ROS_IP",
        server_variable: Some("ROS_MASTER_URI"),
        clean: "rosnode cleanup",
        find: None,
    }),
    program: "a ROS 1 node",
    ..Conventions::NONE
};

/// Threads on which the sockets live: one more than a topic that is large can keep busy.
const THREADS: usize = 2;
/// Longest time in which the node says goodbye to the master and sends its last messages.
const GOODBYE: Duration = Duration::from_millis(1500);

/// Node of ROS 1 with the endpoints of this program.
///
/// Dropping it tells the master, sends what is queued, and closes all connections, within two seconds.
pub struct Ros1 {
    node: Arc<Node>,
    /// Servers of actions that are asked for the type of their goals.
    probes: GoalProbes,
    /// Parameters of other nodes.
    parameters: SharedParameters,
    /// `None` once it is dropped.
    runtime: Option<Runtime>,
}

/// A node that the master has under the name of a topic or service.
///
/// See [`Ros1::registered`], which lists them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Registered {
    /// Role of the node there.
    pub role: Role,
    /// Name of the node.
    pub node: String,
    /// Host that the node announced, or its address where that is known here.
    pub host: String,
    /// Port of the node's XML-RPC server, or of the service.
    pub port: u16,
}

/// Error of starting ROS 1.
///
/// ```
/// use wrapyfi_ros1::{Ros1, Ros1Config};
/// let node = Some("no name".to_owned());
/// let error = Ros1::start(&Ros1Config { node, ..Ros1Config::default() }).err().unwrap();
/// assert!(error.is_hopeless()); // no later try can succeed
/// assert!(error.to_string().starts_with("ROS 1 name \"no name\" is not valid: "));
/// ```
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Ros1Error {
    /// The settings cannot work.
    #[error(transparent)]
    Config(#[from] Ros1ConfigError),
    /// The system gave no socket or no thread.
    #[error("ROS 1 could not start: {0}")]
    System(#[from] std::io::Error),
}

impl Ros1Error {
    /// True when no later try can succeed, because the settings are wrong.
    pub fn is_hopeless(&self) -> bool {
        matches!(self, Self::Config(error) if !matches!(error, Ros1ConfigError::Host { .. }))
    }
}

impl Ros1 {
    /// Opens the node's two ports and begins to look for the master, which need not run yet.
    ///
    /// # Errors
    /// When the settings cannot work, or the system gives no sockets.
    #[doc(hidden)]
    pub fn start(config: &Ros1Config) -> Result<Self, Ros1Error> {
        let Resolved { master, node, advertised, bind, afar } = config.resolve()?;
        let whereabouts = whereabouts::Whereabouts::new(config.hosts.clone(), afar);
        let runtime = Builder::new_multi_thread()
            .worker_threads(THREADS)
            .thread_name("wrapyfi-ros1")
            .enable_all()
            .build()?;
        let (api_socket, api_port) = runtime.block_on(Port::bind(bind, config.connections))?;
        let (data_socket, data_port) = runtime.block_on(Port::bind(bind, config.connections))?;
        let api = NodeUri { host: advertised.clone(), port: api_port };
        let data = NodeUri { host: advertised, port: data_port };
        let master = master::Master::new(master, node.full(), &api.to_string(), whereabouts);
        let (handle, rules) = (runtime.handle().clone(), config.mapping_rules.clone());
        let node = Node::new(Core::new(node, master, api, data, handle, rules));
        let (answers, accepting) = (Arc::downgrade(&node), Arc::downgrade(&node));
        runtime.spawn(restarted(
            "the XML-RPC port of this ROS 1 node".to_owned(),
            |_| {},
            move || {
                let node = answers.clone();
                let answer = move |call, peer| slave::answer(&node, call, peer);
                http::serve(Arc::clone(&api_socket), Arc::new(answer))
            },
        ));
        runtime.spawn(restarted(
            "the TCPROS port of this ROS 1 node".to_owned(),
            |_| {},
            move || welcome::accept(Arc::clone(&data_socket), accepting.clone()),
        ));
        let (registering, told) = (Arc::clone(&node), Arc::clone(&node));
        runtime.spawn(restarted(
            "the registration of this ROS 1 node".to_owned(),
            move |what| told.set_fault(Some(Cause::Restarting(what))),
            move || registrar::keep(Arc::clone(&registering)),
        ));
        tracing::info!(node = node.name.full(), master = %node.master.uri, "ROS 1: node started");
        if let Some(cause) = node.core.announces_loopback(None) {
            tracing::warn!(node = node.name.full(), "ROS 1: {cause}");
        }
        let (probes, parameters) = (GoalProbes::default(), SharedParameters::default());
        Ok(Self { node, probes, parameters, runtime: Some(runtime) })
    }

    /// Absolute name of the node.
    pub fn node_name(&self) -> &str {
        self.node.name.full()
    }

    /// Address of the node's XML-RPC server, as the master tells others.
    pub fn api_uri(&self) -> String {
        self.node.api.to_string()
    }

    /// Nodes that the master has under the name of a topic, service or action, each with the host and port at which
    /// others reach it; of an action those that publish its status. Blocks until the master has answered.
    ///
    /// # Errors
    /// When the master does not answer.
    #[doc(hidden)]
    pub fn registered(&self, name: &str) -> Result<Vec<Registered>, MasterError> {
        let master = &self.node.master;
        self.node.handle.block_on(async {
            let state = master.system_state().await?;
            let mut found = Vec::new();
            let status = format!("{name}/status");
            for (role, owners, name) in [
                (Role::Publisher, &state.publishers, name),
                (Role::Listener, &state.subscribers, name),
                (Role::Server, &state.services, name),
                (Role::ActionServer, &state.publishers, &status),
            ] {
                let nodes = owners.iter().filter(|(known, _)| *known == name);
                for node in nodes.flat_map(|(_, nodes)| nodes.clone()) {
                    let at = match role {
                        Role::Server => master.lookup_service(name).await?,
                        _ => master.lookup_node(&node).await?,
                    };
                    found.extend(at.map(|at| Registered {
                        role,
                        node,
                        host: at.host,
                        port: at.port,
                    }));
                }
            }
            Ok(found)
        })
    }

    /// True where the nodes at the master take the time from `/clock`: its `use_sim_time` is true. Blocks until the master
    /// has answered, and is false where it does not.
    #[must_use]
    #[doc(hidden)]
    pub fn simulates_time(&self) -> bool {
        let asked = self.node.handle.block_on(self.node.master.get_param("/use_sim_time"));
        matches!(asked, Ok(Some(xmlrpc::Value::Boolean(true))))
    }

    /// False where the API of a node says nothing for as long as `max_wait`: it hangs, or is stopped. Blocks until then.
    #[must_use]
    pub fn answers_within(&self, max_wait: Duration, node: &str) -> bool {
        let caller = vec![xmlrpc::text(self.node.name.full())];
        let asked = async {
            if let Ok(Some(uri)) = self.node.master.lookup_node(node).await {
                // A refusal is an answer, too.
                _ = http::call(&uri, "getPid", caller).await;
            }
        };
        let answered = async { tokio::time::timeout(max_wait, asked).await };
        self.node.handle.block_on(answered).is_ok()
    }

    /// The ROS 2 type `name`: as installed, else made from what a publisher that was asked has shown, a
    /// folder of ROS 1 packages has, or is standard.
    ///
    /// # Errors
    /// When no program has it, or a definition is there and cannot be used.
    #[doc(hidden)]
    pub fn type_named(&self, name: &TypeName) -> Result<ResolvedType, PairError> {
        self.node.types().ros2_type_named(name)
    }

    /// Definitions that this node knows, with those that publishers have shown it.
    #[doc(hidden)]
    pub fn with_types<T>(&self, ask: impl FnOnce(&mut Types) -> T) -> T {
        ask(&mut self.node.types())
    }

    /// Address of the master.
    #[doc(hidden)]
    pub fn master_uri(&self) -> String {
        self.node.master.uri.to_string()
    }

    /// Names of all parameters at the master, without the marks of bridges. Blocks until the master has answered.
    ///
    /// # Errors
    /// When the master does not answer.
    #[doc(hidden)]
    pub fn parameter_names(&self) -> Result<Vec<String>, MasterError> {
        let names = self.node.handle.block_on(self.node.master.param_names())?;
        let is_mark = |name: &String| name.starts_with(marks::NAMESPACE);
        Ok(names.into_iter().filter(|name| !is_mark(name)).collect())
    }

    /// Name on ROS 1 of the type that the publisher or server of an endpoint has told; `None` while it has not.
    #[doc(hidden)]
    pub fn told_type(&self, found: &Discovered) -> Option<String> {
        learn::told_type(&self.node.core, found)
    }

    fn resolve(&self, name: &str) -> OpenResult<String> {
        self.node
            .name
            .resolve(name)
            .map_err(|error| OpenError::invalid_name(NAME, name, error.reason))
    }
}

impl MiddlewareSettings for Ros1Config {
    type Middleware = Ros1;

    fn start(&self) -> Result<Ros1, StartError> {
        let is_absent = |error: &Ros1Error| matches!(error, Ros1Error::Config(_));
        Ros1::start(self)
            .map_err(|error| StartError::of(&error, error.is_hopeless(), is_absent(&error)))
    }
}

/// ROS 1 as the node `node`, at the master that `ROS_MASTER_URI` names.
pub fn ros1(node: &str) -> SettingsBuilder<Ros1Config> {
    let settings = Ros1Config::from_env().map_err(StartError::refused);
    SettingsBuilder::new(settings).with(|settings| settings.node = Some(node.to_owned()))
}

impl Middleware for Ros1 {
    fn network(&self) -> Option<String> {
        let master = &self.node.master.uri;
        Some(wrapyfi_endpoint::network::server_text(&master.host, master.port))
    }

    fn name(&self) -> &str {
        NAME
    }

    fn open_listener(&self, spec: &TopicSpec, context: &Context) -> Opened<dyn Listener> {
        let topic = self.resolve(&spec.topic)?;
        if let Some(events) =
            ParameterEvents::open(&self.parameters, &self.node, &topic, spec, context)
        {
            return Ok(Box::new(events));
        }
        Ok(match conversion::wanted(&self.node, spec.message_type) {
            Some(wire_type) => {
                let node = &self.node;
                Box::new(listener::Ros1Listener::open(node, &topic, wire_type, spec, context)?)
            }
            None => {
                Peers::none(&spec.options, NAME, &topic)?;
                Box::new(parameters::ParameterListener::open(&self.node, &topic, spec, context))
            }
        })
    }

    fn open_publisher(&self, spec: &TopicSpec, context: &Context) -> Opened<dyn Publisher> {
        let topic = self.resolve(&spec.topic)?;
        Ok(match conversion::offered(&self.node, spec)? {
            Some(offer) => {
                let node = &self.node;
                Box::new(publisher::Ros1Publisher::open(node, &topic, offer, spec, context)?)
            }
            None => {
                Peers::none(&spec.options, NAME, &topic)?;
                Box::new(parameters::ParameterPublisher::open(&self.node, &topic, spec, context))
            }
        })
    }

    fn open_client(&self, spec: &ServiceSpec, context: &Context) -> Opened<dyn Client> {
        let service = self.resolve(&spec.service)?;
        Peers::none(&spec.options, NAME, &service)?;
        let (node, parameters) = (&self.node, &self.parameters);
        let here = ParameterServiceClient::open(parameters, node, &service, spec, context);
        if let Some(client) = here {
            return Ok(Box::new(client));
        }
        Ok(Box::new(client::Ros1Client::open(&self.node, &service, spec, context)?))
    }

    fn open_server(&self, spec: &ServiceSpec, context: &Context) -> Opened<dyn Server> {
        let service = self.resolve(&spec.service)?;
        Peers::none(&spec.options, NAME, &service)?;
        Ok(Box::new(server::Ros1Server::open(&self.node, &service, spec, context)?))
    }

    fn open_action_client(&self, spec: &ActionSpec, context: &Context) -> Opened<dyn ActionClient> {
        let action = self.resolve(&spec.action)?;
        Peers::none(&spec.options, NAME, &action)?;
        Ok(Box::new(action_client::Ros1ActionClient::open(&self.node, action, spec, context)?))
    }

    fn open_action_server(&self, spec: &ActionSpec, context: &Context) -> Opened<dyn ActionServer> {
        let action = self.resolve(&spec.action)?;
        Peers::none(&spec.options, NAME, &action)?;
        Ok(Box::new(action_server::Ros1ActionServer::open(&self.node, action, spec, context)?))
    }

    fn discover(&self) -> Result<Box<dyn Discovery>, DiscoverError> {
        Ok(Box::new(discovery::Ros1Discovery::new(&self.node)))
    }

    fn routing_properties(&self) -> RoutingProperties {
        RoutingProperties {
            any_ros_type: true,
            ros_time: true,
            tells_own: true,
            shows_marks: true,
            subscribes_first: true,
            action_topics: &["goal", "cancel", "status", "feedback", "result"],
            ..RoutingProperties::default()
        }
    }

    fn learn_topic(&self, found: &Discovered, types: &mut TypeStore) -> LearnResult<Learned> {
        learn::topic(&self.node.core, found, types)
    }

    fn learn_service(&self, found: &Discovered, types: &mut TypeStore) -> LearnResult<ServiceKind> {
        learn::service(&self.node.core, found, types)
    }

    fn learn_action(&self, found: &Discovered, types: &mut TypeStore) -> LearnResult<RosAction> {
        let learned = learn::action(&self.node.core, found, types);
        match &learned {
            Ok(_) => self.probes.end(&found.name),
            Err(LearnError::Undefined { .. }) if self.probes.ask(&self.node, &found.name) => {
                return Err(LearnError::Asked(found.name.clone()));
            }
            Err(_) => {}
        }
        learned
    }

    fn ended(&self) -> Option<Cause> {
        self.node.state().ended.clone()
    }

    fn keeps_last(&self, found: &Discovered) -> Option<bool> {
        learn::latches(&self.node.core, found)
    }

    fn waiting_for(&self) -> Option<Cause> {
        self.node.fault()
    }
}

impl Drop for Ros1 {
    fn drop(&mut self) {
        let Some(runtime) = self.runtime.take() else { return };
        let node = Arc::clone(&self.node);
        node.end("this program has ended its ROS 1 node".to_owned());
        // A thread of its own: the owner's may belong to a runtime, which must not block.
        let end =
            std::thread::Builder::new().name("wrapyfi-ros1-end".to_owned()).spawn(move || {
                runtime.block_on(async {
                    let goodbye = async {
                        node.lingering.closed().await;
                        registrar::leave(&node).await;
                    };
                    if timeout(GOODBYE, goodbye).await.is_err() {
                        tracing::warn!("ROS 1: ended before the master and all subscribers knew");
                    }
                });
                runtime.shutdown_timeout(Duration::from_millis(200));
            });
        if let Ok(end) = end {
            _ = end.join();
        }
    }
}

impl std::fmt::Debug for Ros1 {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Ros1")
            .field("node", &self.node.name.full())
            .field("master", &self.node.master.uri.to_string())
            .finish_non_exhaustive()
    }
}
