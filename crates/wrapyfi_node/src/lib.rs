//! The parts of a ROS 2 node above any transport: name, parameters, log, time, types.
//!
//! ```text
//!   defaults: wrapyfi_bridge in /  ─┐
//!                                   ├─▶ NodeOptions: name, parameters, log level
//!   command line ─▶ args::RosArgs  ─┘            │
//!                                                ▼
//!                              parameters::ParameterStore ◀─▶ the six parameter services
//!                              type_description           ◀── ~/get_type_description
//!                              LogLine ─▶ /rosout    RosTime ◀── /clock
//!                              logger_services           ◀── ~/get_logger_levels, ~/set_logger_levels
//! ```
//!
//! None of these has a socket or a clock: bytes, messages and the time come from the code that
//! serves the node.

#[macro_use]
mod node_service;

pub mod args;
mod log;
mod log_level;
pub mod logger_services;
mod name;
pub mod parameters;
mod ros_time;
#[cfg(test)]
mod test_data;
pub mod type_description;

use std::collections::BTreeMap;
use std::io::{self, Read as _};

pub use log::LogLine;
pub use log_level::LogLevel;
pub use name::{NameError, NodeName};
pub use ros_time::{ClockError, RosTime};
use wrapyfi_interfaces::builtin_interfaces::msg::Time;

use args::RosArgs;
use wrapyfi_data::types::Stamp;
pub use wrapyfi_data::types::{ParameterType, ParameterValue};

/// Last parts of the names of the services that a node of ROS 2 offers about itself, also a managed one.
pub const NODE_SERVICES: &[&str] = &[
    "get_parameters",
    "get_parameter_types",
    "set_parameters",
    "set_parameters_atomically",
    "list_parameters",
    "describe_parameters",
    "get_type_description",
    "get_logger_levels",
    "set_logger_levels",
    "change_state",
    "get_state",
    "get_available_states",
    "get_available_transitions",
    "get_transition_graph",
];

/// Parameters that every node has and that are true or false.
const NODE_SWITCHES: [&str; 2] = ["use_sim_time", "start_type_description_service"];

/// A node as its process starts it: its own defaults, changed by the command line.
///
/// ```
/// use wrapyfi_node::{NodeOptions, args::RosArgs, read_params_file};
/// let argv = ["--ros-args", "-r", "__ns:=/robot", "-p", "rate:=10"];
/// let args = RosArgs::parse(argv, read_params_file)?;
/// let options = NodeOptions::resolve("wrapyfi_bridge", "/", &args)?;
/// assert_eq!(options.name.fqn(), "/robot/wrapyfi_bridge");
/// assert_eq!(options.parameters["rate"].type_name(), "INTEGER");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct NodeOptions {
    /// Name and namespace after remapping.
    pub name: NodeName,
    /// Parameters given from outside, which replace the node's own.
    pub parameters: BTreeMap<String, ParameterValue>,
}

impl NodeOptions {
    /// Applies a command line to a node's default name and namespace.
    ///
    /// # Errors
    /// When the name or namespace is not valid, or when a parameter that every node has is given
    /// with another type.
    pub fn resolve(name: &str, namespace: &str, args: &RosArgs) -> Result<Self, NodeOptionsError> {
        let name = args.node_name(name);
        let name = NodeName::new(&name, &args.namespace(namespace, &name))?;
        let parameters = args.parameters_for(&name.fqn());
        for switch in NODE_SWITCHES {
            match parameters.get(switch) {
                None | Some(ParameterValue::NotSet | ParameterValue::Bool(_)) => {}
                Some(value) => {
                    return Err(NodeOptionsError::SwitchType {
                        name: switch,
                        value: value.to_string(),
                        found: value.type_name(),
                    });
                }
            }
        }
        Ok(Self { name, parameters })
    }
}

/// Error of the options with which a node is to start.
///
/// ```
/// use wrapyfi_node::{NodeOptions, args::RosArgs, read_params_file};
/// let words = ["--ros-args", "-p", "use_sim_time:=5"].map(str::to_owned);
/// let args = RosArgs::parse(words, read_params_file)?;
/// let error = NodeOptions::resolve("camera", "/", &args).unwrap_err().to_string();
/// assert!(error.starts_with("Trying to set parameter 'use_sim_time' to '5' of type 'INTEGER'"));
/// # Ok::<(), wrapyfi_node::args::RosArgsError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum NodeOptionsError {
    /// The name or namespace is not valid.
    #[error(transparent)]
    Name(#[from] NameError),
    /// A parameter that is true or false in every node was given another type.
    #[error(
        "Trying to set parameter '{name}' to '{value}' of type '{found}', expecting type 'BOOL': \
         {name}"
    )]
    SwitchType {
        /// Name of the parameter.
        name: &'static str,
        /// Value it was given.
        value: String,
        /// Type of that value.
        found: &'static str,
    },
}

/// Reads a parameter file for [`RosArgs::parse`], stopping where it is too large anyway.
///
/// # Errors
/// When the file cannot be opened or read.
pub fn read_params_file(path: &str) -> io::Result<Vec<u8>> {
    let mut content = Vec::new();
    let most = u64::try_from(args::MAX_FILE_BYTES).unwrap_or(u64::MAX).saturating_add(1);
    std::fs::File::open(path)?.take(most).read_to_end(&mut content)?;
    Ok(content)
}

/// Converts a stamp to the form of messages.
fn time(stamp: Stamp) -> Time {
    Time { sec: stamp.sec, nanosec: stamp.nanosec }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_read_as_far_as_they_may_go() {
        let own = concat!(env!("CARGO_MANIFEST_DIR"), "/Cargo.toml");
        assert!(read_params_file(own).unwrap().starts_with(b"[package]"));
        assert!(read_params_file("/").is_err());
        if cfg!(target_os = "linux") {
            let endless = read_params_file("/dev/zero").unwrap();
            assert_eq!(endless.len(), args::MAX_FILE_BYTES + 1);
        }
    }

    #[test]
    fn a_missing_file_says_why_in_its_source() {
        let argv = ["--ros-args", "--params-file", "/nowhere/at/all.yaml"];
        let error = RosArgs::parse(argv, read_params_file).unwrap_err();
        assert!(error.to_string().ends_with("Error: Error opening YAML file"));
        let source = std::error::Error::source(&error).unwrap().to_string();
        assert!(source.contains("No such file"), "{source}");
    }
}
