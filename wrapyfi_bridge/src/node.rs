//! The bridge as a ROS 2 node: its name, its remap rules, its parameters.
//!
//! ```text
//!   ros2 run wrapyfi_bridge bridge --ros-args -r __ns:=/lab -p config_file:=bridge.yaml
//!     argv ─▶ RosArgs ─▶ NodeOptions (name, parameters, log level)
//!                    └─▶ Node::resolve_topic: "ros2:chatter" in a route -> /lab/chatter
//! ```

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use wrapyfi_core::node::args::RosArgs;
use wrapyfi_core::node::{
    LogLevel, NameError, NodeName, NodeOptions, ParameterValue, read_params_file,
};

use crate::command::bridge::{self, Options};
use crate::exit::{Failure, finish};
use crate::logging;
use crate::shutdown::Shutdown;

/// Name of the bridge's node unless it is remapped.
const DEFAULT_NAME: &str = "wrapyfi_bridge";

/// A node's name and the remap rules that apply to its topics.
#[derive(Debug, Clone)]
pub struct Node {
    name: NodeName,
    args: Arc<RosArgs>,
}

impl Node {
    /// A node called `name` in the root namespace, without remap rules.
    ///
    /// # Errors
    /// When the name breaks the rules of the graph.
    pub fn named(name: &str) -> Result<Self, NameError> {
        Ok(Self { name: NodeName::new(name, "/")?, args: Arc::default() })
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
        _ if !args.stdout_logs => "off",
        LogLevel::Unset | LogLevel::Info => "info",
        LogLevel::Debug => "debug",
        LogLevel::Warn => "warn",
        LogLevel::Error | LogLevel::Fatal => "error",
    };
    logging::start(&options.name.logger_name(), level).map_err(Failure::usage)?;
    for warning in &args.warnings {
        tracing::warn!("{warning}");
    }
    if let Some(word) = args.program_args.first() {
        let text = format!(
            "argument {word:?} is not known; parameters are given as --ros-args -p name:=value"
        );
        return Err(Failure::Usage(text));
    }
    let parameters = Parameters::read(&options)?;
    let shutdown = Shutdown::on_signals().context("cannot catch signals")?;
    let node = Node { name: options.name, args: Arc::new(args) };
    bridge::run_node(&parameters.config_file, &node, parameters.options, &shutdown)
}

/// The parameters of the bridge node.
#[derive(Debug)]
struct Parameters {
    config_file: PathBuf,
    options: Options,
}

impl Parameters {
    fn read(given: &NodeOptions) -> Result<Self, Failure> {
        let mut config_file = None;
        let mut options = Options::default();
        for (name, value) in &given.parameters {
            let wrong = |expected: &str| {
                let text = format!(
                    "parameter {name} is {value}, a {}; it must be {expected}",
                    value.type_name()
                );
                Err(Failure::Usage(text))
            };
            match (name.as_str(), value) {
                ("config_file", ParameterValue::String(path)) => {
                    config_file = Some(PathBuf::from(path));
                }
                ("config_file", _) => return wrong("the path of a file"),
                ("seconds", &ParameterValue::Double(seconds)) => {
                    options.seconds = Duration::try_from_secs_f64(seconds).ok();
                }
                ("seconds", &ParameterValue::Integer(seconds)) => {
                    options.seconds = u64::try_from(seconds).ok().map(Duration::from_secs);
                }
                ("seconds", _) => return wrong("a number"),
                ("status_json", &ParameterValue::Bool(json)) => options.json = json,
                ("status_json", _) => return wrong("true or false"),
                ("use_sim_time" | "start_type_description_service", _) => (),
                _ => tracing::warn!(
                    "parameter {name} is not one of this node's: config_file, seconds, status_json"
                ),
            }
        }
        let config_file = config_file.ok_or_else(|| {
            Failure::usage("no configuration: give --ros-args -p config_file:=/path/to/bridge.yaml")
        })?;
        Ok(Self { config_file, options })
    }
}
