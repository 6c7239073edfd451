//! The bridge as a ROS 2 node: its name, its remap rules, its parameters.

use std::collections::BTreeMap;
use std::sync::Arc;

use wrapyfi_endpoint::EndpointAddress;
use wrapyfi_node::args::RosArgs;
use wrapyfi_node::parameters::{DeclareError, ParameterStore};
use wrapyfi_node::{NameError, NodeName, ParameterValue};

/// Middleware on which a bridge is a node.
pub(crate) const GRAPH: &str = wrapyfi_ros2::NAME;

/// Name of the bridge's node unless it is remapped.
pub(crate) const DEFAULT_NAME: &str = "wrapyfi_bridge";

/// A node's name, the remap rules that apply to its topics, and its parameters' overrides.
#[derive(Debug, Clone)]
pub struct Node {
    pub(crate) name: NodeName,
    pub(crate) args: Arc<RosArgs>,
    pub(crate) overrides: BTreeMap<String, ParameterValue>,
}

impl Node {
    /// A node called `name` in the root namespace, without remap rules.
    ///
    /// # Errors
    /// When the name breaks the rules of the graph.
    pub fn named(name: &str) -> Result<Self, NameError> {
        let (args, overrides) = (Arc::default(), BTreeMap::new());
        Ok(Self { name: NodeName::new(name, "/")?, args, overrides })
    }

    /// The bridge's node under its default name.
    ///
    /// # Errors
    /// Never in practice: the name is one of the graph.
    pub fn bridge() -> Result<Self, NameError> {
        Self::named(DEFAULT_NAME)
    }

    /// Name and namespace.
    pub fn name(&self) -> &NodeName {
        &self.name
    }

    /// The parameters that every node has, with the values that the command line gives them.
    ///
    /// # Errors
    /// When one of them is given another type.
    pub fn parameters(&self) -> Result<ParameterStore, DeclareError> {
        ParameterStore::new(&self.name, self.overrides.clone())
    }

    /// An address with the name that it has for this node: on ROS 2 expanded and remapped.
    pub fn resolve(&self, address: &EndpointAddress) -> EndpointAddress {
        let mut resolved = address.clone();
        if address.middleware == GRAPH
            && let Ok(name) = self.resolve_topic(&address.name)
        {
            resolved.name = name;
        }
        resolved
    }

    /// The absolute name of a topic as this node sees it: expanded in its namespace, remapped.
    ///
    /// # Errors
    /// When the name breaks the rules of the graph.
    pub fn resolve_topic(&self, topic: &str) -> Result<String, NameError> {
        self.args.resolve_topic(&self.name, topic)
    }

    /// As [`Node::resolve_topic`], of a service.
    ///
    /// # Errors
    /// When the name breaks the rules of the graph.
    pub fn resolve_service(&self, service: &str) -> Result<String, NameError> {
        self.args.resolve_service(&self.name, service)
    }
}
