//! The bridge as a ROS 2 node: its name, its remap rules, its parameters.
//!
//! ```text
//!   ros2 run wrapyfi_bridge bridge --ros-args -r __ns:=/lab -p config_file:=bridge.yaml
//!     argv ─▶ RosArgs ─▶ NodeOptions (name, parameters, log level)
//!                    └─▶ Node::resolve_topic: "ros2:chatter" in a route -> /lab/chatter
//! ```

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use wrapyfi_core::node::args::RosArgs;
use wrapyfi_core::node::parameters::{DeclareError, ParameterDescriptor, ParameterStore};
use wrapyfi_core::node::{
    LogLevel, NameError, NodeName, NodeOptions, ParameterType, ParameterValue, read_params_file,
};

use crate::command::bridge::{self, Options};
use crate::exit::{Failure, finish};
use crate::logging;
use crate::shutdown::Shutdown;

/// Name of the bridge's node unless it is remapped.
const DEFAULT_NAME: &str = "wrapyfi_bridge";

/// A node's name, the remap rules that apply to its topics, and its parameters' overrides.
#[derive(Debug, Clone)]
pub struct Node {
    name: NodeName,
    args: Arc<RosArgs>,
    overrides: BTreeMap<String, ParameterValue>,
}

impl Node {
    /// A node called `name` in the root namespace, without remap rules.
    ///
    /// # Errors
    /// When the name breaks the rules of the graph.
    pub fn named(name: &str) -> Result<Self, NameError> {
        let (args, overrides) = (Arc::default(), BTreeMap::new());
        Ok(Self { name: NodeName::new(name, "/")?, args, overrides })
    }

    /// A node of a command: hidden from `ros2 node list`, with a name no other process has.
    ///
    /// # Errors
    /// Never in practice: the name is made of letters and digits.
    pub fn hidden() -> Result<Self, NameError> {
        Self::named(&format!("_wrapyfi_{}", std::process::id()))
    }

    /// The bridge's node under its default name.
    ///
    /// # Errors
    /// Never in practice, as [`Node::hidden`].
    pub fn bridge() -> Result<Self, NameError> {
        Self::named(DEFAULT_NAME)
    }

    /// Name and namespace.
    #[must_use]
    pub fn name(&self) -> &NodeName {
        &self.name
    }

    /// Whether its log lines go to `/rosout`.
    #[must_use]
    pub fn logs_to_rosout(&self) -> bool {
        self.args.rosout_logs
    }

    /// The parameters that every node has, with the values that the command line gives them.
    ///
    /// # Errors
    /// When one of them is given another type.
    pub fn parameters(&self) -> Result<ParameterStore, DeclareError> {
        ParameterStore::new(&self.name, self.overrides.clone())
    }

    /// The absolute name of a topic as this node sees it: expanded in its namespace, remapped.
    ///
    /// # Errors
    /// When the name breaks the rules of the graph.
    pub fn resolve_topic(&self, topic: &str) -> Result<String, NameError> {
        self.args.resolve_topic(&self.name, topic)
    }
}

/// Runs the node executable `bridge`: reads the process's arguments, returns its exit code.
#[must_use]
pub fn main() -> ExitCode {
    finish(run(std::env::args().skip(1)))
}

fn run(argv: impl Iterator<Item = String>) -> Result<(), Failure> {
    let args = RosArgs::parse(argv, read_params_file)
        .map_err(|error| Failure::usage(format!("failed to initialize: {error}")))?;
    let options = NodeOptions::resolve(DEFAULT_NAME, "/", &args).map_err(Failure::usage)?;
    let level = match options.log_level {
        LogLevel::Unset | LogLevel::Info => "info",
        LogLevel::Debug => "debug",
        LogLevel::Warn => "warn",
        LogLevel::Error | LogLevel::Fatal => "error",
    };
    logging::start_as(&options.name.logger_name(), level, args.stdout_logs)
        .map_err(Failure::usage)?;
    for warning in &args.warnings {
        tracing::warn!("{warning}");
    }
    if let Some(word) = args.program_args.first() {
        let text = format!(
            "argument {word:?} is not known; parameters are given as --ros-args -p name:=value"
        );
        return Err(Failure::Usage(text));
    }
    let node = Node { name: options.name, args: Arc::new(args), overrides: options.parameters };
    let mut store = node.parameters().map_err(Failure::usage)?;
    let parameters = Parameters::declare(&mut store)?;
    let shutdown = Shutdown::on_signals().context("cannot catch signals")?;
    bridge::run_node(&parameters.config_file, &node, store, parameters.options, &shutdown)
}

/// The parameters of the bridge node.
#[derive(Debug)]
struct Parameters {
    config_file: PathBuf,
    options: Options,
}

impl Parameters {
    /// Declares them; they are fixed from the start on.
    fn declare(store: &mut ParameterStore) -> Result<Self, Failure> {
        let fixed = |name: &str, text: &str| {
            ParameterDescriptor::new(name).with_description(text).read_only()
        };
        let config_file = fixed("config_file", "Path of the file with the routes.")
            .with_type(ParameterType::String);
        let config_file =
            store.declare(config_file, ParameterValue::NotSet).map_err(Failure::usage)?;
        // `seconds:=20` is an integer, `seconds:=0.5` is not: both are meant. A value from the start
        // on, because `ros2 param dump` writes null for what has none, and null in a parameter file
        // is a text.
        let seconds = fixed("seconds", "How long to run; 0: until interrupted.").dynamic();
        let seconds = store.declare(seconds, 0.0).map_err(Failure::usage)?;
        let json = fixed("status_json", "Print the routes' status as JSON once a second.");
        let json = store.declare(json, false).map_err(Failure::usage)?;
        let ParameterValue::String(config_file) = config_file else {
            return Err(Failure::usage(
                "no configuration: give --ros-args -p config_file:=/path/to/bridge.yaml",
            ));
        };
        let seconds = match seconds {
            ParameterValue::Double(0.0) | ParameterValue::Integer(0) => None,
            ParameterValue::Double(seconds) => Duration::try_from_secs_f64(seconds).ok(),
            ParameterValue::Integer(seconds) => {
                u64::try_from(seconds).ok().map(Duration::from_secs)
            }
            other => {
                let text = format!(
                    "parameter seconds is {other}, a {}; it must be a number",
                    other.type_name()
                );
                return Err(Failure::Usage(text));
            }
        };
        let options = Options { seconds, json: json == ParameterValue::Bool(true) };
        Ok(Self { config_file: PathBuf::from(config_file), options })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `ros2 param dump` writes null for what has no value, which comes back as a text.
    #[test]
    fn every_parameter_has_a_value_that_a_dump_can_bring_back() {
        let name = NodeName::new(DEFAULT_NAME, "/").unwrap();
        let file = ParameterValue::String("routes.yaml".to_owned());
        let overrides = BTreeMap::from([("config_file".to_owned(), file)]);
        let mut store = ParameterStore::new(&name, overrides).unwrap();
        let parameters = Parameters::declare(&mut store).unwrap();
        assert_eq!(parameters.options.seconds, None);
        let dump: BTreeMap<String, ParameterValue> =
            store.names().map(|name| (name.to_owned(), store.get(name).unwrap().clone())).collect();
        assert!(!dump.values().any(|value| *value == ParameterValue::NotSet), "{dump:?}");
        let mut again = ParameterStore::new(&name, dump).unwrap();
        assert_eq!(Parameters::declare(&mut again).unwrap().options.seconds, None);
    }
}
