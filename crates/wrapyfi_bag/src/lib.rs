//! Recordings: bags of ROS 1 are read and converted, MCAP files of ROS 2 are written and read.
//!
//! ```text
//!   robot.bag ─▶ ros1::BagReader ── bytes of ROS 1 ──▶ Conversion ── CDR ──┐
//!                record by record                      plans by the bag's  │
//!                                                      own definitions     ▼
//!   endpoints of `wrapyfi record` ──────────────── CDR ──▶ recording::Writer ─▶ robot.mcap, metadata.yaml
//!
//!   robot.mcap ─▶ recording::Reader ── CDR in the order of time ──▶ endpoints of `wrapyfi play`
//! ```
//!
//! * [`ros1`][]: bags of ROS 1, whole, cut or broken.
//! * [`recording`][]: MCAP files as `ros2 bag` writes them.
//! * [`convert`][]: one into the other.
//!
//! Memory stays that of some messages and some chunks, whatever the size of a file. Sizes that a file claims are compared with a
//! limit, and with the bytes that are there, before memory is taken for them.

mod conversion;
mod convert;
mod feed;
pub mod recording;
pub mod ros1;
mod schema;

pub use conversion::{Conversion, Converted, Target, offered};
pub use convert::{ConvertError, ConvertOptions, Progress, Report, TopicReport, convert};
pub use schema::definition_text;
