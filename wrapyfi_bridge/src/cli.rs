//! The command line, defined once: help and errors are generated from it.

use std::path::PathBuf;
use std::time::Duration;

use clap::{Args, Parser, Subcommand};
use wrapyfi_endpoint::EndpointAddress;

use crate::options::EndpointOptions;
use crate::own_address::OwnAddress;
use crate::top::routes::Sort;

pub use crate::action_cli::{
    ActionCommand, ActionEndpoint, ActionInfoArgs, ActionSendArgs, ActionServeArgs,
};
pub use crate::migration_cli::{ExportArgs, SurveyArgs};
pub use crate::type_names::{ServiceName, TypeName};

/// Wrapyfi for ROS 2: native objects, arrays, images, sound and messages of any type between ZeroMQ, YARP,
/// ROS 1 and ROS 2.
#[derive(Debug, Parser)]
#[command(
    name = "wrapyfi",
    version,
    after_help = "Endpoints are written middleware:/name, for instance zeromq:/camera or ros2:/chatter.\n\
    Exit codes: 0 done, 1 failed, 2 bad usage or configuration, 3 time-out."
)]
pub struct Cli {
    /// Least severity to log: off, error, warn, info, debug or trace; by default what goes on (info),
    /// for echo only what is wrong (warn).
    #[arg(long, global = true, value_name = "LEVEL")]
    pub log_level: Option<String>,
    /// Subcommand to run.
    #[command(subcommand)]
    pub command: Command,
}

/// Subcommand of `wrapyfi`.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Show the main job on built-in sources: camera, microphone and objects on ZeroMQ and a robot
    /// on YARP into ROS 2.
    Demo(DemoArgs),
    /// Run the routes of a configuration file, as a ROS 2 node.
    #[command(after_help = ROS_ARGS)]
    Bridge(BridgeArgs),
    /// Validate a configuration file and print what it would run.
    Check {
        /// Configuration file.
        file: PathBuf,
        /// File of a bridge that runs: prints what the other changes, and what needs a start.
        #[arg(long, value_name = "OLD")]
        against: Option<PathBuf>,
        /// Print the policy of SROS 2 that lets a bridge do what its routes need, and nothing else.
        #[arg(long, conflicts_with = "against")]
        print_sros2_policy: bool,
    },
    /// List the endpoints that exist now, on every side, with types and quality of service.
    List(ListArgs),
    /// Say why nothing flows: the first thing that is missing on the way of a route or a topic, who could
    /// provide it, and what mends it.
    Why(WhyArgs),
    /// Show the routes of a running bridge: rates, latency, drops, states with their reasons.
    Top(TopArgs),
    /// Print the messages of an endpoint.
    Echo(EchoArgs),
    /// Publish to an endpoint.
    Pub(PubArgs),
    /// Call a service and print its reply.
    Call(CallArgs),
    /// Offer a service and print its requests.
    Serve(ServeArgs),
    /// Send, serve, cancel and list goals of actions.
    #[command(subcommand)]
    Action(ActionCommand),
    /// Write a report of a graph of ROS 1 for the move to ROS 2, and routes to start from.
    Survey(SurveyArgs),
    /// Write the types that nodes show as an interface package of ROS 2, which colcon builds.
    Export(ExportArgs),
    /// Convert a bag of ROS 1 into a recording of ROS 2 (MCAP), for `ros2 bag` and Foxglove.
    #[cfg(feature = "bags")]
    Convert(crate::bag_cli::ConvertArgs),
    /// Publish the messages of a recording on any side, as they were in time.
    #[cfg(feature = "bags")]
    Play(crate::bag_cli::PlayArgs),
    /// Record topics of any side into a recording of ROS 2 (MCAP), for `wrapyfi play`, `ros2 bag` and Foxglove.
    #[cfg(feature = "bags")]
    Record(crate::bag_cli::RecordArgs),
    /// Run the ZeroMQ brokers at which Wrapyfi's publishers and listeners, clients and servers meet.
    Broker(BrokerArgs),
    /// Run a YARP name server, for YARP's tools, ports and Wrapyfi's scripts on YARP.
    Yarpserver(YarpServerArgs),
    /// Look for a YARP name server by multicast, and write its address down for YARP's programs and ours.
    Detect(DetectArgs),
    /// Print the completions of a shell, for `eval` or for the file that it reads.
    Completions {
        /// Shell that reads them.
        shell: clap_complete::Shell,
    },
    /// Write manual pages, one for each command, as packages install them.
    #[command(hide = true)]
    Man {
        /// Folder of the pages.
        folder: PathBuf,
    },
}

