//! Adapter that carries the graph of a node.
//!
//! ```text
//!   asked for             RMW_IMPLEMENTATION       a program without `rmw`    a program with it
//!   nothing               rmw_cyclonedds_cpp       CycloneDDS inside          CycloneDDS inside
//!   nothing               none, no ROS 2 sourced   CycloneDDS inside          CycloneDDS inside
//!   nothing               none, ROS 2 sourced      CycloneDDS inside          the one that ROS 2 loads
//!   nothing               any other                CycloneDDS inside          that one
//!   cyclone               any                      CycloneDDS inside          CycloneDDS inside
//!   rmw                   any                      an error                   the one that ROS 2 loads
//! ```
//!
//! CycloneDDS inside has no SROS 2. If keys are asked for (`ROS_SECURITY_ENABLE`), a program with `rmw` speaks
//! through the one that ROS 2 loads, also where that is `rmw_cyclonedds_cpp`; a program without refuses to start
//! where keys are enforced, so that no node is open whose owner believes it closed.
//!
//! The adapter is asked for by `endpoints.ros2.graph`, else by `WRAPYFI_ROS2_GRAPH`.
//!
//! An environment in which ROS 2 loads `rmw_cyclonedds_cpp` is served as well by CycloneDDS inside,
//! which needs nothing installed.

use std::sync::{Arc, Once};

use super::config::CycloneConfig;
use super::cyclone_graph::{CycloneError, CycloneGraph};
use super::environment::{Adapter, Environment, Security, build};
use super::graph::{Graph, ServiceMapping};

/// Error of a node that joins the graph.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum JoinError {
    /// CycloneDDS refused.
    #[error(transparent)]
    Cyclone(#[from] CycloneError),
    /// The middleware of the installed ROS 2 refused, or cannot be loaded.
    #[error(
        "the middleware of ROS 2 could not create the node: {0}; install the one that RMW_IMPLEMENTATION names, name another, or set WRAPYFI_ROS2_GRAPH=cyclone"
    )]
    Rmw(String),
    /// Keys are enforced, and there are none; the text says how they are made.
    #[error("{0}")]
    WithoutKeys(String),
    /// The program was built without the feature `rmw`; the text says who asked for it.
    #[error(
        "{0} asks for the middleware of ROS 2, which this program was built without: {build}",
        build = build!()
    )]
    NotBuilt(String),
    /// Keys are enforced, and CycloneDDS inside has none; the text is the remedy.
    #[error(
        "ROS_SECURITY_ENABLE=true with ROS_SECURITY_STRATEGY=Enforce asks for keys, which CycloneDDS inside this program cannot use: {0}; or unset ROS_SECURITY_ENABLE"
    )]
    NoKeys(&'static str),
    /// This machine has no such interface.
    #[error(
        "endpoints.ros2.interface: this machine has no network interface {name:?}; it has {}", there.join(", ")
    )]
    NoInterface {
        /// Name that is configured.
        name: String,
        /// Names that there are.
        there: Vec<String>,
    },
}

/// A node on the graph.
///
/// See [`Ros2::joined`](super::Ros2::joined).
pub struct Joined {
    /// The graph.
    pub graph: Arc<dyn Graph>,
    /// Name of what carries it, and why that was chosen.
    pub carried_by: String,
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
) -> Result<Joined, JoinError> {
    let (wanted, asked_by) = match (wanted, environment.graph) {
        (Some(wanted), _) => (Some(wanted), "endpoints.ros2.graph"),
        (None, wanted) => (wanted, "WRAPYFI_ROS2_GRAPH"),
    };
    let security = environment.security;
    match wanted {
        Some(Adapter::Rmw) => return on_rmw(config, asked_by, enclave),
        Some(Adapter::Cyclone) => {
            check_security(security, enclave)?;
            return on_cyclone(config, asked_by);
        }
        None => {}
    }
    if cfg!(feature = "rmw") && security != Security::Off {
        return on_rmw(config, "ROS_SECURITY_ENABLE asks for keys", enclave);
    }
    check_security(security, enclave)?;
    if cfg!(feature = "rmw") && environment.means_rmw {
        if loads_cyclone()? {
            let config =
                CycloneConfig { services: Some(ServiceMapping::Cyclone), ..config.clone() };
            return on_cyclone(&config, "the rmw of this ROS 2 is rmw_cyclonedds_cpp");
        }
        return on_rmw(config, &environment.stack_reason, enclave);
    }
    on_cyclone(config, &environment.stack_reason)
}

/// Remedy of a node on CycloneDDS inside that is asked for keys.
const KEYS_REMEDY: &str = if cfg!(feature = "rmw") {
    "unset WRAPYFI_ROS2_GRAPH and endpoints.ros2.graph, or set them to rmw"
} else {
    build!()
};

/// Refuses what CycloneDDS inside cannot keep, and warns of what it leaves out: once, because each node of a
/// program comes by here.
fn check_security(security: Security, enclave: &str) -> Result<(), JoinError> {
    static WARNED: Once = Once::new();
    match security {
        Security::Enforce => return Err(JoinError::NoKeys(KEYS_REMEDY)),
        Security::Permissive => WARNED.call_once(|| {
            tracing::warn!(
                "ROS_SECURITY_ENABLE=true has no effect: CycloneDDS inside this program uses no keys, and everybody may read and publish; to use them, {KEYS_REMEDY}"
            );
        }),
        Security::Off if enclave != "/" => WARNED.call_once(|| {
            tracing::warn!(
                "--enclave {enclave} has no effect: CycloneDDS inside this program uses no keys; to use them, {KEYS_REMEDY}"
            );
        }),
        Security::Off => {}
    }
    Ok(())
}

