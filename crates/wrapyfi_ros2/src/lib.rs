//! ROS 2 topics over CycloneDDS.
//!
//! ```text
//!   Ros2 (Middleware) ─ names ─ listener (receive_path), publisher: payload <-> CDR
//!     │
//!     │                 origins: writers of publishers that keep their last message
//!     │                 parameters: those of other nodes
//!     │                 follow, matching, diagnosis, replays: quality of service that fits the peers
//!   graph               the trait: CDR bytes and discovery facts
//!     │                 discovery: topics and services of others, owners: whose they are
//!     │
//!   cyclone_graph ───── peer_index, discovery_info, domain, config ◀── environment
//!     │                 pacing: large messages to Fast DDS nodes
//!     │
//!   cyclone             the only modules that call C
//!
//!   rmw_graph ───────── rmw_endpoints: the middleware of an installed ROS 2, over wrapyfi_rmw
//!
//!   rosidl ──────────── structs of the crates that rosidl_generator_rs writes, over the same
//!
//!   rust_services ───── services as Fast DDS has them, on RustDDS
//!
//!   service: services of any type, by the bytes of requests and replies
//!   action: actions of any type, by their services and topics
//!   other_node: nodes of other middlewares that have parameters
//! ```
//!
//! A node of its own, and its topics under their ROS names:
//!
//! ```no_run
//! use std::sync::Arc;
//! use wrapyfi_endpoint::{Context, Middleware, TopicSpec};
//! use wrapyfi_ros2::{CycloneConfig, CycloneGraph, Ros2, environment};
//! use wrapyfi_node::NodeName;
//! use wrapyfi_data::types::MessageType;
//!
//! let environment = environment::read(|name| std::env::var(name).ok())?;
//! let node = NodeName::new("bridge", "/")?;
//! let graph = CycloneGraph::new(&CycloneConfig::from_environment(node, &environment))?;
//! let ros2 = Ros2::new(Arc::new(graph), |expanded| Ok(expanded.to_owned()));
//! let chatter = TopicSpec::new("chatter", MessageType::StringJson);
//! let listener = ros2.open_listener(&chatter, &Context::default())?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! A service of any ROS type is called with the fields of its definition:
//!
//! ```no_run
//! # mod wrapyfi_core { pub use {wrapyfi_data::types, wrapyfi_endpoint as endpoint}; }
//! use std::time::Duration;
//! use wrapyfi_core::endpoint::{Context, Middleware, Request, ServiceSpec};
//! use wrapyfi_core::types::{Payload, RosMessage, RosService, ServiceKind};
//! # fn example(ros2: &wrapyfi_ros2::Ros2, resolved: &wrapyfi_interfaces::store::ResolvedType)
//! # -> Result<(), Box<dyn std::error::Error>> {
//! let add = RosService::new(resolved)?; // example_interfaces/srv/AddTwoInts
//! let spec = ServiceSpec::new("add", ServiceKind::Ros(add));
//! let mut client = ros2.open_client(&spec, &Context::default())?;
//! let mut request = add.request().plan().default_message();
//! request.set("a", 2_i64)?;
//! request.set("b", 3_i64)?;
//! let request = Request::Message(RosMessage::from_fields(add.request(), &request)?);
//! if let Payload::RosMessage(reply) = client.call(&request, Duration::from_secs(5))?.payload {
//!     let fields = reply.fields(1 << 20)?;
//!     assert_eq!(fields.get("sum").and_then(|sum| sum.as_integer()), Some(5));
//! }
//! # Ok(())
//! # }
//! ```

