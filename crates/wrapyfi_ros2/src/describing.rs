//! `~/get_type_description` of a node whose program offers nothing else beside its endpoints.
//!
//! ```text
//!   open a publisher of demo/msg/Pose ─▶ no program is built with it ─▶ the service is offered, once
//!   open a publisher of std_msgs/msg/String ─▶ every program of ours has it ─▶ nothing
//! ```
//!
//! A node with parameters has the service among those of [`NodeEndpoints`]. Each service costs endpoints in both mappings
//! and a thread, so that a node which carries common types alone goes without.

use std::sync::Arc;

use wrapyfi_endpoint::Mutex;
use wrapyfi_interfaces::store::{ResolvedType, TypeStore};

use super::graph::Graph;
use super::node_endpoints::NodeEndpoints;

/// The service, from the first type that needs it to the end of the node.
#[derive(Default)]
pub(super) struct Describing(Mutex<Option<Offered>>);

/// Outcome of offering: one try, because what the DDS stack refuses it refuses again.
struct Offered {
    _endpoints: Option<NodeEndpoints>,
}

impl Describing {
    /// Takes note that the node of `graph` has an endpoint of this type.
    pub(super) fn carries(&self, graph: &Arc<dyn Graph>, resolved: &ResolvedType) {
        let mut offered = self.0.lock();
        if offered.is_some() || is_built_in(resolved) {
            return;
        }
        let endpoints = NodeEndpoints::describing(graph).inspect_err(|error| {
            // The endpoint itself works all the same.
            tracing::debug!(%error, "{} is not described", resolved.name());
        });
        *offered = Some(Offered { _endpoints: endpoints.ok() });
    }
}

/// True for a type that every program of ours has.
fn is_built_in(resolved: &ResolvedType) -> bool {
    let known = TypeStore::generated().resolve(resolved.name());
    known.is_ok_and(|known| known.type_hash() == resolved.type_hash())
}

#[cfg(test)]
mod tests {
    use wrapyfi_interfaces::parser::{Dialect, TypeName};

    use super::*;

    #[test]
    fn only_what_others_may_lack_is_described() {
        let of = |name: &str, text: &str| {
            let name = TypeName::parse(Dialect::Ros2, name).unwrap();
            ResolvedType::from_text(Dialect::Ros2, &name, text).unwrap()
        };
        assert!(is_built_in(&of("std_msgs/msg/String", "string data\n")));
        assert!(!is_built_in(&of("std_msgs/msg/String", "string text\n")), "another definition");
        assert!(!is_built_in(&of("demo/msg/Pose", "float64 x\n")));
    }
}
