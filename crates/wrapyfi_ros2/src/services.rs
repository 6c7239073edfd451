//! DDS stack that carries the services of a node.
//!
//! ```text
//!   Cyclone's mapping  ─▶ CycloneDDS, beside the topics
//!   Fast DDS's mapping ─▶ RustServices: the node's own, ~/…, on one participant; all others on a second one
//!                                  └─ their GIDs ─▶ ros_discovery_info, under the node's name
//! ```
//!
//! Without a choice each service is in both (`both_mappings`).
//!
//! Fast DDS hears nothing of the end of a service on RustDDS, but for that of a participant (`rust_services/goodbye`).
//! So those of the routes have one of their own, which ends with them when a bridge is deactivated.

use std::sync::Arc;

use super::config::CycloneConfig;
use super::discovery_info::Announcing;
use super::graph::{GraphError, GraphResult, ServiceDescription, ServiceMapping};
#[cfg(feature = "fastdds-services")]
use super::rust_services::{RustServices, RustServicesError};

/// The services of one node.
#[cfg(feature = "fastdds-services")]
pub(super) struct Services {
    mapping: Option<ServiceMapping>,
    /// The node's own services, and all others.
    on_rustdds: Option<Result<[RustServices; 2], RustServicesError>>,
    /// Beginning of the names of the node's own.
    own: String,
}

#[cfg(feature = "fastdds-services")]
impl Services {
    /// Services of a node, of which nothing is created yet. Settings that services cannot have do
    /// not keep the node from its topics: they are the error of the first service.
    pub(super) fn new(config: &CycloneConfig) -> Self {
        let on_rustdds = match config.services {
            Some(ServiceMapping::Cyclone) => None,
            _ => Some(
                RustServices::new(config).map(|own| [own.clone(), own.on_another_participant()]),
            ),
        };
        let (mapping, on_rustdds) = match (config.services, on_rustdds) {
            // What was not asked for may be missing.
            (None, Some(Err(error))) => {
                tracing::info!("services are not in the mapping of rmw_fastrtps_cpp: {error}");
                (Some(ServiceMapping::Cyclone), None)
            }
            found => found,
        };
        Self { mapping, on_rustdds, own: format!("{}/", config.node.fqn()) }
    }

    /// The only form in which services are mapped to DDS; `None`: both.
    pub(super) fn mapping(&self) -> Option<ServiceMapping> {
        self.mapping
    }

    /// Participant for a service that does not go over CycloneDDS alone.
    pub(super) fn elsewhere(
        &self,
        service: &ServiceDescription,
    ) -> GraphResult<Option<&RustServices>> {
        match &self.on_rustdds {
            None => Ok(None),
            Some(Ok([own, others])) => {
                Ok(Some(if service.name.starts_with(&self.own) { own } else { others }))
            }
            Some(Err(error)) => Err(refused(service, &error.to_string())),
        }
    }

    /// Lists the endpoints that are elsewhere as the node's, now and whenever they change.
    pub(super) fn announce(&self, node: &Arc<dyn Announcing>) {
        let both = self.on_rustdds.iter().flatten().flatten();
        for (place, services) in both.enumerate() {
            let node = Arc::downgrade(node);
            services.on_change(move |ends| {
                if let Some(node) = node.upgrade() {
                    node.info().set_elsewhere(place, &ends.readers, &ends.writers);
                }
            });
        }
    }

    /// True when an endpoint is on the participant of the services.
    pub(super) fn owns(&self, gid: &[u8; 16]) -> bool {
        let mut gids = self.on_rustdds.iter().flatten().flatten().filter_map(RustServices::gid);
        gids.any(|own| own.first_chunk::<12>() == gid.first_chunk::<12>())
    }
}

/// The services of one node, in a build without RustDDS.
#[cfg(not(feature = "fastdds-services"))]
pub(super) struct Services(Option<ServiceMapping>);

#[cfg(not(feature = "fastdds-services"))]
impl Services {
    pub(super) fn new(config: &CycloneConfig) -> Self {
        Self(config.services.or(Some(ServiceMapping::Cyclone)))
    }

    pub(super) fn mapping(&self) -> Option<ServiceMapping> {
        self.0
    }

    pub(super) fn elsewhere(
        &self,
        service: &ServiceDescription,
    ) -> GraphResult<Option<&dyn super::graph::Graph>> {
        match self.0 {
            None | Some(ServiceMapping::Cyclone) => Ok(None),
            Some(ServiceMapping::FastDds) => Err(refused(
                service,
                "CycloneDDS inside has services of rmw_fastrtps_cpp in programs built with the feature \
                 fastdds-services, as `cargo build` builds them; colcon leaves it out where it builds with rmw, \
                 which has these services itself: unset WRAPYFI_ROS2_GRAPH and endpoints.ros2.graph, or set \
                 RMW_IMPLEMENTATION=rmw_cyclonedds_cpp on both sides",
            )),
        }
    }

    pub(super) fn announce(&self, _: &Arc<dyn Announcing>) {}

    pub(super) fn owns(&self, _: &[u8; 16]) -> bool {
        false
    }
}

fn refused(service: &ServiceDescription, reason: &str) -> GraphError {
    GraphError::stack("creating a service's endpoints", &service.name, &reason)
}