/// Arguments of `wrapyfi demo`.
#[derive(Debug, Args)]
pub struct DemoArgs {
    /// Time to run, in seconds; without it, until interrupted.
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub seconds: Option<Duration>,
    /// Port of 127.0.0.1 at which the live page is served.
    #[arg(long, value_name = "PORT", value_parser = clap::value_parser!(u16).range(1..))]
    pub page: Option<u16>,
}

/// Arguments of `wrapyfi bridge` and of the node executables.
#[derive(Debug, Default, Args)]
pub struct BridgeArgs {
    /// Configuration file; the parameter config_file.
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Time to run, in seconds; 0, or without it, until interrupted. The parameter seconds.
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub seconds: Option<Duration>,
    /// Print the routes' status as one JSON object a second on stdout; the parameter status_json.
    #[arg(long)]
    pub json: bool,
    /// Wait as a ROS 2 node for others to configure and activate it, such as `ros2 lifecycle set`; the parameter
    /// autostart.
    #[arg(long)]
    pub no_autostart: bool,
    /// Port of 127.0.0.1 at which the live page is served, in place of the file's page.port; the parameter
    /// page_port.
    #[arg(long, value_name = "PORT", value_parser = clap::value_parser!(u16).range(1..))]
    pub page: Option<u16>,
    /// Address at which others reach the endpoints of the routes.
    #[command(flatten)]
    pub own: OwnAddress,
}

/// Command line of a node executable, beside what is ROS's.
#[derive(Debug, Parser)]
#[command(version, after_help = ROS_ARGS)]
pub struct NodeCli {
    /// Arguments that the executables share with `wrapyfi bridge`.
    #[command(flatten)]
    pub args: BridgeArgs,
}

/// Text of `--help` about ROS arguments.
const ROS_ARGS: &str = "Behind --ros-args, as for every ROS 2 node: -r FROM:=TO, -p NAME:=VALUE, \
    --params-file FILE, --log-level [LOGGER:=]LEVEL and others: \
    docs/reference/node.md.";

/// Arguments of `wrapyfi list`.
#[derive(Debug, Args)]
#[command(
    after_help = "On ZeroMQ a publisher is seen by the messages it sends: one that is silent cannot be \
    listed. With a broker that is not ours, everything is subscribed to while we look."
)]
pub struct ListArgs {
    /// Only this middleware: ros, ros2, yarp or zeromq. Without it all, ROS 1 where ROS_MASTER_URI is
    /// set and YARP where yarp.conf says where its name server is.
    pub middleware: Option<String>,
    /// One JSON object a line for each endpoint.
    #[arg(long)]
    pub json: bool,
    /// Time to look, in seconds; without it until every side has told all that it has, at most 3
    /// seconds.
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub wait: Option<Duration>,
    /// Address at which others reach the node that looks.
    #[command(flatten)]
    pub own: OwnAddress,
}

/// Arguments of `wrapyfi why`.
#[derive(Debug, Args)]
#[command(
    after_help = "Exit codes: 0 nothing is missing, 1 a cause was found, 2 bad usage or configuration, 3 the bridge of \
                  --node does not answer."
)]
pub struct WhyArgs {
    /// Name of a route of the configuration, its ends or one of them; without one an endpoint such as
    /// ros2:/chatter, or a type such as geometry_msgs/msg/Twist.
    pub name: String,
    /// Configuration that has the route, and the settings of the middlewares.
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Node of a bridge that runs, for instance /wrapyfi_bridge: it is asked, and answers from where it runs
    /// and with its counters.
    #[arg(long, value_name = "NODE", conflicts_with_all = ["config", "definitions", "ip", "insecure"])]
    pub node: Option<String>,
    /// Folder of packages with definitions, searched before AMENT_PREFIX_PATH; may be given more than
    /// once.
    #[arg(long, value_name = "DIR")]
    pub definitions: Vec<PathBuf>,
    /// One JSON object: way, passed, and where something is missing cause, what, who and remedy.
    #[arg(long)]
    pub json: bool,
    /// Address at which others reach the nodes that look.
    #[command(flatten)]
    pub own: OwnAddress,
}

/// Arguments of `wrapyfi top`.
#[derive(Debug, Args)]
#[command(
    after_help = "Keys: q ends, s takes the next column to sort by, / filters, Enter shows one route."
)]
pub struct TopArgs {
    /// Node of the bridge, for instance /wrapyfi_bridge; without it the only bridge on the graph.
    pub node: Option<String>,
    /// Print one table and end.
    #[arg(long)]
    pub once: bool,
    /// Time between two questions to the bridge, in seconds.
    #[arg(long, value_name = "S", value_parser = at_least_a_tenth, default_value = "1")]
    pub every: Duration,
    /// Column to sort by.
    #[arg(long, value_enum, default_value_t)]
    pub sort: Sort,
    /// Only routes whose name, ends or type contain this, whatever its case.
    #[arg(long, value_name = "TEXT", default_value = "", hide_default_value = true)]
    pub filter: String,
}

