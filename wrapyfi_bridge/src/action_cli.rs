//! Arguments of `wrapyfi action`.

use std::path::PathBuf;
use std::time::Duration;

use clap::{Args, Subcommand};
use wrapyfi_endpoint::EndpointAddress;

use crate::cli::{ListArgs, ServicePorts, seconds};
use crate::options::EndpointOptions;
use crate::own_address::OwnAddress;

/// Subcommand of `wrapyfi action`.
#[derive(Debug, Subcommand)]
pub enum ActionCommand {
    /// List the actions that exist now, with their servers and clients.
    List(ListArgs),
    /// Show the servers and clients of one action.
    Info {
        /// Action, for instance ros2:/navigate_to_pose.
        endpoint: EndpointAddress,
        /// Settings of the look.
        #[command(flatten)]
        args: ActionInfoArgs,
    },
    /// Send a goal, and print its state, its feedback as it comes, and its result. Ctrl-C cancels the goal.
    Send(ActionSendArgs),
    /// Offer an action, and print its goals.
    Serve(ActionServeArgs),
    /// Ask the server of an action to give up all its goals.
    Cancel {
        /// The action.
        #[command(flatten)]
        at: ActionEndpoint,
        /// Fail with exit code 3 when there is no server within S seconds.
        #[arg(long, value_name = "S", default_value = "5", value_parser = seconds)]
        timeout: Duration,
    },
}

/// Action on the command line.
#[derive(Debug, Args)]
pub struct ActionEndpoint {
    /// Action, for instance ros2:/navigate_to_pose or ros:/move_base; on ZeroMQ and YARP a function, whose call is
    /// the goal and whose reply is the result.
    pub endpoint: EndpointAddress,
    /// Settings of the endpoint.
    #[command(flatten)]
    pub options: EndpointOptions,
    /// Type of the action as package/action/Type. A client may leave it out on ROS 2 and ROS 1: it is what the server
    /// announces.
    #[arg(long = "type", value_name = "T")]
    pub action_type: Option<String>,
    /// Folder of packages with .action files, searched before AMENT_PREFIX_PATH; may be given more than once.
    #[arg(long, value_name = "DIR")]
    pub definitions: Vec<PathBuf>,
    /// Ports of the ZeroMQ broker.
    #[command(flatten)]
    pub ports: ServicePorts,
}

/// Arguments of `wrapyfi action info`.
#[derive(Debug, Args)]
pub struct ActionInfoArgs {
    /// One JSON object a line for each endpoint.
    #[arg(long)]
    pub json: bool,
    /// Time to look, in seconds.
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub wait: Option<Duration>,
    /// Address at which others reach the node that looks.
    #[command(flatten)]
    pub own: OwnAddress,
}

impl ActionInfoArgs {
    /// The same as arguments of a list of one middleware.
    pub fn of(&self, middleware: &str) -> ListArgs {
        let Self { json, wait, own } = *self;
        ListArgs { middleware: Some(middleware.to_owned()), json, wait, own }
    }
}

/// Arguments of `wrapyfi action send`.
#[derive(Debug, Args)]
pub struct ActionSendArgs {
    /// The action.
    #[command(flatten)]
    pub at: ActionEndpoint,
    /// Fields of the goal as a JSON object, where those that are left out have their default.
    #[arg(long, value_name = "JSON", conflicts_with = "args")]
    pub value: Option<String>,
    /// First fields of the goal in order, as a JSON list.
    #[arg(long, value_name = "JSON")]
    pub args: Option<String>,
    /// Do not print feedback.
    #[arg(long)]
    pub no_feedback: bool,
    /// Fail with exit code 3 when there is no server within S seconds. A goal has all the time that it needs.
    #[arg(long, value_name = "S", default_value = "5", value_parser = seconds)]
    pub timeout: Duration,
    /// Print one JSON object a line: goal with the state or feedback, and value.
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `wrapyfi action serve`.
#[derive(Debug, Args)]
pub struct ActionServeArgs {
    /// The action.
    #[command(flatten)]
    pub at: ActionEndpoint,
    /// Fields of every result as a JSON object, where those that are left out have their default.
    #[arg(long, value_name = "JSON")]
    pub value: Option<String>,
    /// Fields of the feedback that goals under way have.
    #[arg(long, value_name = "JSON")]
    pub feedback: Option<String>,
    /// Time between two messages of feedback, in seconds.
    #[arg(long, value_name = "S", default_value = "0.5", value_parser = seconds)]
    pub every: Duration,
    /// Time that a goal takes, in seconds.
    #[arg(long, value_name = "S", default_value = "0", value_parser = seconds)]
    pub seconds: Duration,
    /// Abort goals in place of reaching them.
    #[arg(long)]
    pub abort: bool,
    /// End after this many goals.
    #[arg(long, value_name = "N")]
    pub count: Option<u64>,
    /// Print each goal as one JSON object: type, and the value.
    #[arg(long)]
    pub json: bool,
}
