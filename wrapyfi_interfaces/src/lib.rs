//! ROS 2 interface definitions in Rust.
