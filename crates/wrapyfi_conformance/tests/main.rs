//! The middlewares of the workspace, held to what every middleware must do: one program, a module for each subject.

#![allow(
    clippy::indexing_slicing,
    clippy::panic,
    clippy::unwrap_used,
    reason = "in a test a panic is the right answer"
)]

mod memory;
mod ros1;
mod ros1_common;
mod ros1_faults;
mod ros1_hostile;
mod ros2;
mod ros2_common;
mod ros2_fast;
mod yarp;
mod zeromq;
