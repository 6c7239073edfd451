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
use crate::middlewares;
use crate::shutdown::Shutdown;
use crate::whole::{Selection, Whole};

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
    finish(run(std::env::args().skip(1), None))
}

/// As [`main`], for an executable that bridges all of a middleware.
#[must_use]
pub fn main_of_whole(whole: Whole) -> ExitCode {
    finish(run(std::env::args().skip(1), Some(whole)))
}

fn run(argv: impl Iterator<Item = String>, whole: Option<Whole>) -> Result<(), Failure> {
    let default_name = whole.map_or(DEFAULT_NAME, Whole::node);
    let args = RosArgs::parse(argv, read_params_file)
        .map_err(|error| Failure::usage(format!("failed to initialize: {error}")))?;
    let options = NodeOptions::resolve(default_name, "/", &args).map_err(Failure::usage)?;
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
    let config = config_argument(&args.program_args)?;
    let node = Node { name: options.name, args: Arc::new(args), overrides: options.parameters };
    let mut store = node.parameters().map_err(Failure::usage)?;
    let parameters = Parameters::declare(&mut store, whole, config)?;
    let shutdown = Shutdown::on_signals().context("cannot catch signals")?;
    let Parameters { configuration, options } = parameters;
    let (loaded, name) = match configuration {
        Configuration::File(file) => {
            (middlewares::load_and_learn(&file)?, file.display().to_string())
        }
        Configuration::BuiltIn(text, name) => (middlewares::load_text(&text, name)?, name.into()),
    };
    bridge::run_node(loaded, &name, &node, store, options, &shutdown)
}

/// The file of `--config FILE`, the only argument that is not ROS's.
fn config_argument(words: &[String]) -> Result<Option<String>, Failure> {
    let mut words = words.iter();
    let Some(word) = words.next() else { return Ok(None) };
    let file = match word.strip_prefix("--config=") {
        None if word == "--config" => words.next().cloned(),
        file => file.map(str::to_owned),
    };
    match (file, words.next()) {
        (Some(file), None) => Ok(Some(file)),
        (None, _) if word.starts_with("--config") => {
            Err(Failure::usage("--config needs the path of a configuration"))
        }
        (file, other) => {
            let unknown = other.filter(|_| file.is_some()).unwrap_or(word);
            Err(Failure::Usage(format!(
                "argument {unknown:?} is not known; there is --config FILE, and parameters are given as \
                 --ros-args -p name:=value"
            )))
        }
    }
}

/// The parameters of the bridge node.
#[derive(Debug)]
struct Parameters {
    configuration: Configuration,
    options: Options,
}

