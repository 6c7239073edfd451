//! Arguments of `wrapyfi convert`, `wrapyfi play` and `wrapyfi record`.

use std::path::PathBuf;
use std::time::Duration;

use clap::{Args, ValueEnum};

use crate::cli::{rate, seconds};
use crate::own_address::OwnAddress;

/// Compression of a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum Compression {
    /// None: as fast as the disk.
    #[default]
    None,
    /// Zstandard: smallest.
    Zstd,
    /// LZ4: fast.
    Lz4,
}

impl From<Compression> for wrapyfi_bag::recording::Compression {
    fn from(compression: Compression) -> Self {
        match compression {
            Compression::None => Self::None,
            Compression::Zstd => Self::Zstd,
            Compression::Lz4 => Self::Lz4,
        }
    }
}

/// Arguments of `wrapyfi convert`.
#[derive(Debug, Args)]
#[command(
    after_help = "The definitions of all types are in the bag: no ROS has to be installed.\n\
    Exit codes: 0 each message is in the recording, 1 something was left out or could not be read, as the report says; \
    2 bad usage."
)]
pub struct ConvertArgs {
    /// Bag of ROS 1, also one without an index, or cut.
    pub bag: PathBuf,
    /// File NAME.mcap, or a folder as `ros2 bag record` makes it, with metadata.yaml; neither may exist yet. By default
    /// the name of the bag, with .mcap.
    pub out: Option<PathBuf>,
    /// Only these topics, by their names in the bag or in ROS 2, with commas between them.
    #[arg(long, value_name = "NAMES", value_delimiter = ',', num_args = 1..)]
    pub topics: Vec<String>,
    /// Compression of the recording.
    #[arg(long, value_enum, default_value_t)]
    pub compression: Compression,
    /// Folder of packages with .msg files of ROS 2, searched before AMENT_PREFIX_PATH, for types whose definition is to
    /// be another than that in the bag; may be given more than once.
    #[arg(long, value_name = "DIR")]
    pub definitions: Vec<PathBuf>,
    /// Largest message in MiB; a larger one is left out.
    #[arg(long, value_name = "MIB", default_value_t = 256, value_parser = clap::value_parser!(u32).range(1..=4095))]
    pub max_message_mib: u32,
    /// Print the report as one JSON object.
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `wrapyfi play`.
#[derive(Debug, Args)]
pub struct PlayArgs {
    /// Recording: NAME.mcap, a folder of `ros2 bag` with MCAP files, or a bag of ROS 1.
    pub file: PathBuf,
    /// Side that hears it, with what stands before each topic: ros2:, ros:, zeromq:, yarp:, or for instance ros2:/again.
    #[arg(long, value_name = "SIDE", default_value = "ros2:")]
    pub to: String,
    /// Speed, from 0.001 to 1000: 2 is twice as fast as it was recorded.
    #[arg(long, value_name = "R", default_value_t = 1.0, value_parser = speed)]
    pub rate: f64,
    /// Begin again at the end, until interrupted.
    #[arg(long = "loop")]
    pub again: bool,
    /// Publish the time of the recording on /clock, so many times a second, in place of a /clock that was recorded.
    #[arg(long, value_name = "HZ", value_parser = rate)]
    pub clock: Option<f64>,
    /// Only these topics, with commas between them.
    #[arg(long, value_name = "NAMES", value_delimiter = ',', num_args = 1..)]
    pub topics: Vec<String>,
    /// Time to wait for a listener of each topic before the first message, in seconds; then it plays all the same.
    #[arg(long, value_name = "S", default_value = "0", value_parser = seconds)]
    pub wait: Duration,
    /// Folder of packages with .msg files of ROS 2, searched before AMENT_PREFIX_PATH, for types of a bag of ROS 1; may be
    /// given more than once.
    #[arg(long, value_name = "DIR")]
    pub definitions: Vec<PathBuf>,
    /// Address at which others reach the publishers.
    #[command(flatten)]
    pub own: OwnAddress,
}

/// Arguments of `wrapyfi record`.
#[derive(Debug, Args)]
#[command(
    after_help = "On ZeroMQ the type of a topic is that of its first message, which is not recorded. What is gone before \
    its type is known cannot be recorded; topics that come later are."
)]
pub struct RecordArgs {
    /// Endpoints to record: topics such as ros:/scan, or all of a side, such as yarp:.
    #[arg(required = true, value_name = "ENDPOINT")]
    pub endpoints: Vec<String>,
    /// File NAME.mcap, or a folder as `ros2 bag record` makes it, with metadata.yaml; neither may exist yet.
    #[arg(long, short, value_name = "PATH")]
    pub output: PathBuf,
    /// Time to record, in seconds; without it, until interrupted.
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub seconds: Option<Duration>,
    /// Compression of the recording.
    #[arg(long, value_enum, default_value_t)]
    pub compression: Compression,
    /// Folder of packages with .msg files, searched before AMENT_PREFIX_PATH; may be given more than once.
    #[arg(long, value_name = "DIR")]
    pub definitions: Vec<PathBuf>,
    /// Address at which others reach the listeners.
    #[command(flatten)]
    pub own: OwnAddress,
}

fn speed(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(speed) if (0.001..=1000.0).contains(&speed) => Ok(speed),
        _ => Err("must be between 0.001 and 1000".to_owned()),
    }
}