/// Refuses an interface that does not exist, of which CycloneDDS says no more than that it could not open the domain.
fn check_interface(config: &CycloneConfig) -> Result<(), JoinError> {
    let (Some(name), Ok(listed)) = (&config.interface, std::fs::read_dir("/sys/class/net")) else {
        return Ok(());
    };
    let names = listed.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
    let mut there: Vec<String> = names.collect();
    // CycloneDDS takes the address of an interface as well.
    if there.contains(name) || name.parse::<std::net::IpAddr>().is_ok() {
        return Ok(());
    }
    there.sort();
    Err(JoinError::NoInterface { name: name.clone(), there })
}

fn on_cyclone(config: &CycloneConfig, reason: &str) -> Result<Joined, JoinError> {
    check_interface(config)?;
    tracing::info!(
        domain = config.domain_id,
        range = ?config.discovery_range,
        services = config.services.map_or("of both DDS vendors", ServiceMapping::rmw),
        reason,
        "ROS 2 is on CycloneDDS inside this program"
    );
    if !cfg!(feature = "rmw") && config.services == Some(ServiceMapping::FastDds) {
        tracing::info!(concat!(
            "topics of CycloneDDS and Fast DDS interoperate; to speak through the middleware of ROS 2 itself, ",
            build!()
        ));
    }
    let graph = Arc::new(CycloneGraph::new(config)?);
    Ok(Joined { graph, carried_by: format!("CycloneDDS inside ({reason})") })
}

/// True when the middleware that ROS 2 loads is CycloneDDS's.
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
fn on_rmw(config: &CycloneConfig, reason: &str, enclave: &str) -> Result<Joined, JoinError> {
    let refused = |fault: wrapyfi_rmw::Fault| match fault.wants_keys() {
        true => JoinError::WithoutKeys(fault.to_string()),
        false => JoinError::Rmw(fault.to_string()),
    };
    let rmw = wrapyfi_rmw::implementation().map_err(refused)?;
    tracing::info!(
        domain = config.domain_id,
        range = ?config.discovery_range,
        reason,
        "ROS 2 is on {rmw}, through the rmw of this ROS 2"
    );
    if let Some(interface) = &config.interface {
        tracing::warn!(
            "endpoints.ros2.interface: {interface} has no effect on {rmw}: set its own configuration"
        );
    }
    let graph = Arc::new(super::rmw_graph::RmwGraph::new(config, enclave).map_err(refused)?);
    Ok(Joined { graph, carried_by: format!("{rmw} ({reason})") })
}

#[cfg(not(feature = "rmw"))]
fn on_rmw(_: &CycloneConfig, asked_by: &str, _: &str) -> Result<Joined, JoinError> {
    Err(JoinError::NotBuilt(asked_by.to_owned()))
}

#[cfg(all(test, not(feature = "rmw")))]
mod tests {
    use super::*;
    use crate::environment;
    use wrapyfi_node::NodeName;

    #[test]
    fn who_asks_for_what_was_not_built_is_told_what_to_build() {
        let set = |name: &str| (name == "WRAPYFI_ROS2_GRAPH").then(|| "rmw".to_owned());
        let environment = environment::read(set).unwrap();
        let config = CycloneConfig::loopback(NodeName::new("n", "/").unwrap(), 0);
        for (wanted, asked_by) in
            [(None, "WRAPYFI_ROS2_GRAPH"), (Some(Adapter::Rmw), "endpoints.ros2.graph")]
        {
            let error = join(&config, &environment, wanted, "/").err().unwrap();
            assert_eq!(error, JoinError::NotBuilt(asked_by.to_owned()));
            let said = error.to_string();
            assert!(said.starts_with(asked_by), "{said}");
            assert!(said.contains("colcon build --packages-up-to wrapyfi_bridge"), "{said}");
        }
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn an_interface_that_does_not_exist_is_named_with_those_that_do() {
        let mut config = CycloneConfig::loopback(NodeName::new("n", "/").unwrap(), 0);
        config.interface = Some("eth99".to_owned());
        let error = join(&config, &environment::read(|_| None).unwrap(), None, "/").err().unwrap();
        let said = error.to_string();
        assert!(said.contains("no network interface \"eth99\"; it has "), "{said}");
        assert!(said.contains("lo"), "{said}");
    }

    #[test]
    fn keys_that_are_enforced_are_refused() {
        for graph in [None, Some("cyclone")] {
            let environment = environment::read(|name| {
                let value = match name {
                    "ROS_SECURITY_ENABLE" => Some("true"),
                    "ROS_SECURITY_STRATEGY" => Some("Enforce"),
                    "WRAPYFI_ROS2_GRAPH" => graph,
                    _ => None,
                };
                value.map(str::to_owned)
            });
            let config = CycloneConfig::loopback(NodeName::new("n", "/").unwrap(), 0);
            for enclave in ["/", "/lab"] {
                let error = join(&config, &environment.clone().unwrap(), None, enclave);
                let said = error.err().unwrap().to_string();
                assert!(said.starts_with("ROS_SECURITY_ENABLE=true"), "{said}");
                assert!(said.contains("colcon build --packages-up-to wrapyfi_bridge"), "{said}");
            }
        }
    }
}
