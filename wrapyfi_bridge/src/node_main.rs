//! The node executables: arguments and parameters to a bridge that runs.
//!
//! ```text
//!   ros2 run wrapyfi_bridge bridge --ros-args -r __ns:=/lab -p config_file:=bridge.yaml
//!     argv ─▶ RosArgs ─▶ NodeOptions (name, parameters, log level)
//!                    └─▶ Node::resolve_topic: "ros2:chatter" in a route -> /lab/chatter
//! ```

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use clap::{CommandFactory as _, FromArgMatches as _};
use tracing_subscriber::filter::LevelFilter;
use wrapyfi_node::args::RosArgs;
use wrapyfi_node::parameters::{ParameterDescriptor, ParameterStore};
use wrapyfi_node::{NodeOptions, ParameterType, ParameterValue, read_params_file};

use crate::cli::{BridgeArgs, NodeCli};
use crate::command::bridge;
use crate::exit::{Failure, Result};
use crate::in_force::{Options, change_endpoints};
use crate::logging;
use crate::middleware_bridge::{MiddlewareBridge, Selection};
use crate::node::{DEFAULT_NAME, Node};
use crate::own_address::OwnAddress;
use crate::reload::Source;
use crate::shutdown::Shutdown;

/// Node executable whose name the program was started by: a bridge of all of a middleware, or none of them for
/// `bridge`. No node for any other name.
pub fn executable(program: Option<OsString>) -> Option<Option<MiddlewareBridge>> {
    let name = Path::new(&program?).file_name()?.to_str()?.to_owned();
    match name.as_str() {
        "bridge" => Some(None),
        name => Some(Some(MiddlewareBridge::called(name)?)),
    }
}

/// Runs a node executable with the process's arguments.
///
/// # Errors
/// As [`run`].
pub fn run_executable(bridge: Option<MiddlewareBridge>) -> Result<()> {
    let ros = parse(std::env::args_os().skip(1))?;
    let (name, about) = match bridge {
        None => ("bridge", "Runs the routes of a configuration file, as a ROS 2 node.".to_owned()),
        Some(bridge) => (bridge.node(), bridge.about()),
    };
    let words = std::iter::once(name).chain(ros.program_args.iter().map(String::as_str));
    // Ends the program where help is asked for, or a word is not known.
    let matches = NodeCli::command().name(name).about(about).get_matches_from(words);
    let cli = NodeCli::from_arg_matches(&matches).unwrap_or_else(|error| error.exit());
    run(&cli.args, ros, bridge, LevelFilter::INFO)
}

/// Words of the program, and those of ROS: from each `--ros-args` to `--` or the end.
pub fn split(words: impl Iterator<Item = OsString>) -> (Vec<OsString>, Vec<OsString>) {
    let mut is_ros = false;
    words.partition(|word| {
        let was_ros = is_ros;
        is_ros = if was_ros { word != "--" } else { word == "--ros-args" };
        !(was_ros || is_ros)
    })
}

/// Reads what ROS understands of a command line.
///
/// # Errors
/// Exit code 2 with the first thing that ROS 2 would refuse.
pub fn parse(words: impl Iterator<Item = OsString>) -> Result<RosArgs> {
    let words: Result<Vec<String>, OsString> = words.map(OsString::into_string).collect();
    let words =
        words.map_err(|word| Failure::Usage(format!("argument {word:?} is not UTF-8 text")))?;
    RosArgs::parse(words, read_params_file)
        .map_err(|error| Failure::usage(format!("failed to initialize: {error}")))
}

/// Enters the parameters that `args` stand for among those `given` as such.
fn enter(args: &BridgeArgs, given: &mut BTreeMap<String, ParameterValue>) -> Result<()> {
    let config = args.config.as_ref().map(|path| match path.to_str() {
        Some(path) => Ok(ParameterValue::from(path)),
        None => Err(Failure::Usage(format!("--config {}: not UTF-8 text", path.display()))),
    });
    let seconds = args.seconds.map(|time| ParameterValue::from(time.as_secs_f64()));
    let json = args.json.then(|| ParameterValue::from(true));
    let autostart = args.no_autostart.then(|| ParameterValue::from(false));
    let page = args.page.map(|port| ParameterValue::from(i64::from(port)));
    for (option, name, value) in [
        ("--config", "config_file", config.transpose()?),
        ("--seconds", "seconds", seconds),
        ("--json", "status_json", json),
        ("--page", "page_port", page),
        ("--no-autostart", "autostart", autostart),
    ] {
        let Some(value) = value else { continue };
        if let Some(other) = given.insert(name.to_owned(), value.clone())
            && other != value
        {
            return Err(Failure::Usage(format!(
                "{option} says {value}, and parameter {name} says {other}: give one of them"
            )));
        }
    }
    Ok(())
}

