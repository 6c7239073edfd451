//! Tests of ROS 2's graph, topics, services and nodes: one program, a module for each subject.

#![allow(
    clippy::expect_used,
    clippy::indexing_slicing,
    clippy::panic,
    clippy::unwrap_used,
    unreachable_pub,
    reason = "in a test a panic is the right answer"
)]

mod actions;
mod common;
mod conformance;
#[cfg(feature = "fastdds-services")]
mod fast_common;
#[cfg(feature = "fastdds-services")]
mod fast_identity;
#[cfg(feature = "fastdds-services")]
mod fast_services;
mod graph;
mod node_announced;
mod node_common;
mod node_endpoints;
mod node_peer;
mod nodes;
mod parameters;
mod qos;
#[cfg(feature = "rmw")]
mod rmw;
mod services;
mod topics;
