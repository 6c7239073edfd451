//! `endpoints.ros2` of a configuration, and the middleware that it makes.

use serde::Deserialize;
use wrapyfi_core::Limits;
use wrapyfi_core::engine::Available;
use wrapyfi_core::middleware::ros2::environment::{DiscoveryRange, Environment};
use wrapyfi_core::middleware::ros2::{self, Adapter, CycloneConfig, JoinError, Joined, Ros2};

use crate::exit::Failure;
use crate::node::Node;

/// The middleware as routes and commands address it, with its rules for topics.
pub(super) const AVAILABLE: Available<'static> =
    Available { name: "ros2", check_topic: &check_topic, options: &[] };

/// The rules do not depend on the node: any will do.
fn check_topic(topic: &str) -> Result<(), String> {
    let check = || Node::bridge()?.name().expand(topic);
    check().map(drop).map_err(|error| error.to_string())
}

/// `endpoints.ros2`; what is left out comes from the ROS 2 environment variables.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[allow(missing_docs)] // config/example.yaml is the manual
pub struct Ros2Section {
    pub domain_id: Option<u32>,
    pub interface: Option<String>,
    pub graph: Option<Adapter>,
}

impl Ros2Section {
    /// Starts the middleware as the node `node`.
    ///
    /// # Errors
    /// Exit code 2 for settings that cannot work, 1 when the DDS stack refuses.
    pub fn start(&self, node: &Node, largest_message: usize) -> Result<Ros2, Failure> {
        let environment =
            ros2::environment::read(|name| std::env::var(name).ok()).map_err(Failure::usage)?;
        environment.log();
        self.start_in(&environment, node, largest_message)
    }

    /// As [`Ros2Section::start`], for a node that only looks: as far as multicast reaches if `wide`,
    /// whatever the environment says.
    pub(super) fn start_looking(&self, node: &Node, wide: bool) -> Result<Ros2, Failure> {
        let read = ros2::environment::read(|name| std::env::var(name).ok());
        let mut environment = read.map_err(Failure::usage)?;
        if wide {
            environment.discovery.range = DiscoveryRange::Subnet;
        }
        self.start_in(&environment, node, Limits::default().message_bytes)
    }

    fn start_in(
        &self,
        environment: &Environment,
        node: &Node,
        largest_message: usize,
    ) -> Result<Ros2, Failure> {
        let mut config = CycloneConfig::from_environment(node.name().clone(), environment);
        config.domain_id = self.domain_id.unwrap_or(config.domain_id);
        config.interface.clone_from(&self.interface);
        config.max_message_bytes = largest_message;
        let joined = join(&config, environment, self.graph, node.enclave())?;
        let node = node.clone();
        let remap = move |topic: &str| node.resolve_topic(topic).map_err(|error| error.to_string());
        Ok(Ros2::joined(joined, remap))
    }
}

/// Joins the graph.
///
/// # Errors
/// Exit code 2 where another middleware has to be named, installed or built in; 1 when the DDS stack refuses.
pub(super) fn join(
    config: &CycloneConfig,
    environment: &Environment,
    wanted: Option<Adapter>,
    enclave: &str,
) -> Result<Joined, Failure> {
    ros2::join(config, environment, wanted, enclave).map_err(|error| match error {
        JoinError::NotBuilt(_) | JoinError::Rmw(_) => Failure::usage(format!("ros2: {error}")),
        error => Failure::Failed(anyhow::Error::new(error).context("ros2")),
    })
}
