//! Nodes, topics and services of ROS 2 through the rmw of an installed ROS 2: serialised bytes in, serialised bytes
//! out, whatever the type.
//!
//! ```text
//!   Node ── Publisher     ─ bytes ─▶ rmw_publish_serialized_message ─┐
//!     │     Subscription  ◀─ bytes ─ rmw_take_serialized_message     │   librmw_implementation
//!     │     Client,Server ◀─ bytes ─▶ type support of our own        ├─▶ loads the middleware that
//!     │                                                              │   RMW_IMPLEMENTATION names
//!     └──── graph: names, types, endpoints, one thread that waits    ┘
//! ```
//!
//! Nothing here knows what the bytes mean. No package that defines a type has to be installed. With the feature `rosidl`,
//! structs of the crates that `rosidl_generator_rs` writes become such bytes (module `rosidl`).
//!
//! The crate is empty without its feature `installed`; with it, a ROS 2 has to be sourced when it is built
//! and when it runs.

#![cfg(feature = "installed")]

mod dispatch;
mod endpoint;
mod event;
mod fault;
mod graph;
mod loaded;
mod log;
mod node;
mod own;
mod publisher;
mod qos;
mod release;
#[cfg(feature = "rosidl")]
pub mod rosidl;
mod security;
mod service;
mod subscription;
mod sys;
mod types;

pub use dispatch::Notify;
pub use endpoint::{Endpoint, EndpointType, Gid};
pub use event::{EventCounts, MATCH_SETTLES};
use fault::c_text;
pub use fault::{Fault, SendFault};
pub use node::{DiscoveryRange, Node, NodeOptions, implementation};
pub use publisher::Publisher;
pub use service::{Client, Received, RequestId, Server, Service};
pub use subscription::{Message, Subscription, Taken};
pub use types::{TypeHash, TypeInfo};
