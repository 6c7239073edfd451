//! Bags of ROS 1, format 2.0: messages in the order of the file, with the connections that they came through.
//!
//! ```text
//!   #ROSBAG V2.0
//!   bag header      where the index begins; 0: none
//!   chunk           none, bz2 or lz4 ─▶ connection, message, message, …
//!   index of the chunk
//!   chunk …
//!   index: each connection, each chunk with its counts of messages
//! ```
//!
//! The index is no more than help: connections are looked for there first, and its counts tell afterwards whether something is
//! missing. A bag without it, such as one whose recording was killed, is read all the same. Where a record is broken, reading
//! goes on at the next chunk there is, and the [`Damage`] has each place.

mod ahead;
mod chunk;
mod connection;
mod error;
mod input;
mod reader;
mod record;

#[cfg(test)]
mod tests;
#[cfg(test)]
pub(crate) mod writing;

pub use connection::Connection;
pub use error::{Damage, Fault, OpenError, ReadError};
pub use reader::{BagReader, Limits, Message};
