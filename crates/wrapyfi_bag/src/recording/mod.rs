//! MCAP files as `ros2 bag` of ROS 2 Jazzy writes and reads them.
//!
//! ```text
//!   topic ─▶ schema   its type: `ros2msg`, the definition with all it refers to
//!         └▶ channel  `cdr`, offered_qos_profiles, topic_type_hash
//!   message ─▶ chunk ─▶ … ─▶ summary, metadata "rosbag2"
//!                               └─▶ metadata.yaml beside it, for `ros2 bag info FOLDER`
//! ```

mod metadata;
mod qos;
mod reader;
mod writer;

pub use metadata::Metadata;
pub use reader::{Reader, Recorded, RecordedTopic, RecordingError};
pub use writer::{Compression, Topic, TopicId, WriteError, Writer};
