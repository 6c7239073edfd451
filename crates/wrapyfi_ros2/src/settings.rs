//! Settings of a node on ROS 2, and its start.

use std::sync::Arc;

use super::adapter::{JoinError, join};
use super::config::CycloneConfig;
use super::cyclone_graph::CycloneError;
use super::domain::DomainError;
use super::environment::{self, Adapter, Environment};
use super::ros2::Ros2;
use wrapyfi_endpoint::{Builder, MiddlewareSettings, StartError};
use wrapyfi_node::NodeName;

/// Rule that gives a topic the name that it has for the node, or says what is wrong with it.
type Remap = dyn Fn(&str) -> Result<String, String> + Send + Sync;

/// Settings of a node on ROS 2.
///
/// ```
/// use wrapyfi_node::NodeName;
/// use wrapyfi_ros2::Ros2Settings;
/// let domain = |name: &str| (name == "ROS_DOMAIN_ID").then(|| "7".to_owned());
/// let settings = Ros2Settings::of_node(NodeName::new("camera", "/lab")?, domain)?;
/// assert_eq!(settings.cyclone.domain_id, 7);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone)]
#[non_exhaustive]
pub struct Ros2Settings {
    /// Name of the node, its domain, and what CycloneDDS needs beside them.
    pub cyclone: CycloneConfig,
    /// Carrier of the graph; `None`: as the environment says.
    pub adapter: Option<Adapter>,
    /// Name of the node for security, `/` where it has none.
    pub enclave: String,
    /// True where the node itself describes the types of its endpoints that not every program of ours has; false for a
    /// program that has all services of a node, [`NodeEndpoints`](super::NodeEndpoints).
    pub describes_types: bool,
    /// Variables of ROS 2 as they were read.
    environment: Environment,
    remap: Arc<Remap>,
}

impl Ros2Settings {
    /// Settings of a node, as the variables of ROS 2 say that `lookup` gives. Topics are expanded in the node's
    /// namespace, and not remapped.
    ///
    /// # Errors
    /// When a variable has a value that it cannot have.
    pub fn of_node(
        node: NodeName,
        lookup: impl Fn(&str) -> Option<String>,
    ) -> Result<Self, StartError> {
        let environment = environment::read(lookup).map_err(StartError::refused)?;
        let cyclone = CycloneConfig::from_environment(node.clone(), &environment);
        let expand = move |topic: &str| node.expand(topic).map_err(|error| error.to_string());
        let (adapter, enclave) = (None, "/".to_owned());
        let (describes_types, remap) = (true, Arc::new(expand));
        Ok(Self { cyclone, adapter, enclave, describes_types, environment, remap })
    }

    /// Sets the rule that gives topics their names.
    #[must_use]
    pub fn remapped(
        self,
        remap: impl Fn(&str) -> Result<String, String> + Send + Sync + 'static,
    ) -> Self {
        Self { remap: Arc::new(remap), ..self }
    }
}

impl std::fmt::Debug for Ros2Settings {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("Ros2Settings").field(&self.cyclone).finish_non_exhaustive()
    }
}

/// ROS 2 as the node `node`, such as `camera` or `/lab/camera`, in the domain and on the middleware that the
/// variables of ROS 2 name.
pub fn ros2(node: &str) -> Builder<Ros2Settings> {
    let (namespace, name) = node.rsplit_once('/').unwrap_or(("/", node));
    let name = NodeName::new(name, namespace)
        .map_err(|error| StartError::refused(format_args!("node {node:?}: {error}")));
    Builder::new(name.and_then(|name| Ros2Settings::of_node(name, |name| std::env::var(name).ok())))
}

impl MiddlewareSettings for Ros2Settings {
    type Middleware = Ros2;

    fn start(&self) -> Result<Ros2, StartError> {
        let Self { cyclone, adapter, enclave, describes_types, environment, remap } = self.clone();
        environment.log();
        let joined = join(&cyclone, &environment, adapter, &enclave);
        let is_refused = |error: &JoinError| match error {
            // With the user's own configuration, which nothing changes but the user.
            JoinError::Cyclone(CycloneError::Domain(DomainError::Refused { .. })) => {
                cyclone.extra_uri.is_some()
            }
            JoinError::Cyclone(CycloneError::Domain(DomainError::Peer(peer))) => {
                peer.is_of_settings()
            }
            JoinError::Cyclone(_) => false,
            _ => true,
        };
        let joined = joined.map_err(|error| StartError::of(&error, is_refused(&error), false))?;
        let ros2 = Ros2::joined(joined, move |topic| remap(topic));
        Ok(if describes_types { ros2.describing() } else { ros2 })
    }
}
