//! `endpoints.ros2` of a configuration, and the middleware that it makes.

use std::sync::Arc;

use serde::Deserialize;
use wrapyfi_endpoint::config::{NamedSection, Problem, Spanned};
use wrapyfi_endpoint::driver::{
    Available, Driver, Reach, Section, Server, ServerAddress, StartNeeds,
};
use wrapyfi_endpoint::network::Hosts;
use wrapyfi_endpoint::{Conventions, Interaction, Planned, StartError};
use wrapyfi_node::NodeName;
use wrapyfi_node::args::RosArgs;

use super::environment::{Adapter, MAX_DOMAIN_ID, needs_zenoh_router};
use super::ros2::NAME;
use super::service::introspection;
use super::settings::Ros2Settings;

/// The middleware `ros2` for programs that are configured by a file.
pub const DRIVER: &dyn Driver = &Ros2Driver;

/// Port on which the router of rmw_zenoh_cpp listens.
const ZENOH_PORT: u16 = 7447;

struct Ros2Driver;

impl Driver for Ros2Driver {
    fn available(&self) -> Available<'static> {
        let conventions = Conventions {
            has_text_type: true,
            has_ros_names: true,
            program: "a ROS 2 node",
            ..Conventions::NONE
        };
        let check_topic = &check_topic;
        Available {
            name: NAME,
            check_topic,
            options: &[introspection::OPTION],
            check_option: &introspection::check_option,
            // In both: of services and actions alone.
            source_options: &[introspection::OPTION],
            destination_options: &[introspection::OPTION],
            interactions: &Interaction::ALL,
            conventions,
        }
    }

    fn section(&self) -> Box<dyn Section> {
        Box::new(Ros2Section::default())
    }
}

/// The rules do not depend on the node: any will do.
fn check_topic(topic: &str) -> Result<(), String> {
    let check = || NodeName::new("node", "/")?.expand(topic);
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

impl NamedSection for Ros2Section {
    const NAME: &'static str = NAME;

    fn example_of(key: &str) -> Option<&'static str> {
        match key {
            NAME => Some("{ domain_id: 0 }"),
            "domain_id" => Some("0"),
            _ => None,
        }
    }
}

impl Ros2Section {
    /// Domain of the section, else that of the environment.
    pub fn domain_id(&self, of_environment: u32) -> u32 {
        self.domain_id.as_ref().map_or(of_environment, |written| written.value)
    }

    /// All settings of a node with this name and these rules for names.
    ///
    /// # Errors
    /// When a variable of the environment has a value that it cannot have.
    pub fn settings(
        &self,
        name: &NodeName,
        args: &Arc<RosArgs>,
        largest_message: usize,
    ) -> Result<Ros2Settings, StartError> {
        let mut settings = Ros2Settings::of_node(name.clone(), |name| std::env::var(name).ok())?;
        let cyclone = &mut settings.cyclone;
        cyclone.domain_id = self.domain_id(cyclone.domain_id);
        cyclone.interface.clone_from(&self.interface);
        cyclone.max_message_bytes = largest_message;
        settings.adapter = self.graph;
        settings.enclave.clone_from(&args.enclave);
        let (name, args) = (name.clone(), Arc::clone(args));
        let remap =
            move |topic: &str| args.resolve_topic(&name, topic).map_err(|error| error.to_string());
        Ok(settings.remapped(remap))
    }

    /// All settings of a node of a program that asks and looks: hidden from `ros2 node list`, with a name that no other
    /// process has.
    ///
    /// # Errors
    /// As [`Self::settings`].
    pub fn hidden(&self, largest_message: usize) -> Result<Ros2Settings, StartError> {
        let name = NodeName::new(&format!("_wrapyfi_{}", std::process::id()), "/");
        self.settings(&name.map_err(StartError::refused)?, &Arc::default(), largest_message)
    }
}

impl Section for Ros2Section {
    /// Refuses a domain that has no ports.
    fn check(&self) -> Result<(), Problem> {
        match &self.domain_id {
            Some(written) if written.value > MAX_DOMAIN_ID => {
                let text =
                    format!("domain_id is {}, domains are 0 to {MAX_DOMAIN_ID}", written.value);
                Err(Problem::at(written.referenced, text))
            }
            _ => Ok(()),
        }
    }

    /// A hidden node; a bridge is a node of its own, and starts with [`Ros2Section::settings`].
    fn plan(&self, needs: &StartNeeds<'_>) -> Result<Planned, StartError> {
        Ok(Planned::new(format!("{self:?}"), self.hidden(needs.largest_message)?))
    }

    /// The router of Zenoh, where nodes of this process find others through one on this machine.
    fn servers(
        &self,
        _hosts: &Hosts,
        _interaction: Interaction,
    ) -> Result<Vec<ServerAddress>, StartError> {
        let needs_router = cfg!(feature = "rmw")
            && self.graph != Some(Adapter::Cyclone)
            && needs_zenoh_router(|name| std::env::var(name).ok());
        let router = || {
            ServerAddress {
            server: Server::Router,
            host: "localhost".to_owned(),
            port: ZENOH_PORT,
            is_own: false,
            start: "ros2 run rmw_zenoh_cpp rmw_zenohd    # or have ZENOH_SESSION_CONFIG_URI say where it runs"
                .to_owned(),
            reach: Reach::default(),
        }
        };
        Ok(needs_router.then(router).into_iter().collect())
    }
}
