//! Plain CDR (XCDR1), the bytes of ROS 2 messages on DDS.
//!
//! ```text
//!   00 01 00 00 │ body: members in order, each aligned to its size from the body's start
//!   encapsulation
//!
//!   message ──CdrWriter──▶ CdrParts: [small fields][uint8[] shared][small fields] ──▶ scatter write
//!   CDR bytes ──CdrReader──▶ message; its uint8[] fields are slices of those bytes
//! ```
//!
//! Large `uint8[]` fields are never copied in either direction, and other primitive sequences
//! move in bulk. Every size in the bytes is compared with what is there before anything is
//! allocated for it.

mod error;
mod parts;
mod primitive;
mod reader;
mod value;
mod writer;

/// Bytes of `uint8[]` fields.
pub use bytes::Bytes;
pub use error::CdrError;
pub(crate) use error::{path_in_element, path_in_field};
pub use parts::{CdrParts, ENCAPSULATION_SIZE};
pub use primitive::{ByteOrder, CdrPrimitive};
pub use reader::CdrReader;
pub use value::{CdrValue, WString};
pub use writer::CdrWriter;

#[cfg(test)]
mod tests;
