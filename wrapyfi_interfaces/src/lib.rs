//! ROS 2 interfaces in Rust: definitions, type hashes, CDR, and structs generated at build time.
//!
//! ```text
//!   wrapyfi_msgs/msg/*.msg, interfaces/*/msg/*.msg
//!          │ build script: parser ─▶ description ─▶ hash
//!          ▼
//!   sensor_msgs::msg::Image { … }  : Message ──cdr──▶ bytes on DDS
//! ```
//!
//! * [`parser`]: `.msg` text to definitions.
//! * [`description`] and [`hash`]: type descriptions and REP-2016 hashes.
//! * [`cdr`][]: serialisation.
//! * One module a package, laid out as in ROS: [`sensor_msgs::msg::Image`].

pub mod cdr;
pub mod description;
pub mod hash;
mod message;
pub mod parser;
pub mod store;

pub use message::Message;

include!(concat!(env!("OUT_DIR"), "/interfaces.rs"));

#[cfg(test)]
mod golden_tests;
#[cfg(test)]
mod test_data;
