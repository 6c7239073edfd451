//! Arguments of the commands that lead from ROS 1 to ROS 2: `wrapyfi survey` and `wrapyfi export`.

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;

use crate::cli::seconds;
use crate::learned::RosGraph;
use crate::own_address::OwnAddress;

/// Arguments of `wrapyfi export`.
#[derive(Debug, Args)]
#[command(
    after_help = "Exit codes: 0 done, 1 nodes show different definitions of a type, or one was not to be learned, 2 bad \
                  usage, 3 the graph does not answer."
)]
pub struct ExportArgs {
    /// Graph whose nodes show the types: ros: for ROS 1, or ros2: where they describe them.
    pub graph: RosGraph,
    /// Package to write, by its name on ROS 1 or ROS 2; may be given more than once.
    #[arg(long, value_name = "PACKAGE", required = true)]
    pub package: Vec<String>,
    /// Folder in which the folder of each package is made, such as src of a workspace.
    #[arg(long, value_name = "FOLDER", default_value = ".")]
    pub output: PathBuf,
    /// Node whose definition counts where nodes show different ones of a type; may be given more than once.
    #[arg(long, value_name = "NODE")]
    pub from: Vec<String>,
    /// Folder of packages with definitions of ROS 2, searched before AMENT_PREFIX_PATH; may be given more than once.
    #[arg(long, value_name = "DIR")]
    pub definitions: Vec<PathBuf>,
    /// Address at which others reach the node that looks.
    #[command(flatten)]
    pub own: OwnAddress,
}

/// Arguments of `wrapyfi survey`.
#[derive(Debug, Args)]
#[command(
    after_help = "Exit codes: 0 done, 1 a bag could not be read whole, 2 bad usage, or a file that is there already, 3 the \
                  master does not answer."
)]
pub struct SurveyArgs {
    /// Graph to look at: ros: for ROS 1.
    #[arg(default_value = "ros:")]
    pub graph: RosGraph,
    /// Bag of ROS 1 to look at instead of nodes: its topics alone, with the rates and sizes that it has.
    #[cfg(feature = "bags")]
    #[arg(long, value_name = "FILE")]
    pub bag: Option<PathBuf>,
    /// File of the report, Markdown; the configuration stands beside it, with the ending .yaml.
    #[arg(long, value_name = "FILE", default_value = "survey.md")]
    pub output: PathBuf,
    /// Time to measure, in seconds, for which every topic has one subscriber more; 0 measures nothing.
    #[arg(long, value_name = "S", default_value = "3", value_parser = seconds)]
    pub seconds: Duration,
    /// Folder of packages with definitions of ROS 2, searched before AMENT_PREFIX_PATH; may be given more than once.
    #[arg(long, value_name = "DIR")]
    pub definitions: Vec<PathBuf>,
    /// Address at which others reach the node that looks.
    #[command(flatten)]
    pub own: OwnAddress,
}
