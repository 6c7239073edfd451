//! The node as a middleware: its names and what carries it, which all its endpoints share.

use std::sync::Arc;

use super::adapter::Joined;
use super::describing::Describing;
use super::diagnosis::Names;
use super::graph::{Graph, TopicDescription};
use wrapyfi_endpoint::codec::ros;
use wrapyfi_endpoint::{ActionSpec, OpenError, OpenResult, Role, ServiceSpec, TopicSpec};
use wrapyfi_interfaces::store::ResolvedType;
use wrapyfi_node::NodeName;

/// Name of this middleware in addresses.
pub const NAME: &str = "ros2";

type Remap = Arc<dyn Fn(&str) -> Result<String, String> + Send + Sync>;

/// The middleware `ros2`: topics of one node, and with
/// [`MessageType::Properties`](wrapyfi_data::types::MessageType::Properties) the parameters of others. Copies are the
/// same node.
#[derive(Clone)]
pub struct Ros2 {
    pub(super) graph: Arc<dyn Graph>,
    pub(super) names: Arc<Names>,
    remap: Remap,
    pub(super) carried_by: Option<Arc<str>>,
    /// `None` where the program offers the descriptions of types itself.
    describing: Option<Arc<Describing>>,
}

impl Ros2 {
    /// Topics of the node behind `graph`. `remap` is given every topic as an absolute name and
    /// returns the one to use: the node's remapping rules, or the name as it is. Its error is
    /// shown as the reason why the name is invalid.
    #[doc(hidden)]
    pub fn new(
        graph: Arc<dyn Graph>,
        remap: impl Fn(&str) -> Result<String, String> + Send + Sync + 'static,
    ) -> Self {
        let (names, remap) = (Names::new(&graph), Arc::new(remap));
        Self { names, graph, remap, carried_by: None, describing: None }
    }

    /// The middleware of a node that has joined its graph: [`Ros2::new`] that can tell what carries it.
    #[doc(hidden)]
    pub fn joined(
        joined: Joined,
        remap: impl Fn(&str) -> Result<String, String> + Send + Sync + 'static,
    ) -> Self {
        Self { carried_by: Some(joined.carried_by.into()), ..Self::new(joined.graph, remap) }
    }

    /// Has the node describe types that its endpoints have, for a program that offers no [`NodeEndpoints`] on the graph.
    ///
    /// [`NodeEndpoints`]: super::NodeEndpoints
    #[must_use]
    pub(super) fn describing(self) -> Self {
        Self { describing: Some(Arc::default()), ..self }
    }

    /// Takes note that an endpoint of this node has a type.
    pub(super) fn carries(&self, role: Role, resolved: &ResolvedType) {
        // A hidden node is one of a command: what it hears or calls it was told by another node, or by its user.
        let is_hidden = self.graph.node().name().starts_with('_');
        if let Some(describing) = &self.describing
            && (role.is_provider() || !is_hidden)
        {
            describing.carries(&self.graph, resolved);
        }
    }

    /// Name of what carries the graph, and why it was chosen; `None` where nothing was chosen.
    pub fn carried_by(&self) -> Option<&str> {
        self.carried_by.as_deref()
    }

    /// The graph underneath.
    #[doc(hidden)]
    pub fn graph(&self) -> &Arc<dyn Graph> {
        &self.graph
    }

    /// The same for endpoints that stand for another node, which are on `graph`.
    pub(super) fn for_other(&self, graph: Arc<dyn Graph>) -> Self {
        Self { graph, ..self.clone() }
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

    /// The action that `spec` means, by its absolute name.
    pub(super) fn resolved(&self, spec: &ActionSpec) -> OpenResult<ActionSpec> {
        Ok(ActionSpec { action: self.resolve(&spec.action)?, ..spec.clone() })
    }

    /// Topic that `spec` means, as the graph wants it.
    pub(super) fn describe(&self, spec: &TopicSpec) -> OpenResult<TopicDescription> {
        Ok(TopicDescription {
            name: self.resolve(&spec.topic)?,
            type_name: spec.message_type.ros_type().to_owned(),
            type_hash: Some(ros::type_hash(spec.message_type).to_owned()),
            qos: spec.pinned.apply(spec.qos),
            max_bytes: spec.limits.message_bytes,
            hears_own: false,
        })
    }
}

/// Error for a service that cannot be opened.
pub(super) fn no_service(spec: &ServiceSpec, error: &dyn std::error::Error) -> OpenError {
    let (topic, reason) = (spec.service.clone(), error.to_string());
    OpenError::transport(NAME, &topic, reason)
}