mod action;
mod action_client;
mod action_discovery;
#[cfg(test)]
mod action_hostile_tests;
mod action_server;
#[cfg(test)]
mod action_tests;
mod adapter;
mod announcement;
mod both_mappings;
mod completeness;
mod config;
mod conventions;
mod cyclone;
mod cyclone_endpoints;
mod cyclone_graph;
mod cyclone_service;
mod dds_terms;
mod describing;
mod diagnosis;
mod discovery;
mod discovery_info;
mod domain;
pub mod environment;
mod follow;
mod gaps;
pub mod graph;
mod listener;
mod matching;
mod names;
mod node_endpoints;
mod node_handle;
#[cfg(feature = "fuzzing")]
pub mod offline;
mod origins;
mod other_node;
mod owners;
mod pacing;
mod parameters;
mod peer_index;
mod peer_names;
mod peer_relay;
mod publisher;
mod receive_path;
mod replays;
#[cfg(feature = "rmw")]
mod rmw_endpoints;
#[cfg(feature = "rmw")]
mod rmw_graph;
#[cfg(feature = "rmw")]
mod rmw_hashes;
#[cfg(feature = "rmw")]
mod rmw_marks;
#[cfg(feature = "rmw")]
mod rmw_paired;
mod ros2;
#[cfg(feature = "rosidl")]
pub mod rosidl;
#[cfg(feature = "fastdds-services")]
mod rust_services;
#[cfg(feature = "driver")]
mod section;
mod service;
mod service_header;
mod services;
mod settings;
mod source;
mod vendor;
#[cfg(test)]
mod wire_tests;

pub use adapter::{JoinError, Joined, join};
pub use config::CycloneConfig;
pub use conventions::follow_conventions;
pub use cyclone_graph::{CycloneError, CycloneGraph};
pub use diagnosis::remedy;
pub use domain::DomainError;
pub use environment::Adapter;
pub use node_endpoints::NodeEndpoints;
pub use node_handle::NodeHandle;
pub use parameters::{
    ParameterClient, ParameterClientError, ParameterResult, RemoteParameters, ServiceOptions,
};
pub use peer_names::PeerError;
pub use peer_relay::unresolved_peers;
#[cfg(feature = "rmw")]
pub use rmw_graph::RmwGraph;
pub use ros2::{NAME, Ros2};
#[cfg(feature = "fastdds-services")]
pub use rust_services::{RustServices, RustServicesError, ServiceEndpoints};
#[cfg(feature = "driver")]
pub use section::{DRIVER, Ros2Section};
pub use settings::{Ros2Settings, ros2};
pub use source::source;

use graph::GraphError;
use listener::Ros2Listener;
use other_node::OtherNodeEvents;
use parameters::{PropertiesListener, PropertiesPublisher};
use publisher::Ros2Publisher;
use wrapyfi_data::types::{MessageType, RosAction, ServiceKind};
use wrapyfi_endpoint::{
    ActionClient, ActionServer, ActionSpec, Client, Context, DiscoverError, Discovered, Discovery,
    LearnError, LearnResult, Listener, Middleware, OpenError, Opened, Publisher, Role,
    RoutingProperties, Server, ServiceSpec, TopicSpec, action_of_name,
};
use wrapyfi_interfaces::store::TypeStore;

impl Middleware for Ros2 {
    /// Programs that hear of the same name by this graph are on it.
    fn network(&self) -> Option<String> {
        Some(String::new())
    }

    fn name(&self) -> &str {
        NAME
    }

    fn follow_conventions(&self, spec: &mut TopicSpec, at_source: bool) {
        follow_conventions(spec, at_source);
    }

    fn open_listener(&self, spec: &TopicSpec, context: &Context) -> Opened<dyn Listener> {
        if spec.message_type == MessageType::Properties {
            let opened = PropertiesListener::open(self, spec, context);
            return Ok(Box::new(opened.map_err(|error| unopened(spec, error))?));
        }
        if let MessageType::Ros(kind) = spec.message_type {
            self.carries(Role::Listener, kind.resolved());
        }
        let topic = self.describe(spec)?;
        let listener = Ros2Listener::open(&self.graph, &self.names, &topic, spec, context)
            .map_err(|error| transport(spec, &error))?;
        Ok(Box::new(listener))
    }