/// Runs the bridge as a ROS 2 node, with the routes that `args` or `ros` name, or those built in for
/// `bridge`. Log lines that `level` lets through are written, unless `ros` says otherwise.
///
/// # Errors
/// Exit code 2 when arguments or configuration are refused, 1 when a middleware cannot start.
pub fn run(
    args: &BridgeArgs,
    ros: RosArgs,
    bridge: Option<MiddlewareBridge>,
    level: LevelFilter,
) -> Result<()> {
    let default_name = bridge.map_or(DEFAULT_NAME, MiddlewareBridge::node);
    wrapyfi_endpoint::start_small();
    // First: what follows may take its time.
    let shutdown = Shutdown::on_signals().context("cannot catch signals")?;
    let options = NodeOptions::resolve(default_name, "/", &ros).map_err(Failure::usage)?;
    logging::start_as(&options.name.logger_name(), level, ros.log_levels(), ros.stdout_logs);
    for warning in &ros.warnings {
        tracing::warn!("{warning}");
    }
    let mut overrides = options.parameters;
    enter(args, &mut overrides)?;
    let node = Node { name: options.name, args: Arc::new(ros), overrides };
    let mut store = node.parameters().map_err(Failure::usage)?;
    let (source, mut options) = declared(&mut store, bridge)?;
    options.own = args.own;
    let loaded =
        source.load(&[], |endpoints| change_endpoints(endpoints, &node, &mut store, &options))?;
    shutdown.outcome(bridge::run(loaded, source, &node, store, options, &shutdown))
}

/// Declares the parameters of the bridge node, which are fixed from the start on: where its configuration is, and its
/// options.
fn declared(
    store: &mut ParameterStore,
    bridge: Option<MiddlewareBridge>,
) -> Result<(Source, Options)> {
    let mut declare = |name: &str, text: &str, value: ParameterValue| {
        let fixed = ParameterDescriptor::new(name).with_description(text).read_only();
        let fixed = match name {
            "config_file" => fixed.with_type(ParameterType::String),
            // `seconds:=20` is an integer, `seconds:=0.5` is not: both are meant.
            "seconds" => fixed.dynamic(),
            "page_port" => fixed.with_integer_range(0, u16::MAX.into(), 1),
            "service_timeout_ms" => fixed.with_integer_range(0, 86_400_000, 1),
            _ => fixed,
        };
        store.declare(fixed, value).map_err(Failure::usage)
    };
    let by_default = if bridge.is_some() { "".into() } else { ParameterValue::NotSet };
    let config_file = declare("config_file", "Path of the file with the routes.", by_default)?;
    let built_in = match bridge {
        None => None,
        Some(bridge) => {
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
            let meant = "Leaves out hidden names, those of the logs, of time and of every node.";
            let has_hidden =
                declare("default_deny", meant, true.into())? == ParameterValue::Bool(false);
            let meant = "Milliseconds that a call may take; 0: as in a configuration, 5000.";
            let service_timeout_ms =
                count(&declare("service_timeout_ms", meant, 0.into())?).filter(|ms| *ms != 0);
            let meant = "Options of the routes that may have them, each NAME=VALUE: introspection=metadata.";
            let options = names(declare("options", meant, none())?);
            let mut switches = Vec::new();
            for &(name, meant) in bridge.switches() {
                if declare(name, meant, false.into())? == ParameterValue::Bool(true) {
                    switches.push(name);
                }
            }
            let selection = Selection {
                allow,
                deny,
                prefix,
                has_hidden,
                service_timeout_ms,
                options,
                switches,
            };
            Some((bridge, selection))
        }
    };
    // A value from the start on, because `ros2 param dump` writes null for what has none, and null in a
    // parameter file is a text.
    let meant = "How long to run; 0: until interrupted.";
    let seconds = declare("seconds", meant, 0.0.into())?;
    let meant = "Print the routes' status as JSON once a second.";
    let json = declare("status_json", meant, false.into())? == ParameterValue::Bool(true);
    let meant = "Configures and activates the node at its start, without anybody who asks for it.";
    let no_autostart = declare("autostart", meant, true.into())? == ParameterValue::Bool(false);
    let meant = "Port of the live page; 0: as the configuration says.";
    let page = declare("page_port", meant, 0.into())?;
    let source = match (config_file, built_in) {
        (ParameterValue::String(file), None) => Source::File(file.into()),
        (ParameterValue::String(file), Some((bridge, selection))) if !file.is_empty() => {
            if selection != Selection::default() {
                let switches = bridge.switches().iter();
                let switches: String = switches.map(|(name, _)| format!(", {name}")).collect();
                return Err(Failure::Usage(format!(
                    "parameters allow, deny, prefix, default_deny, service_timeout_ms, options{switches} are for the built-in \
                     configuration of {}; with config_file, write them into the file",
                    bridge.node()
                )));
            }
            Source::File(file.into())
        }
        (_, Some((bridge, selection))) => {
            let text = bridge.yaml(&selection).map_err(Failure::Usage)?;
            Source::Text(text, bridge.node().to_owned())
        }
        (_, None) => {
            return Err(Failure::usage(
                "no configuration: give --config FILE, or --ros-args -p config_file:=FILE",
            ));
        }
    };
    let seconds = match seconds {
        ParameterValue::Double(0.0) | ParameterValue::Integer(0) => None,
        ParameterValue::Double(seconds) => Duration::try_from_secs_f64(seconds).ok(),
        seconds @ ParameterValue::Integer(_) => count(&seconds).map(Duration::from_secs),
        other => {
            let text = format!(
                "parameter seconds is {other}, a {}; it must be a number",
                other.type_name()
            );
            return Err(Failure::Usage(text));
        }
    };
    let lives_with = bridge.map(|bridge| bridge.middleware);
    let page_port =
        count(&page).and_then(|port| u16::try_from(port).ok()).filter(|port| *port != 0);
    let own = OwnAddress::default();
    let options = Options { seconds, json, page_port, no_autostart, own, lives_with };
    Ok((source, options))
}

