//! `endpoints.ros` of a configuration, and the middleware that it makes.

use std::collections::BTreeMap;

use serde::Deserialize;
use wrapyfi_core::engine::Available;
pub(super) use wrapyfi_core::middleware::ros1::NAME;
use wrapyfi_core::middleware::ros1::{self, Ros1, Ros1Config, StartError};

use crate::exit::Failure;

/// The middleware as routes and commands address it, with its rules for topics.
pub(super) const AVAILABLE: Available<'static> =
    Available { name: NAME, check_topic: &ros1::check_name, options: &[] };

/// `endpoints.ros`; what is left out comes from `ROS_MASTER_URI`, `ROS_HOSTNAME`, `ROS_IP` and
/// `ROS_NAMESPACE`.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[allow(missing_docs)] // config/example.yaml is the manual
pub struct Ros1Section {
    pub master_uri: Option<String>,
    pub hostname: Option<String>,
    pub namespace: Option<String>,
    pub node: Option<String>,
    pub remap: BTreeMap<String, String>,
    pub insecure: bool,
}

impl Ros1Section {
    /// Starts the middleware.
    ///
    /// # Errors
    /// Exit code 2 for settings that cannot work, 1 when it does not start.
    pub fn start(&self) -> Result<Ros1, Failure> {
        let mut config = Ros1Config::from_env().map_err(Failure::usage)?;
        let Ros1Section { master_uri, hostname, namespace, node, remap, insecure } = self.clone();
        config.master_uri = master_uri.unwrap_or(config.master_uri);
        config.hostname = hostname.or(config.hostname);
        config.namespace = namespace.unwrap_or(config.namespace);
        config.node = node.or(config.node);
        config.remaps = remap.into_iter().collect();
        config.insecure |= insecure;
        Ros1::start(&config).map_err(|error| match error {
            StartError::Config(error) => Failure::usage(error),
            other => anyhow::Error::new(other).context("ros").into(),
        })
    }
}