    fn open_publisher(&self, spec: &TopicSpec, context: &Context) -> Opened<dyn Publisher> {
        if spec.message_type == MessageType::Properties {
            let opened = PropertiesPublisher::open(self, spec, context);
            return Ok(Box::new(opened.map_err(|error| unopened(spec, error))?));
        }
        if let Some(events) = OtherNodeEvents::open(self, spec, context)? {
            return Ok(Box::new(events));
        }
        if let MessageType::Ros(kind) = spec.message_type {
            self.carries(Role::Publisher, kind.resolved());
        }
        let topic = self.describe(spec)?;
        let publisher = Ros2Publisher::open(&self.graph, &self.names, &topic, spec, context)
            .map_err(|error| transport(spec, &error))?;
        Ok(Box::new(publisher))
    }

    fn open_client(&self, spec: &ServiceSpec, context: &Context) -> Opened<dyn Client> {
        if let ServiceKind::Ros(kind) = spec.kind {
            self.carries(Role::Client, kind.resolved());
        }
        Ok(Box::new(service::Ros2Client::open(self, spec, service::depth(spec), context)?))
    }

    fn open_server(&self, spec: &ServiceSpec, context: &Context) -> Opened<dyn Server> {
        if let ServiceKind::Ros(kind) = spec.kind {
            self.carries(Role::Server, kind.resolved());
        }
        let other = other_node::of_server(self, spec)?;
        let ros2 = other.as_ref().unwrap_or(self);
        Ok(Box::new(service::Ros2Server::open(ros2, spec, service::depth(spec), context)?))
    }

    fn open_action_client(&self, spec: &ActionSpec, context: &Context) -> Opened<dyn ActionClient> {
        self.carries(Role::ActionClient, spec.kind.resolved());
        let spec = self.resolved(spec)?;
        Ok(Box::new(action_client::PartsClient::open(self, &spec, context)?))
    }

    fn open_action_server(&self, spec: &ActionSpec, context: &Context) -> Opened<dyn ActionServer> {
        self.carries(Role::ActionServer, spec.kind.resolved());
        let spec = self.resolved(spec)?;
        Ok(Box::new(action_server::PartsServer::open(self, &spec, context)?))
    }

    /// Looks the type up by its name, and compares it with the one that the server announces.
    fn learn_action(&self, found: &Discovered, types: &mut TypeStore) -> LearnResult<RosAction> {
        let kind = action_of_name(NAME, found, types)?;
        let service = kind.send_goal();
        let hashes = [service.request().type_hash(), &service.resolved().type_hash()];
        match found.type_hash.as_deref().filter(|hash| !hashes.contains(hash)) {
            None => Ok(kind),
            Some(_) => Err(LearnError::Undefined {
                type_name: kind.name().to_owned(),
                reason:
                    "the definition found here is not that of the server; have both use the same"
                        .to_owned(),
            }),
        }
    }

    fn discover(&self) -> Result<Box<dyn Discovery>, DiscoverError> {
        Ok(Box::new(discovery::Ros2Discovery::new(&self.graph, self.carried_by.clone())?))
    }

    fn routing_properties(&self) -> RoutingProperties {
        RoutingProperties {
            any_ros_type: true,
            ros_time: true,
            tells_own: true,
            shows_marks: true,
            ..RoutingProperties::default()
        }
    }
}

fn unopened(spec: &TopicSpec, error: ParameterClientError) -> OpenError {
    let topic = spec.topic.clone();
    match error {
        ParameterClientError::Name { reason, .. } => OpenError::invalid_name(NAME, &topic, reason),
        other => OpenError::transport(NAME, &topic, other.to_string()),
    }
}

fn transport(spec: &TopicSpec, error: &GraphError) -> OpenError {
    OpenError::transport(NAME, &spec.topic, error.to_string())
}
