//! DDS stack that carries the services of a node.
//!
//! ```text
//!   ServiceMapping::Cyclone ─▶ CycloneDDS, beside the topics
//!   ServiceMapping::FastDds ─▶ RustServices, on a participant of their own
//!                                  └─ their GIDs ─▶ ros_discovery_info, under the node's name
//! ```

use std::sync::Arc;

use super::config::CycloneConfig;
use super::discovery_info::Announcing;
use super::graph::{GraphError, GraphResult, ServiceDescription, ServiceMapping};
#[cfg(feature = "fastdds-services")]
use super::rust_services::{RustServices, RustServicesError};

/// The services of one node.
#[cfg(feature = "fastdds-services")]
pub(super) struct Services(Option<Result<RustServices, RustServicesError>>);

#[cfg(feature = "fastdds-services")]
impl Services {
    /// Services of a node, of which nothing is created yet. Settings that services cannot have do
    /// not keep the node from its topics: they are the error of the first service.
    pub(super) fn new(config: &CycloneConfig) -> Self {
        Self(match config.services {
            ServiceMapping::Cyclone => None,
            ServiceMapping::FastDds => Some(RustServices::new(config)),
        })
    }

    /// Form in which services are mapped to DDS.
    pub(super) fn mapping(&self) -> ServiceMapping {
        self.0.as_ref().map_or(ServiceMapping::Cyclone, |_| ServiceMapping::FastDds)
    }

    /// Participant for a service that does not go over CycloneDDS.
    pub(super) fn elsewhere(
        &self,
        service: &ServiceDescription,
    ) -> GraphResult<Option<&RustServices>> {
        match &self.0 {
            None => Ok(None),
            Some(Ok(services)) => Ok(Some(services)),
            Some(Err(error)) => Err(refused(service, &error.to_string())),
        }
    }

    /// Lists the endpoints that are elsewhere as the node's, now and whenever they change.
    pub(super) fn announce(&self, node: &Arc<dyn Announcing>) {
        if let Some(Ok(services)) = &self.0 {
            let node = Arc::downgrade(node);
            services.on_change(move |ends| {
                if let Some(node) = node.upgrade() {
                    node.info().set_elsewhere(&ends.readers, &ends.writers);
                }
            });
        }
    }

    /// True when an endpoint is on the participant of the services.
    pub(super) fn owns(&self, gid: &[u8; 16]) -> bool {
        let Some(Ok(services)) = &self.0 else { return false };
        services.gid().is_some_and(|own| own.first_chunk::<12>() == gid.first_chunk::<12>())
    }
}

/// The services of one node, in a build without RustDDS.
#[cfg(not(feature = "fastdds-services"))]
pub(super) struct Services(ServiceMapping);

#[cfg(not(feature = "fastdds-services"))]
#[allow(clippy::unused_self)]
impl Services {
    pub(super) fn new(config: &CycloneConfig) -> Self {
        Self(config.services)
    }

    pub(super) fn mapping(&self) -> ServiceMapping {
        self.0
    }

    pub(super) fn elsewhere(
        &self,
        service: &ServiceDescription,
    ) -> GraphResult<Option<&dyn super::graph::Graph>> {
        match self.0 {
            ServiceMapping::Cyclone => Ok(None),
            ServiceMapping::FastDds => Err(refused(
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
