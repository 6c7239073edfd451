//! Other bridges whose node has the name of this one.

use std::time::{Duration, Instant};

use wrapyfi_endpoint::{Discovery, Registry, Role};

use crate::node::{GRAPH, Node};
use crate::why::{OTHER_NODE, same_node};

/// Time between two looks: each costs as much as there are endpoints.
const LOOK_EVERY: Duration = Duration::from_secs(5);

/// Looks for other bridges of the name, and warns of them once, until they are gone.
pub(super) struct DuplicateNodes {
    discovery: Box<dyn Discovery>,
    node: String,
    next: Instant,
    is_told: bool,
}

impl DuplicateNodes {
    /// Begins to look; `None` where ROS 2 tells no endpoints.
    pub(super) fn new(node: &Node, registry: &Registry) -> Option<Self> {
        let discovery = registry.get(GRAPH).ok()?.discover().ok()?;
        let next = Instant::now() + LOOK_EVERY;
        Some(Self { discovery, node: node.name().fqn(), next, is_told: false })
    }

    /// Looks, where it is time to.
    pub(super) fn look(&mut self, now: Instant) {
        if now < self.next {
            return;
        }
        self.next = now + LOOK_EVERY;
        let Ok(found) = self.discovery.endpoints() else { return };
        // Those of this bridge are left out.
        let status = format!("{}/status", self.node);
        let is_there = found.iter().any(|one| one.name == status && one.role == Role::Publisher);
        if is_there && !self.is_told {
            tracing::warn!("{}; {OTHER_NODE}", same_node(&self.node));
        }
        self.is_told = is_there;
    }
}
