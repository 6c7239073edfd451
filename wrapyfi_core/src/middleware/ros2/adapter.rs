//! Which adapter carries the graph of a node.
//!
//! ```text
//!   asked for             RMW_IMPLEMENTATION       a program without `rmw`    a program with it
//!   nothing               rmw_cyclonedds_cpp       CycloneDDS inside          CycloneDDS inside
//!   nothing               none, no ROS 2 sourced   CycloneDDS inside          CycloneDDS inside
//!   nothing               none, ROS 2 sourced      CycloneDDS inside          the one that ROS 2 loads
//!   nothing               any other                CycloneDDS inside          that one
//!   `graph: cyclone`      any                      CycloneDDS inside          CycloneDDS inside
//!   `graph: rmw`          any                      an error                   the one that ROS 2 loads
//! ```
//!
//! Where the one that ROS 2 loads is `rmw_cyclonedds_cpp`, CycloneDDS inside is as good and needs nothing installed.

use std::sync::Arc;

use serde::Deserialize;

use super::config::CycloneConfig;
use super::cyclone_graph::{CycloneError, CycloneGraph};
use super::environment::Environment;
use super::graph::{Graph, ServiceMapping};

/// What carries the graph.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Adapter {
    /// CycloneDDS inside the program.
    Cyclone,
    /// The middleware of the installed ROS 2.
    Rmw,
}

/// Why a node could not join the graph.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum JoinError {
    /// CycloneDDS refused.
    #[error(transparent)]
    Cyclone(#[from] CycloneError),
    /// The middleware of the installed ROS 2 refused, or cannot be loaded.
    #[error(
        "the middleware of ROS 2 could not create the node: {0}; unset RMW_IMPLEMENTATION, or install that middleware"
    )]
    Rmw(String),
    /// The program was built without the feature `rmw`.
    #[error(
        "graph: rmw needs a program built in a ROS 2: `colcon build --packages-up-to wrapyfi_bridge` where it is sourced"
    )]
    NotBuilt,
}

/// Joins the graph as the node of `config`: through `wanted`, or what `environment` means. `enclave` is the node's
/// name for security, `/` where it has none.
///
/// # Errors
/// When the middleware refuses, or is none that this program can speak through.
pub fn join(
    config: &CycloneConfig,
    environment: &Environment,
    wanted: Option<Adapter>,
    enclave: &str,
) -> Result<Arc<dyn Graph>, JoinError> {
    // Where a ROS 2 is sourced and nothing is set, its default is meant.
    let means_other = environment.services != ServiceMapping::Cyclone;
    match wanted {
        Some(Adapter::Rmw) => on_rmw(config, "graph: rmw", enclave),
        None if cfg!(feature = "rmw") && means_other && !loads_cyclone()? => {
            on_rmw(config, &environment.stack_reason, enclave)
        }
        _ => {
            tracing::info!(
                domain = config.domain_id,
                range = ?config.discovery.range,
                services = config.services.rmw(),
                reason = environment.stack_reason,
                "topics are on CycloneDDS"
            );
            Ok(Arc::new(CycloneGraph::new(config)?))
        }
    }
}

/// Whether the middleware that ROS 2 loads is CycloneDDS's.
#[cfg(feature = "rmw")]
fn loads_cyclone() -> Result<bool, JoinError> {
    let loaded = wrapyfi_rmw::implementation();
    let loaded = loaded.map_err(|fault| JoinError::Rmw(fault.to_string()))?;
    Ok(loaded == "rmw_cyclonedds_cpp")
}

#[cfg(not(feature = "rmw"))]
fn loads_cyclone() -> Result<bool, JoinError> {
    Ok(true)
}

#[cfg(feature = "rmw")]
fn on_rmw(
    config: &CycloneConfig,
    reason: &str,
    enclave: &str,
) -> Result<Arc<dyn Graph>, JoinError> {
    let refused = |fault: wrapyfi_rmw::Fault| JoinError::Rmw(fault.to_string());
    let rmw = wrapyfi_rmw::implementation().map_err(refused)?;
    tracing::info!(
        domain = config.domain_id,
        range = ?config.discovery.range,
        reason,
        "topics and services are on {rmw}, through the rmw of this ROS 2"
    );
    if let Some(interface) = &config.interface {
        tracing::warn!(
            "endpoints.ros2.interface: {interface} has no effect on {rmw}: set its own configuration"
        );
    }
    Ok(Arc::new(super::rmw_graph::RmwGraph::new(config, enclave).map_err(refused)?))
}

#[cfg(not(feature = "rmw"))]
fn on_rmw(_: &CycloneConfig, _: &str, _: &str) -> Result<Arc<dyn Graph>, JoinError> {
    Err(JoinError::NotBuilt)
}
