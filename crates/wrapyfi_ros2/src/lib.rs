//! ROS 2 topics over CycloneDDS.
//!
//! ```text
//!   Ros2 (Middleware) ─ names ─ listener (receive_path), publisher: payload <-> CDR; any: any type <-> CDR
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
//!   rust_services ───── services as Fast DDS has them, on RustDDS
//!
//!   service: services of any type, by the bytes of requests and replies
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

mod adapter;
mod announcement;
mod any;
mod config;
mod conventions;
mod cyclone;
mod cyclone_endpoints;
mod cyclone_graph;
mod cyclone_service;
mod dds_terms;
mod diagnosis;
mod discovery;
mod discovery_info;
mod domain;
pub mod environment;
mod follow;
pub mod graph;
mod listener;
mod matching;
mod names;
mod node_endpoints;
mod node_handle;
#[doc(hidden)]
pub mod offline;
mod origins;
mod owners;
mod pacing;
mod parameters;
mod payload;
mod peer_index;
mod publisher;
mod receive_path;
mod replays;
#[cfg(feature = "rmw")]
mod rmw_endpoints;
#[cfg(feature = "rmw")]
mod rmw_graph;
#[cfg(feature = "rmw")]
mod rmw_paired;
#[cfg(feature = "fastdds-services")]
mod rust_services;
mod service;
mod service_header;
mod services;
mod vendor;
#[cfg(test)]
mod wire_tests;

use std::sync::Arc;

pub use adapter::{JoinError, Joined, join};
pub use any::{AnyError, AnyListener, AnyMessage, AnyPublisher};
pub use config::CycloneConfig;
pub use conventions::follow_conventions;
pub use cyclone_graph::{CycloneError, CycloneGraph};
pub use diagnosis::remedy;
pub use domain::DomainError;
pub use environment::Adapter;
pub use node_endpoints::NodeEndpoints;
pub use node_handle::NodeHandle;
pub use parameters::{
    ParameterClient, ParameterClientError, ParameterResult, RefusedParameter, RemoteParameters,
};
#[cfg(feature = "rmw")]
pub use rmw_graph::RmwGraph;
#[cfg(feature = "fastdds-services")]
pub use rust_services::{RustServices, RustServicesError, ServiceEndpoints};
pub use service::{AnyClient, AnyRequest, AnyServer, ServiceOptions, returned};

use diagnosis::Names;
use graph::{Graph, GraphError, TopicDescription};
use listener::Ros2Listener;
use parameters::{PropertiesListener, PropertiesPublisher};
use publisher::Ros2Publisher;
use wrapyfi_data::types::MessageType;
use wrapyfi_endpoint::codec::ros;
use wrapyfi_endpoint::{
    Client, Context, DiscoverError, Discovery, Listener, Middleware, OpenError, OpenResult, Opened,
    Publisher, Server, ServiceSpec, TopicSpec, Traits,
};
use wrapyfi_node::NodeName;

/// Name of this middleware in addresses.
const NAME: &str = "ros2";

type Remap = Arc<dyn Fn(&str) -> Result<String, String> + Send + Sync>;

/// The middleware `ros2`: topics of one node, and with [`MessageType::Properties`] the parameters of
/// others. Copies are the same node.
#[derive(Clone)]
pub struct Ros2 {
    graph: Arc<dyn Graph>,
    names: Arc<Names>,
    remap: Remap,
    carried_by: Option<Arc<str>>,
}

impl Ros2 {
    /// Topics of the node behind `graph`. `remap` is given every topic as an absolute name and
    /// returns the one to use: the node's remapping rules, or the name as it is. Its error is
    /// shown as the reason why the name is invalid.
    #[must_use]
    pub fn new(
        graph: Arc<dyn Graph>,
        remap: impl Fn(&str) -> Result<String, String> + Send + Sync + 'static,
    ) -> Self {
        Self { names: Names::new(&graph), graph, remap: Arc::new(remap), carried_by: None }
    }

    /// The middleware of a node that has joined its graph: [`Ros2::new`] that can tell what carries it.
    #[must_use]
    pub fn joined(
        joined: Joined,
        remap: impl Fn(&str) -> Result<String, String> + Send + Sync + 'static,
    ) -> Self {
        Self { carried_by: Some(joined.carried_by.into()), ..Self::new(joined.graph, remap) }
    }

    /// Name of what carries the graph, and why it was chosen; `None` where nothing was chosen.
    #[must_use]
    pub fn carried_by(&self) -> Option<&str> {
        self.carried_by.as_deref()
    }

    /// The graph underneath.
    #[must_use]
    pub fn graph(&self) -> &Arc<dyn Graph> {
        &self.graph
    }

    /// The absolute name under which the node uses `topic`: expanded and remapped.
    ///
    /// # Errors
    /// When a rule for names is broken.
    pub fn resolve(&self, topic: &str) -> OpenResult<String> {
        let invalid = |reason: String| OpenError::invalid_name(NAME, topic, reason);
        let expanded =
            self.graph.node().expand(topic).map_err(|error| invalid(error.to_string()))?;
        let name = (self.remap)(&expanded).map_err(invalid)?;
        NodeName::check_topic(&name).map_err(|error| invalid(error.to_string()))?;
        Ok(name)
    }

    fn describe(&self, spec: &TopicSpec) -> OpenResult<TopicDescription> {
        Ok(TopicDescription {
            name: self.resolve(&spec.topic)?,
            type_name: spec.message_type.ros_type().to_owned(),
            type_hash: Some(ros::type_hash(spec.message_type).to_owned()),
            qos: spec.pinned.apply(spec.qos),
            max_bytes: spec.limits.message_bytes,
        })
    }
}

impl Middleware for Ros2 {
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
        let topic = self.describe(spec)?;
        let publisher = Ros2Publisher::open(&self.graph, &self.names, &topic, spec, context)
            .map_err(|error| transport(spec, &error))?;
        Ok(Box::new(publisher))
    }

    fn open_client(&self, spec: &ServiceSpec, context: &Context) -> Opened<dyn Client> {
        Ok(Box::new(service::Ros2Client::open(self, spec, service::depth(spec), context)?))
    }

    fn open_server(&self, spec: &ServiceSpec, context: &Context) -> Opened<dyn Server> {
        Ok(Box::new(service::Ros2Server::open(self, spec, service::depth(spec), context)?))
    }

    fn discover(&self) -> Result<Box<dyn Discovery>, DiscoverError> {
        Ok(Box::new(discovery::Ros2Discovery::new(&self.graph, self.carried_by.clone())?))
    }

    fn traits(&self) -> Traits {
        Traits {
            any_ros_type: true,
            ros_time: true,
            tells_own: true,
            shows_marks: true,
            ..Traits::default()
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

/// Error for a service that cannot be opened.
fn no_service(spec: &ServiceSpec, error: &dyn std::error::Error) -> OpenError {
    let (topic, reason) = (spec.service.clone(), error.to_string());
    OpenError::transport(NAME, &topic, reason)
}

fn transport(spec: &TopicSpec, error: &GraphError) -> OpenError {
    OpenError::transport(NAME, &spec.topic, error.to_string())
}
