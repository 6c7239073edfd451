//! Tests of registered methods: one program, a module for each subject.

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