/// Number that a parameter is, where it is one from zero on.
fn count(value: &ParameterValue) -> Option<u64> {
    match value {
        ParameterValue::Integer(number) => u64::try_from(*number).ok(),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use wrapyfi_node::NodeName;

    use super::*;

    /// `ros2 param dump` writes null for what has no value, which comes back as a text.
    #[test]
    fn every_parameter_has_a_value_that_a_dump_can_bring_back() {
        for bridge in [None, MiddlewareBridge::called("yarp_bridge")] {
            let name = NodeName::new(DEFAULT_NAME, "/").unwrap();
            let file = ParameterValue::String("routes.yaml".to_owned());
            let overrides = BTreeMap::from([("config_file".to_owned(), file)]);
            let mut store = ParameterStore::new(&name, overrides).unwrap();
            let (_, options) = declared(&mut store, bridge).unwrap();
            assert_eq!(options.seconds, None);
            let dump: BTreeMap<String, ParameterValue> = store
                .names()
                .map(|name| (name.to_owned(), store.get(name).unwrap().clone()))
                .collect();
            assert!(!dump.values().any(|value| *value == ParameterValue::NotSet), "{dump:?}");
            let mut again = ParameterStore::new(&name, dump).unwrap();
            assert_eq!(declared(&mut again, bridge).unwrap().1.seconds, None);
        }
    }

    #[test]
    fn the_command_line_is_split_where_ros_begins() {
        let split = |line: &str| {
            let (own, ros) = split(line.split(' ').map(OsString::from));
            let joined = |words: Vec<OsString>| words.join(" ".as_ref()).into_string().unwrap();
            (joined(own), joined(ros))
        };
        let own = |own: &str, ros: &str| (own.to_owned(), ros.to_owned());
        assert_eq!(split("bridge --config a:=b"), own("bridge --config a:=b", ""));
        assert_eq!(
            split("bridge --ros-args -r a:=b -- --json --ros-args -p c:=1"),
            own("bridge --json", "--ros-args -r a:=b -- --ros-args -p c:=1")
        );
    }

    #[test]
    fn options_are_parameters_and_say_so_where_both_are_given() {
        let args = BridgeArgs {
            config: Some("a.yaml".into()),
            seconds: Some(Duration::from_millis(500)),
            json: true,
            page: Some(8642),
            ..BridgeArgs::default()
        };
        let mut given = BTreeMap::new();
        enter(&args, &mut given).unwrap();
        let expected: [(&str, ParameterValue); 4] = [
            ("config_file", "a.yaml".into()),
            ("seconds", 0.5.into()),
            ("status_json", true.into()),
            ("page_port", 8642.into()),
        ];
        assert_eq!(given, expected.map(|(name, value)| (name.to_owned(), value)).into());
        enter(&args, &mut given).unwrap();
        given.insert("config_file".to_owned(), "b.yaml".into());
        let told = enter(&args, &mut given).unwrap_err().to_string();
        assert!(told.contains("--config says a.yaml") && told.contains("says b.yaml"), "{told}");
    }

    #[test]
    fn what_the_built_in_configuration_takes_is_refused_beside_a_file() {
        let name = NodeName::new("ros1_bridge", "/").unwrap();
        let declare = |given: &[(&str, ParameterValue)]| {
            let given = given.iter().map(|(name, value)| ((*name).to_owned(), value.clone()));
            let mut store = ParameterStore::new(&name, given.collect()).unwrap();
            declared(&mut store, MiddlewareBridge::called("ros1_bridge"))
        };
        let (built_in, _) = declare(&[("prefix", "lab".into())]).unwrap();
        assert!(matches!(built_in, Source::Text(text, _) if text.contains("ros2:/lab/")));
        let file = ("config_file", "routes.yaml".into());
        let (Source::File(named), _) = declare(std::slice::from_ref(&file)).unwrap() else {
            panic!("it is a file");
        };
        assert_eq!(named, PathBuf::from("routes.yaml"));
        let Err(Failure::Usage(error)) = declare(&[file, ("prefix", "lab".into())]) else {
            panic!("it is refused");
        };
        assert!(error.contains("write them into the file"), "{error}");
    }
}
