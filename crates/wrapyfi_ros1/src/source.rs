//! ROS 1: one node for all publishers and servers of a context, one for its listeners and
//! clients.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use super::config::{NAME, Ros1Config};
use wrapyfi_endpoint::method::{EndpointNeeds, Source, queue_size};
use wrapyfi_endpoint::network::Place;
use wrapyfi_endpoint::{Planned, StartError};

/// ROS 1 for registered methods, by their options, then by the environment.
pub fn source() -> Arc<dyn Source> {
    Arc::new(Ros1Source::default())
}

/// Name of a node without one, as in Wrapyfi.
const NODE: &str = "wrapyfi";

/// Number of contexts made in the process.
static CONTEXTS: AtomicU32 = AtomicU32::new(0);

struct Ros1Source {
    /// Number of this context.
    number: u32,
}

impl Default for Ros1Source {
    fn default() -> Self {
        Self { number: CONTEXTS.fetch_add(1, Relaxed) }
    }
}

impl Source for Ros1Source {
    fn name(&self) -> &str {
        NAME
    }

    fn plan(&self, wanted: &EndpointNeeds<'_>) -> Result<Planned, StartError> {
        let kwargs = wanted.options.part("ros_kwargs")?;
        let named = kwargs.text("node_name")?.unwrap_or(NODE);
        let anonymous = kwargs.switch("anonymous")?.unwrap_or(true);
        // Two sides, two nodes: a node does not hear itself.
        let side = if wanted.role.is_provider() { "" } else { "_in" };
        let node = if anonymous {
            format!("{named}_{:x}_{}{side}", std::process::id(), self.number)
        } else {
            format!("{named}{side}")
        };
        let mut config = Ros1Config::from_env().map_err(StartError::refused)?;
        config.node = Some(node.clone());
        let is_insecure = kwargs.switch("insecure")?.unwrap_or(false);
        config.insecure.said(Place::Keyword, false, is_insecure);
        Ok(Planned::new(node, config))
    }

    fn queue_depth(&self) -> Option<usize> {
        Some(queue_size("WRAPYFI_ROS_QUEUE_SIZE"))
    }
}