/// Where the routes are.
#[derive(Debug)]
enum Configuration {
    File(PathBuf),
    /// The text, and a name for it.
    BuiltIn(String, &'static str),
}

impl Parameters {
    /// Declares them; they are fixed from the start on.
    fn declare(
        store: &mut ParameterStore,
        whole: Option<Whole>,
        config: Option<String>,
    ) -> Result<Self, Failure> {
        let fixed = |name: &str, text: &str| {
            ParameterDescriptor::new(name).with_description(text).read_only()
        };
        let config_file = fixed("config_file", "Path of the file with the routes.")
            .with_type(ParameterType::String);
        let by_default = match config {
            Some(file) => ParameterValue::String(file),
            None if whole.is_some() => "".into(),
            None => ParameterValue::NotSet,
        };
        let config_file = store.declare(config_file, by_default).map_err(Failure::usage)?;
        let built_in = match whole {
            None => None,
            Some(whole) => {
                let mut declare = |name: &str, text: &str, value: ParameterValue| {
                    store.declare(fixed(name, text), value).map_err(Failure::usage)
                };
                let names = |given| match given {
                    ParameterValue::StringArray(names) => names,
                    _ => Vec::new(),
                };
                let none = || ParameterValue::StringArray(Vec::new());
                let meant = "Names that are bridged, as regular expressions; none: all.";
                let allow = names(declare("allow", meant, none())?);
                let deny = "Names that are not, as regular expressions.";
                let deny = names(declare("deny", deny, none())?);
                let prefix = "Put before names on the ROS 2 side.";
                let prefix = match declare("prefix", prefix, "".into())? {
                    ParameterValue::String(prefix) => prefix,
                    _ => String::new(),
                };
                Some((whole, Selection { allow, deny, prefix }))
            }
        };
        // `seconds:=20` is an integer, `seconds:=0.5` is not: both are meant. A value from the start
        // on, because `ros2 param dump` writes null for what has none, and null in a parameter file
        // is a text.
        let seconds = fixed("seconds", "How long to run; 0: until interrupted.").dynamic();
        let seconds = store.declare(seconds, 0.0).map_err(Failure::usage)?;
        let json = fixed("status_json", "Print the routes' status as JSON once a second.");
        let json = store.declare(json, false).map_err(Failure::usage)?;
        let configuration = match (config_file, built_in) {
            (ParameterValue::String(file), None) => Configuration::File(file.into()),
            (ParameterValue::String(file), Some((whole, selection))) if !file.is_empty() => {
                if selection != Selection::default() {
                    return Err(Failure::Usage(format!(
                        "parameters allow, deny and prefix are for the built-in configuration of {}; \
                         with config_file, write them into the file",
                        whole.node()
                    )));
                }
                Configuration::File(file.into())
            }
            (_, Some((whole, selection))) => {
                let text = whole.yaml(&selection).map_err(Failure::Usage)?;
                Configuration::BuiltIn(text, whole.node())
            }
            (_, None) => {
                return Err(Failure::usage(
                    "no configuration: give --config /path/to/bridge.yaml, or --ros-args -p \
                     config_file:=/path/to/bridge.yaml",
                ));
            }
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
        Ok(Self { configuration, options })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_configuration_is_an_argument_too() {
        let read = |words: &[&str]| {
            let words: Vec<String> = words.iter().map(|word| (*word).to_owned()).collect();
            config_argument(&words).map_err(|failure| failure.to_string())
        };
        assert_eq!(read(&[]), Ok(None));
        assert_eq!(read(&["--config", "a.yaml"]), Ok(Some("a.yaml".to_owned())));
        assert_eq!(read(&["--config=a.yaml"]), Ok(Some("a.yaml".to_owned())));
        assert!(read(&["--config"]).unwrap_err().contains("path"));
        assert!(read(&["--config", "a.yaml", "more"]).unwrap_err().contains("\"more\""));
        assert!(read(&["routes.yaml"]).unwrap_err().contains("\"routes.yaml\""));
    }

    /// `ros2 param dump` writes null for what has no value, which comes back as a text.
    #[test]
    fn every_parameter_has_a_value_that_a_dump_can_bring_back() {
        for whole in [None, Some(Whole::Yarp)] {
            let name = NodeName::new(DEFAULT_NAME, "/").unwrap();
            let file = ParameterValue::String("routes.yaml".to_owned());
            let overrides = BTreeMap::from([("config_file".to_owned(), file)]);
            let mut store = ParameterStore::new(&name, overrides).unwrap();
            let parameters = Parameters::declare(&mut store, whole, None).unwrap();
            assert_eq!(parameters.options.seconds, None);
            let dump: BTreeMap<String, ParameterValue> = store
                .names()
                .map(|name| (name.to_owned(), store.get(name).unwrap().clone()))
                .collect();
            assert!(!dump.values().any(|value| *value == ParameterValue::NotSet), "{dump:?}");
            let mut again = ParameterStore::new(&name, dump).unwrap();
            assert_eq!(Parameters::declare(&mut again, whole, None).unwrap().options.seconds, None);
        }
    }

    #[test]
    fn what_the_built_in_configuration_takes_is_refused_beside_a_file() {
        let name = NodeName::new("ros1_bridge", "/").unwrap();
        let declare = |given: &[(&str, ParameterValue)]| {
            let given = given.iter().map(|(name, value)| ((*name).to_owned(), value.clone()));
            let mut store = ParameterStore::new(&name, given.collect()).unwrap();
            Parameters::declare(&mut store, Some(Whole::Ros1), None)
        };
        let built_in = declare(&[("prefix", "lab".into())]).unwrap();
        assert!(
            matches!(built_in.configuration, Configuration::BuiltIn(text, _) if text.contains("ros2:/lab/"))
        );
        let file = ("config_file", "routes.yaml".into());
        let Configuration::File(named) =
            declare(std::slice::from_ref(&file)).unwrap().configuration
        else {
            panic!("it is a file");
        };
        assert_eq!(named, PathBuf::from("routes.yaml"));
        let Err(Failure::Usage(error)) = declare(&[file, ("prefix", "lab".into())]) else {
            panic!("it is refused");
        };
        assert!(error.contains("write them into the file"), "{error}");
    }
}
