//! `endpoints.ros2` of a configuration, and the middleware that it makes.

use serde::Deserialize;
use wrapyfi_core::start::Ros2Settings;
use wrapyfi_data::Limits;
use wrapyfi_endpoint::Conventions;
use wrapyfi_engine::{Available, Problem, Spanned};
use wrapyfi_ros2::environment::{MAX_DOMAIN_ID, needs_zenoh_router};
use wrapyfi_ros2::{Adapter, Ros2};

use super::start::start;
use crate::exit::{Failure, Result};
use crate::node::Node;

/// The middleware as routes and commands address it, with its rules for topics.
pub(super) const AVAILABLE: Available<'static> = Available {
    name: "ros2",
    check_topic: &check_topic,
    options: &[],
    check_option: &|_, _| Ok(()),
    source_options: &[],
    destination_options: &[],
    conventions: Conventions { has_text_type: true, has_ros_names: true, ..Conventions::NONE },
};

/// The rules do not depend on the node: any will do.
fn check_topic(topic: &str) -> Result<(), String> {
    let check = || Node::bridge()?.name().expand(topic);
    check().map(drop).map_err(|error| error.to_string())
}

/// `endpoints.ros2`; what is left out comes from the ROS 2 environment variables.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[allow(missing_docs)] // config/example.yaml is the manual
pub struct Ros2Section {
    pub domain_id: Option<Spanned<u32>>,
    pub interface: Option<String>,
    pub graph: Option<Adapter>,
}

impl Ros2Section {
    /// Domain of the section, else that of the environment.
    pub(crate) fn domain_id(&self, of_environment: u32) -> u32 {
        self.domain_id.as_ref().map_or(of_environment, |written| written.value)
    }

    /// True where nodes of this process find others through a Zenoh router on this machine.
    pub(super) fn needs_zenoh_router(&self) -> bool {
        cfg!(feature = "rmw")
            && self.graph != Some(Adapter::Cyclone)
            && needs_zenoh_router(|name| std::env::var(name).ok())
    }

    /// Refuses a domain that has no ports.
    pub(super) fn check(&self) -> Result<(), Problem> {
        match &self.domain_id {
            Some(written) if written.value > MAX_DOMAIN_ID => {
                let text =
                    format!("domain_id is {}, domains are 0 to {MAX_DOMAIN_ID}", written.value);
                Err(Problem::at(written.referenced, text))
            }
            _ => Ok(()),
        }
    }

    /// Starts the middleware as the node `node`.
    ///
    /// # Errors
    /// Exit code 2 for settings that cannot work, 1 when the DDS stack refuses.
    pub fn start(&self, node: &Node, largest_message: usize) -> Result<Ros2> {
        start("ros2", &self.settings(node, largest_message)?)
    }

    /// Starts the middleware as the hidden node of a program that asks and looks.
    ///
    /// # Errors
    /// As [`Self::start`].
    pub fn hidden(&self) -> Result<Ros2> {
        let node = Node::hidden().map_err(Failure::usage)?;
        self.start(&node, Limits::default().message_bytes)
    }

    /// All settings.
    ///
    /// # Errors
    /// Exit code 2 for variables of the environment that cannot be.
    pub(super) fn settings(&self, node: &Node, largest_message: usize) -> Result<Ros2Settings> {
        let variable = |name: &str| std::env::var(name).ok();
        let settings = Ros2Settings::of_node(node.name().clone(), variable);
        let mut settings = settings.map_err(Failure::usage)?;
        let cyclone = &mut settings.cyclone;
        cyclone.domain_id = self.domain_id(cyclone.domain_id);
        cyclone.interface.clone_from(&self.interface);
        cyclone.max_message_bytes = largest_message;
        settings.adapter = self.graph;
        settings.enclave.clone_from(&node.args.enclave);
        let node = node.clone();
        let remap = move |topic: &str| node.resolve_topic(topic).map_err(|error| error.to_string());
        Ok(settings.remapped(remap))
    }
}