/// Arguments of `wrapyfi echo`.
#[derive(Debug, Args)]
pub struct EchoArgs {
    /// Endpoint to listen to.
    pub endpoint: EndpointAddress,
    /// Settings of the endpoint.
    #[command(flatten)]
    pub options: EndpointOptions,
    /// Type of the messages: NativeObject, Text, Image, CompressedImage, AudioChunk, Properties or any ROS
    /// type. It may be left out where the middleware tells types: on ROS 2 it is what the topic's
    /// endpoints announce, on ROS 1 what its publisher shows. Properties on ROS 2
    /// are the parameters of the node that the endpoint names.
    #[arg(long = "type", value_name = "T")]
    pub message_type: Option<TypeName>,
    /// Folder of packages with .msg files, searched before AMENT_PREFIX_PATH; may be given more
    /// than once.
    #[arg(long, value_name = "DIR")]
    pub definitions: Vec<PathBuf>,
    /// End after this many messages.
    #[arg(long, value_name = "N")]
    pub count: Option<u64>,
    /// Fail with exit code 3 when the next message does not come within S seconds.
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub timeout: Option<Duration>,
    /// One JSON object a line: type, stamp, shape or size, sha256 of the payload, and the value of
    /// native objects and of ROS types that are not ours.
    #[arg(long)]
    pub json: bool,
    /// Quality of service on ROS 2: default, sensor_data or latched. By default what the publishers
    /// offer.
    #[arg(long, value_name = "PRESET", value_parser = qos)]
    pub qos: Option<wrapyfi_endpoint::QosPreset>,
}

/// Arguments of `wrapyfi pub`.
#[derive(Debug, Clone, Args)]
pub struct PubArgs {
    /// Endpoint to publish on.
    pub endpoint: EndpointAddress,
    /// Settings of the endpoint.
    #[command(flatten)]
    pub options: EndpointOptions,
    /// Type of the messages: NativeObject, Text, Image, CompressedImage, AudioChunk, Properties or any ROS
    /// type. Properties on ROS 2 are the parameters of the node that the endpoint names: they are set.
    #[arg(long = "type", value_name = "T")]
    pub message_type: TypeName,
    /// Folder of packages with .msg files, searched before AMENT_PREFIX_PATH; may be given more
    /// than once.
    #[arg(long, value_name = "DIR")]
    pub definitions: Vec<PathBuf>,
    /// The value: JSON in Wrapyfi's dialect (tags and NaN allowed); for other ROS types their
    /// fields, where those that are left out have their default.
    #[arg(long, value_name = "JSON", required_unless_present = "file", conflicts_with = "file")]
    pub value: Option<String>,
    /// The value from a file: .json, .npy, .png, .jpg or .wav.
    #[arg(long, value_name = "F")]
    pub file: Option<PathBuf>,
    /// Messages per second.
    #[arg(long, value_name = "HZ", default_value_t = 1.0, value_parser = rate)]
    pub rate: f64,
    /// End after this many messages; without it, until interrupted; parameters of a node are set once.
    #[arg(long, value_name = "N")]
    pub count: Option<u64>,
    /// Fail with exit code 3 when no listener comes within S seconds; without it, wait for ever, for a
    /// node whose parameters are set 5 seconds.
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub timeout: Option<Duration>,
    /// Quality of service on ROS 2: default, sensor_data or latched.
    #[arg(long, value_name = "PRESET", default_value = "default", value_parser = qos)]
    pub qos: wrapyfi_endpoint::QosPreset,
}

/// Ports of the ZeroMQ broker of requests and replies.
#[derive(Debug, Clone, Copy, Default, Args)]
pub struct ServicePorts {
    /// On ZeroMQ, port that clients connect to; default from WRAPYFI_ZEROMQ_SOCKET_REP_PORT for call,
    /// …_REQ_PORT for serve and broker, else 5558.
    #[arg(long, value_name = "PORT")]
    pub rep_port: Option<u16>,
    /// On ZeroMQ, port that servers connect to; default from WRAPYFI_ZEROMQ_SOCKET_REP_PORT for serve
    /// and broker, else 5559.
    #[arg(long, value_name = "PORT")]
    pub req_port: Option<u16>,
}

