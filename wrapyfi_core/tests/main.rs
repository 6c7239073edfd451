//! Tests of what users of the library see: one program, a module for each subject.

#![allow(
    clippy::expect_used,
    clippy::indexing_slicing,
    clippy::panic,
    clippy::unwrap_used,
    unreachable_pub,
    reason = "in a test a panic is the right answer"
)]

mod communicator;
#[cfg(any(feature = "ros2", feature = "zeromq"))]
mod communicator_common;
#[cfg(feature = "ros2")]
mod communicator_ros2;
mod communicator_ros_messages;
#[cfg(feature = "zeromq")]
mod communicator_zeromq;
#[cfg(feature = "engine")]
mod engine_common;
#[cfg(feature = "engine")]
mod engine_driver;
#[cfg(feature = "engine")]
mod engine_threads;
#[cfg(feature = "fastdds-services")]
mod fast_common;
#[cfg(feature = "ros2")]
mod node_common;
#[cfg(feature = "ros2")]
mod ros2_common;
#[cfg(feature = "fastdds-services")]
mod ros2_fast_identity;
#[cfg(feature = "fastdds-services")]
mod ros2_fast_services;
#[cfg(feature = "ros2")]
mod ros2_graph;
#[cfg(feature = "ros2")]
mod ros2_node_announced;
#[cfg(feature = "ros2")]
mod ros2_node_endpoints;
#[cfg(feature = "ros2")]
mod ros2_node_peer;
#[cfg(feature = "ros2")]
mod ros2_nodes;
#[cfg(feature = "ros2")]
mod ros2_parameters;
#[cfg(feature = "ros2")]
mod ros2_qos;
#[cfg(feature = "rmw")]
mod ros2_rmw;
#[cfg(feature = "ros2")]
mod ros2_services;
#[cfg(feature = "ros2")]
mod ros2_topics;
#[cfg(any(feature = "ros1", feature = "ros2"))]
mod ros_args;
#[cfg(any(feature = "ros1", feature = "ros2"))]
mod ros_args_hostile;
#[cfg(feature = "engine")]
mod simulation;
#[cfg(feature = "engine")]
mod simulation_services;
#[cfg(all(feature = "engine", feature = "yarp"))]
mod yarp_discovery;
#[cfg(feature = "yarp")]
mod yarp_links;
#[cfg(feature = "zeromq")]
mod zeromq_broker;
mod zeromq_captures;
#[cfg(feature = "zeromq")]
mod zeromq_common;
#[cfg(all(feature = "zeromq", feature = "curve"))]
mod zeromq_curve;
#[cfg(feature = "zeromq")]
mod zeromq_endpoints;
#[cfg(feature = "zeromq")]
mod zeromq_floods;
mod zeromq_request_captures;
#[cfg(feature = "zeromq")]
mod zeromq_requests;
