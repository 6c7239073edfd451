//! Properties that must hold whatever bytes arrive, one function a target.
//!
//! ```text
//!   targets/fuzz_targets/json.rs   libFuzzer, endless ──┐
//!                                                       ├──▶ json(bytes): holds, or panics
//!   tests/replay.rs   every file of corpus/json, once ──┘
//! ```
//!
//! Each function asserts: no panic below it; what was read can be written, and reads the same
//! again; memory stays within a multiple of the input ([`bounded`]), so that no program can make the
//! process hold more than the message limit allows.
//!
//! `fuzz/README.md` says how to run them.

// These functions are assertions: a panic is how they say that something does not hold.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::missing_panics_doc)]

mod announced;
mod bags;
mod codecs;
mod dynamic;
mod labelled;
mod meter;
mod pickles;
mod requests;
mod ros1;
mod services;
mod tables;
mod tcpros;
mod tensors;
mod texts;
mod yarp;
mod yarp_names;
mod yarp_payload;
mod yarp_wire;
mod zeromq;

pub use announced::{bridge_marks, ros2_discovery};
pub use bags::bag;
pub use codecs::{cdr, frames, jpeg, json, npy};
pub use dynamic::dynamic;
pub use labelled::{plugin_picture, plugin_zarr};
pub use meter::{bounded, measure};
pub use pickles::pickle;
pub use requests::zeromq_requests;
pub use ros1::{mapping_rules, ros1_definition, ros1_messages};
pub use services::node_services;
pub use tables::plugin_table;
pub use tcpros::{tcpros_header, xmlrpc};
pub use tensors::plugin_tensor;
pub use texts::{config, msg_parser, ros_args};
pub use yarp::{yarp_bottle, yarp_object, yarp_text};
pub use yarp_names::{yarp_conf, yarp_multicast, yarp_name_lines};
pub use yarp_payload::yarp_payload;
pub use yarp_wire::yarp_connection;
pub use zeromq::{zeromq_counts, zeromq_peer, zeromq_probe};

use wrapyfi_data::Limits;

/// Limits of the targets: small, so that what exceeds them is small, too.
pub const LIMITS: Limits = Limits { message_bytes: 1 << 20, depth: 64 };

/// A target: its name and its function.
pub type Target = (&'static str, fn(&[u8]));

/// Every target.
pub const TARGETS: &[Target] = &[
    ("json", json),
    ("npy", npy),
    ("frames", frames),
    ("jpeg", jpeg),
    ("cdr", cdr),
    ("msg_parser", msg_parser),
    ("ros_args", ros_args),
    ("config", config),
    ("plugin_tensor", plugin_tensor),
    ("pickle", pickle),
    ("plugin_table", plugin_table),
    ("plugin_picture", plugin_picture),
    ("plugin_zarr", plugin_zarr),
    ("node_services", node_services),
    ("dynamic", dynamic),
    ("zeromq_requests", zeromq_requests),
    ("yarp_bottle", yarp_bottle),
    ("yarp_text", yarp_text),
    ("yarp_object", yarp_object),
    ("yarp_name_lines", yarp_name_lines),
    ("yarp_connection", yarp_connection),
    ("ros1_definition", ros1_definition),
    ("ros1_messages", ros1_messages),
    ("tcpros_header", tcpros_header),
    ("xmlrpc", xmlrpc),
    ("yarp_payload", yarp_payload),
    ("zeromq_probe", zeromq_probe),
    ("zeromq_peer", zeromq_peer),
    ("zeromq_counts", zeromq_counts),
    ("ros2_discovery", ros2_discovery),
    ("bridge_marks", bridge_marks),
    ("yarp_conf", yarp_conf),
    ("yarp_multicast", yarp_multicast),
    ("mapping_rules", mapping_rules),
    ("bag", bag),
];