/// Arguments of `wrapyfi call`.
#[derive(Debug, Args)]
pub struct CallArgs {
    /// Service to call, for instance ros2:/add_two_ints.
    pub endpoint: EndpointAddress,
    /// Settings of the endpoint.
    #[command(flatten)]
    pub options: EndpointOptions,
    /// Type of the service: NativeObject, Image, CompressedImage, AudioChunk, or on ROS 2, ROS 1 and
    /// YARP any type. It may be left out: on ROS 2 and ROS 1 it is what the servers announce, elsewhere
    /// NativeObject.
    #[arg(long = "type", value_name = "T")]
    pub service_type: Option<ServiceName>,
    /// Folder of packages with .srv files, searched before AMENT_PREFIX_PATH; may be given more than
    /// once.
    #[arg(long, value_name = "DIR")]
    pub definitions: Vec<PathBuf>,
    /// Fields of the request, where those that are left out have their default; the one argument of a
    /// function of Wrapyfi.
    #[arg(long, value_name = "JSON", conflicts_with_all = ["args", "kwargs", "file"])]
    pub value: Option<String>,
    /// The same from a file: .json, or .npy with an array for a function of Wrapyfi.
    #[arg(long, value_name = "F", conflicts_with_all = ["args", "kwargs"])]
    pub file: Option<PathBuf>,
    /// Arguments in order, as a JSON list: of a function of Wrapyfi, in Wrapyfi's dialect, or the first
    /// fields of the request.
    #[arg(long, value_name = "JSON")]
    pub args: Option<String>,
    /// Arguments or fields by name, as a JSON object.
    #[arg(long, value_name = "JSON")]
    pub kwargs: Option<String>,
    /// Fail with exit code 3 when there is no reply within S seconds.
    #[arg(long, value_name = "S", default_value = "5", value_parser = seconds)]
    pub timeout: Duration,
    /// Print the reply as one JSON object: type, and the value.
    #[arg(long)]
    pub json: bool,
    /// Ports of the ZeroMQ broker.
    #[command(flatten)]
    pub ports: ServicePorts,
}

/// Arguments of `wrapyfi serve`.
#[derive(Debug, Args)]
#[command(group(clap::ArgGroup::new("reply").args(["value", "file", "echo"]).required(true)))]
pub struct ServeArgs {
    /// Service to offer, for instance ros2:/add_two_ints.
    pub endpoint: EndpointAddress,
    /// Settings of the endpoint.
    #[command(flatten)]
    pub options: EndpointOptions,
    /// Type of the service: NativeObject, Image, CompressedImage, AudioChunk, or on ROS 2, ROS 1 and
    /// YARP any type. On ZeroMQ and YARP it may be left out: NativeObject.
    #[arg(long = "type", value_name = "T")]
    pub service_type: Option<ServiceName>,
    /// Folder of packages with .srv files, searched before AMENT_PREFIX_PATH; may be given more than
    /// once.
    #[arg(long, value_name = "DIR")]
    pub definitions: Vec<PathBuf>,
    /// Reply with what was asked: the argument of a function of Wrapyfi (a list of them where there
    /// is not one); else the fields that request and reply both have, and success.
    #[arg(long)]
    pub echo: bool,
    /// Fields of every reply, where those that are left out have their default; what a function of
    /// Wrapyfi returns, in its dialect of JSON.
    #[arg(long, value_name = "JSON")]
    pub value: Option<String>,
    /// Every reply from a file: .json with its fields, as --value has them; what a function of Wrapyfi
    /// returns also from .npy, .png, .jpg or .wav.
    #[arg(long, value_name = "F")]
    pub file: Option<PathBuf>,
    /// End after this many requests.
    #[arg(long, value_name = "N")]
    pub count: Option<u64>,
    /// Print each request as one JSON object: type, and the value.
    #[arg(long)]
    pub json: bool,
    /// Ports of the ZeroMQ broker.
    #[command(flatten)]
    pub ports: ServicePorts,
}

/// Arguments of `wrapyfi broker`.
#[derive(Debug, Args)]
pub struct BrokerArgs {
    /// Address to bind; default from WRAPYFI_ZEROMQ_SOCKET_IP, else 127.0.0.1.
    #[arg(long, value_name = "IP")]
    pub ip: Option<String>,
    /// Port that listeners connect to; default from WRAPYFI_ZEROMQ_SOCKET_PUB_PORT, else 5555.
    #[arg(long, value_name = "PORT")]
    pub pub_port: Option<u16>,
    /// Port that publishers connect to; default from WRAPYFI_ZEROMQ_SOCKET_SUB_PORT, else 5556.
    #[arg(long, value_name = "PORT")]
    pub sub_port: Option<u16>,
    /// Ports of requests and replies.
    #[command(flatten)]
    pub ports: ServicePorts,
    /// Allow an address that other machines reach. Nothing is encrypted or authenticated.
    #[arg(long)]
    pub insecure: bool,
    /// Speak CURVE with the secret key in this file, a certificate of pyzmq or 40 characters; default from
    /// WRAPYFI_ZEROMQ_CURVE_SECRET_KEY_FILE.
    #[arg(long, value_name = "FILE")]
    pub curve_secret_key_file: Option<PathBuf>,
    /// Take only clients with this public key, 40 characters or a file with it, for all topics and services;
    /// may be repeated. A list of topics for each key: `curve` of a configuration.
    #[arg(long, value_name = "KEY")]
    pub curve_client: Vec<String>,
}

