//! What makes a process a ROS 2 node, above any transport.

pub mod args;
