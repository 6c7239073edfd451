//! ROS 1: draft.

pub mod header;
pub mod xmlrpc;