/// Arguments of `wrapyfi yarpserver`.
#[derive(Debug, Args)]
#[command(
    after_help = "Where clients look for it: yarp.conf in YARP_CONFIG_HOME, else in yarp/ of XDG_CONFIG_HOME, \
    else in ~/.config/yarp; written with --write. Of a namespace other than /root: its name with _ \
    for whatever is no letter or digit, and .conf."
)]
pub struct YarpServerArgs {
    /// Address to bind, and to tell others; default 127.0.0.1.
    #[arg(long, value_name = "IP")]
    pub ip: Option<String>,
    /// Port to bind, 0 for any free one; default from YARP_PORT_RANGE, else 10000.
    #[arg(long, alias = "socket", value_name = "PORT")]
    pub port: Option<u16>,
    /// Name of the name server; default from YARP_NAMESPACE, else yarp_namespace.conf, else /root.
    #[arg(long, value_name = "NAME")]
    pub namespace: Option<String>,
    /// Write the address into the configuration file, where clients find it.
    #[arg(long)]
    pub write: bool,
    /// Listen where the configuration file says.
    #[arg(long)]
    pub read: bool,
    /// Log only what is wrong.
    #[arg(long)]
    pub silent: bool,
    /// Do not answer those who look for a name server by multicast (`yarp detect`).
    #[arg(long)]
    pub no_discovery: bool,
    /// Allow an address that other machines reach. Nothing is encrypted or authenticated.
    #[arg(long)]
    pub insecure: bool,
}

/// Arguments of `wrapyfi detect`.
#[derive(Debug, Args)]
pub struct DetectArgs {
    /// Write the address into the configuration file, where YARP's programs and ours find it.
    #[arg(long)]
    pub write: bool,
    /// Address of the interface on which to ask; by default that of the system's choice.
    #[arg(long, value_name = "IP")]
    pub ip: Option<std::net::Ipv4Addr>,
    /// UDP port of the group; default from YARP_PORT_RANGE, else 10000.
    #[arg(long, value_name = "PORT")]
    pub port: Option<u16>,
    /// Name of the name server; default from YARP_NAMESPACE, else yarp_namespace.conf, else /root.
    #[arg(long, value_name = "NAME")]
    pub namespace: Option<String>,
    /// Time to wait for an answer, in seconds.
    #[arg(long, value_name = "S", default_value = "3", value_parser = seconds)]
    pub timeout: Duration,
}

/// A span of time given in seconds, at most a year.
pub(crate) fn seconds(text: &str) -> Result<Duration, String> {
    match text.parse::<f64>() {
        Ok(value) if (0.0..=31_536_000.0).contains(&value) => {
            Duration::try_from_secs_f64(value).map_err(|error| error.to_string())
        }
        _ => Err("must be seconds between 0 and 31536000".to_owned()),
    }
}

fn at_least_a_tenth(text: &str) -> Result<Duration, String> {
    match seconds(text)? {
        time if time >= Duration::from_millis(100) => Ok(time),
        _ => Err("must be at least 0.1 s: each question costs the bridge a reply".to_owned()),
    }
}

pub(crate) fn rate(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(hz) if hz > 0.0 && hz <= 1e6 => Ok(hz),
        _ => Err("must be above 0 and at most 1000000 Hz".to_owned()),
    }
}

fn qos(text: &str) -> Result<wrapyfi_endpoint::QosPreset, String> {
    let preset = wrapyfi_endpoint::QosPreset::from_name(text);
    preset.ok_or_else(|| "must be default, sensor_data or latched".to_owned())
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_definition_is_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn numbers_out_of_range_are_refused() {
        assert!(seconds("-1").is_err() && seconds("nan").is_err() && seconds("1e300").is_err());
        assert_eq!(seconds("0.5"), Ok(Duration::from_millis(500)));
        assert!(rate("0").is_err() && rate("inf").is_err());
    }
}
