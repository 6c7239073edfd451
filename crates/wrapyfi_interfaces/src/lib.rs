//! ROS interfaces in Rust: definitions, type hashes, CDR, structs generated at build time, and
//! any other type while running.
//!
//! ```text
//!   wrapyfi_msgs/, interfaces/*/  {msg,srv}              ament index, folder, full text
//!          │ build script: parser ─▶ description ─▶ hash        │ store ─▶ the same
//!          ▼                                                    ▼
//!   sensor_msgs::msg::Image { … }  : Message            dynamic::TypePlan, DynamicMessage ◀─▶ JSON
//!          └─────────────────── cdr ───▶ bytes on DDS ◀─── cdr ─┘
//! ```
//!
//! * [`parser`]: `.msg`, `.srv` and `.action` text to definitions.
//! * [`description`] and [`hash`]: type descriptions and REP-2016 hashes.
//! * [`cdr`][]: serialisation.
//! * [`store`]: finds the definition of any type; ROS 1 checksums.
//! * [`dynamic`]: messages of any type.
//! * [`build`]: structs of any type, written by the build script of a program.
//! * [`ros1`]: types and messages of ROS 1, to ROS 2 and back.
//! * One module a package, laid out as in ROS: [`sensor_msgs::msg::Image`], [`std_srvs::srv::SetBool`]
//!   with its `SetBool_Request`, `SetBool_Response` and `SetBool_Event`.

#[allow(unused_extern_crates, reason = "generated source names the crate as seen from outside")]
extern crate self as wrapyfi_interfaces;

pub mod build;
pub mod cdr;
pub mod description;
pub mod dynamic;
pub mod hash;
mod message;
mod named;
pub mod parser;
pub mod ros1;
pub mod store;
mod suggest;
mod type_description;

pub use message::{Action, GeneratedType, Message, Service, ServiceHashes};
pub use suggest::did_you_mean;

include!(concat!(env!("OUT_DIR"), "/interfaces.rs"));

#[cfg(test)]
mod golden_tests;
#[cfg(test)]
mod service_golden_tests;
#[cfg(test)]
mod test_data;
