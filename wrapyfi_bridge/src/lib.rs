//! The `wrapyfi` command and the bridge node.
//!
//! # Layout
//!
//! ```text
//!   program ─▶ cli ─▶ command::{demo, bridge, check, list, echo, publish, service, broker, yarpserver, detect, why, top}
//!           ├▶ survey, export
//!           └▶ node_main ─▶ command::bridge         `ros2 run wrapyfi_bridge bridge`
//!                       └▶ middleware_bridge        all of a middleware, without a configuration
//!
//!   middlewares   configuration -> middlewares in a registry
//!   canonical native objects as text that every language hashes alike
//!   words     native objects as text for people
//!   describe  a payload as one JSON object, with its digest
//!   command::bag  recordings: convert, play, record
//!   options   --option of the command line
//!   overrides  qos_overrides of the node -> routes
//!   learned   types of a whole graph of ROS
//!   export    interface packages from them
//!   survey    a report of it, and routes to start from
//!   why       the first thing that is missing on a way, from facts
//!   top       the routes of a bridge on a terminal
//!   on_graph  diagnostics and services of a bridge that runs
//!   page      the live page of a bridge that runs
//!   lifecycle  states and transitions of a managed node
//!   reload    a configuration that changes while its bridge runs
//!   files     how many may be open
//!   lines     lines that a thread of their own writes
//!   output    lines on stdout
//!   input     JSON, .npy, PNG, JPEG, WAV -> a payload
//!   status_line  route status as JSON
//!   columns   rows of text as lines
//!   visible   text from outside as it may be shown
//! ```
//!
//! A library so that a program with middlewares of its own is [`main`] with a list; the rest promises no stable interface.

pub mod aborted;
mod action_cli;
#[cfg(feature = "bags")]
pub mod bag_cli;
pub mod canonical;
pub mod cli;
pub mod columns;
pub mod command;
pub mod describe;
pub mod discovery_watch;
pub mod edits;
pub mod exit;
pub mod export;
pub mod files;
pub mod in_force;
pub mod input;
pub mod learned;
pub mod lifecycle;
pub mod lines;
pub mod logging;
pub mod middleware_bridge;
pub mod middlewares;
mod migration_cli;
pub mod near_names;
pub mod node;
pub mod node_main;
pub mod on_graph;
pub mod options;
pub mod output;
pub mod overrides;
pub mod own_address;
pub mod page;
pub mod processes;
mod program;
pub mod reload;
pub mod shutdown;
pub mod sros2;
pub mod status_line;
pub mod survey;
pub mod top;
mod type_names;
pub mod visible;
pub mod why;
pub mod words;

pub use middlewares::BUNDLED;
pub use program::main;
